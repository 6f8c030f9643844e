//! Points that come and go: updates of the factor by one row, equal to refactorising.

use crate::error::{GpError, Result, check_finite, check_len};
use crate::gp::Gp;

impl Gp {
    /// Adds the observation `y` at `x`, keeping the hyperparameters.
    ///
    /// With `l = L⁻¹ k*` and `d² = k** + σₙ² − |l|²`, the inverse factor grows by the row
    /// `(−lᵀL⁻¹, 1)/d`. The result is that of [`Gp::condition`] on all the points, to rounding. A
    /// constant subtracted from standardized outputs stays what it was.
    ///
    /// # Errors
    ///
    /// [`GpError::Shape`], [`GpError::NotFinite`]; [`GpError::NotPositiveDefinite`] if the new
    /// point is, to rounding, determined by the others. The model is then unchanged.
    ///
    /// # Cost
    ///
    /// `O(N²)`.
    ///
    /// # Example
    ///
    /// ```
    /// # use stridemap_gp::{Gp, Hyperparameters, Kernel, Mean, Points};
    /// # let hyperparameters = Hyperparameters {
    /// #     length_scales: vec![1.0], signal_variance: 1.0, noise_variance: 0.25 };
    /// # let mut gp = Gp::condition(Points::new(&[0.0], 1)?, &[1.0],
    /// #     Kernel::SquaredExponential, Mean::Zero, hyperparameters)?;
    /// // A second look at the same place: K = [[1.25, 1], [1, 1.25]], mean 2/2.25.
    /// gp.add_point(&[0.0], 1.0)?;
    /// assert!((gp.predict(&[0.0])?.mean - 2.0 / 2.25).abs() < 1e-14);
    /// gp.drop_point(0)?;
    /// assert!((gp.predict(&[0.0])?.mean - 0.8).abs() < 1e-14);
    /// # Ok::<(), stridemap_gp::GpError>(())
    /// ```
    pub fn add_point(&mut self, x: &[f64], y: f64) -> Result<()> {
        check_len("length of x", self.dims, x.len())?;
        check_finite("x", x, self.dims)?;
        check_finite("y", &[y], 1)?;
        let n = self.y.len();
        let mut buffer = vec![0.0; self.stride + self.dims];
        self.moments(x, &mut buffer)?;
        buffer.truncate(self.stride);
        buffer[n..].fill(0.0);
        let mut l = vec![0.0; self.stride];
        self.factor.product(&buffer, &mut l);
        let total = self.hyperparameters.signal_variance + self.hyperparameters.noise_variance;
        let rest = total - l.iter().map(|l| l * l).sum::<f64>();
        let least = f64::EPSILON * total;
        if rest.is_nan() || rest <= least {
            return Err(GpError::NotPositiveDefinite {
                points: n + 1,
                row: n,
                signal_variance: self.hyperparameters.signal_variance,
                noise_variance: self.hyperparameters.noise_variance,
            });
        }
        let pivot = 1.0 / rest.sqrt();
        let mut row = vec![0.0; self.stride];
        self.factor.transposed_product(&l, &mut row);
        row.truncate(n);
        row.iter_mut().for_each(|value| *value *= -pivot);

        let mut next = self.clone();
        next.factor.push_row(&row, pivot);
        next.x.extend_from_slice(x);
        next.y.push(y);
        next.updates += 1;
        next.scale_inputs();
        next.solve()?;
        *self = next;
        Ok(())
    }

    /// Drops training point `index`, keeping the hyperparameters; later points move up by one.
    ///
    /// Rotations of neighbouring rows of the inverse factor, `O(N²)`; the result is that of
    /// [`Gp::condition`] on the other points, to rounding.
    ///
    /// # Errors
    ///
    /// [`GpError::Index`] if there is no such point, [`GpError::Empty`] if it is the last one,
    /// [`GpError::MeanNotIdentifiable`] if the others do not determine the mean. The model is then
    /// unchanged.
    ///
    /// # Example
    ///
    /// See [`add_point`](Self::add_point).
    pub fn drop_point(&mut self, index: usize) -> Result<()> {
        let n = self.y.len();
        if index >= n {
            return Err(GpError::Index { index, points: n });
        }
        if n == 1 {
            return Err(GpError::Empty { what: "training set without its only point" });
        }
        let mut next = self.clone();
        next.factor = self.factor.without(index);
        next.x.drain(index * self.dims..(index + 1) * self.dims);
        next.y.remove(index);
        next.updates += 1;
        next.scale_inputs();
        next.solve()?;
        *self = next;
        Ok(())
    }
}
