//! A small CMA-ES: evolution strategy with covariance matrix adaptation \[Hansen16\].

use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::error::{LearnError, check_length, check_number};

/// Maximises a function of d numbers by asking for points and being told their values.
///
/// The parameters are the defaults of \[Hansen16, table 1\], without negative weights. It is our own
/// because asking and telling with the caller's generator takes little more than a hundred lines.
///
/// # Example
///
/// ```
/// # use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
/// # use stridemap_learn::CmaEs;
/// let mut search = CmaEs::new(&[0.0, 0.0], &[1.0, 1.0], None)?;
/// let mut rng = ChaCha8Rng::seed_from_u64(1);
/// for _ in 0..60 {
///     let points = search.ask(&mut rng);
///     let values: Vec<f64> =
///         points.iter().map(|p| -(p[0] - 1.0).powi(2) - (p[1] + 2.0).powi(2)).collect();
///     search.tell(&points, &values)?;
/// }
/// assert!((search.mean()[0] - 1.0).abs() < 1e-6 && (search.mean()[1] + 2.0).abs() < 1e-6);
/// # Ok::<(), stridemap_learn::LearnError>(())
/// ```
#[derive(Clone, Debug)]
pub struct CmaEs {
    mean: DVector<f64>,
    /// Units of the coordinates: everything below is in these.
    scale: DVector<f64>,
    step: f64,
    covariance: DMatrix<f64>,
    /// B and D of C = B D² Bᵀ.
    axes: DMatrix<f64>,
    lengths: DVector<f64>,
    path_step: DVector<f64>,
    path_covariance: DVector<f64>,
    population: usize,
    weights: Vec<f64>,
    generation: u32,
}

impl CmaEs {
    /// A search about `start` with initial standard deviation `std` per coordinate; a population of
    /// 4 + 3 ln d unless given.
    ///
    /// # Errors
    ///
    /// [`LearnError::Length`] or [`LearnError::Parameter`].
    pub fn new(start: &[f64], std: &[f64], population: Option<usize>) -> Result<Self, LearnError> {
        let d = start.len();
        check_length("std", std.len(), d)?;
        for &v in start {
            check_number("start", v, true, "finite")?;
        }
        for &v in std {
            check_number("std", v, v > 0.0, "positive and finite")?;
        }
        let population = population.unwrap_or(4 + (3.0 * (d as f64).ln()).floor() as usize);
        if d == 0 || population < 4 {
            return Err(LearnError::parameter("population", population, "at least 4"));
        }
        let parents = population / 2;
        let raw: Vec<f64> = (1..=parents).map(|i| ((population as f64 + 1.0) / 2.0).ln() - (i as f64).ln()).collect();
        let total: f64 = raw.iter().sum();
        Ok(Self {
            mean: DVector::from_column_slice(start),
            scale: DVector::from_column_slice(std),
            step: 1.0,
            covariance: DMatrix::identity(d, d),
            axes: DMatrix::identity(d, d),
            lengths: DVector::from_element(d, 1.0),
            path_step: DVector::zeros(d),
            path_covariance: DVector::zeros(d),
            population,
            weights: raw.iter().map(|w| w / total).collect(),
            generation: 0,
        })
    }

    /// The centre of the search.
    #[must_use]
    pub fn mean(&self) -> &[f64] {
        self.mean.as_slice()
    }

    /// The next points to try.
    #[must_use]
    pub fn ask(&self, rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
        let d = self.mean.len();
        (0..self.population)
            .map(|_| {
                let z = DVector::from_fn(d, |i, _| {
                    let z: f64 = StandardNormal.sample(rng);
                    z * self.lengths[i]
                });
                let y = &self.axes * z;
                (&self.mean + self.step * self.scale.component_mul(&y)).as_slice().to_vec()
            })
            .collect()
    }

    /// Learns from the values of points, as they were asked for or after repair (clipping to a box).
    ///
    /// # Errors
    ///
    /// [`LearnError::Length`] if there are not as many as were asked for; [`LearnError::Parameter`]
    /// for a value that is NaN.
    pub fn tell(&mut self, points: &[Vec<f64>], values: &[f64]) -> Result<(), LearnError> {
        let d = self.mean.len();
        check_length("points", points.len(), self.population)?;
        check_length("values", values.len(), self.population)?;
        for (point, &value) in points.iter().zip(values) {
            check_length("a point", point.len(), d)?;
            if value.is_nan() {
                return Err(LearnError::parameter("values", value, "numbers"));
            }
        }
        let mut order: Vec<usize> = (0..values.len()).collect();
        order.sort_by(|&a, &b| values[b].total_cmp(&values[a]));

        // [Hansen16, table 1]
        let n = d as f64;
        let mu_eff = 1.0 / self.weights.iter().map(|w| w * w).sum::<f64>();
        let c_sigma = (mu_eff + 2.0) / (n + mu_eff + 5.0);
        let d_sigma = 1.0 + 2.0 * (((mu_eff - 1.0) / (n + 1.0)).sqrt() - 1.0).max(0.0) + c_sigma;
        let c_c = (4.0 + mu_eff / n) / (n + 4.0 + 2.0 * mu_eff / n);
        let c_1 = 2.0 / ((n + 1.3).powi(2) + mu_eff);
        let c_mu = (1.0 - c_1).min(2.0 * (mu_eff - 2.0 + 1.0 / mu_eff) / ((n + 2.0).powi(2) + mu_eff));
        let chi = n.sqrt() * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n));

        let steps: Vec<DVector<f64>> = order
            .iter()
            .take(self.weights.len())
            .map(|&i| (DVector::from_column_slice(&points[i]) - &self.mean).component_div(&self.scale) / self.step)
            .collect();
        let mut y = DVector::zeros(d);
        for (w, s) in self.weights.iter().zip(&steps) {
            y += *w * s;
        }
        self.mean += self.step * self.scale.component_mul(&y);
        self.generation += 1;

        let whitened = &self.axes * (self.axes.transpose() * &y).component_div(&self.lengths);
        self.path_step = (1.0 - c_sigma) * &self.path_step + (c_sigma * (2.0 - c_sigma) * mu_eff).sqrt() * whitened;
        let length = self.path_step.norm();
        let grown = 1.0 - (1.0 - c_sigma).powi(2 * self.generation.min(1000) as i32);
        let h = if length / grown.sqrt() < (1.4 + 2.0 / (n + 1.0)) * chi { 1.0 } else { 0.0 };
        self.path_covariance = (1.0 - c_c) * &self.path_covariance + h * (c_c * (2.0 - c_c) * mu_eff).sqrt() * &y;
        let stalled = (1.0 - h) * c_c * (2.0 - c_c);
        self.covariance *= 1.0 - c_1 - c_mu + c_1 * stalled;
        self.covariance += c_1 * &self.path_covariance * self.path_covariance.transpose();
        for (w, s) in self.weights.iter().zip(&steps) {
            self.covariance += c_mu * *w * s * s.transpose();
        }
        // A step that grows without end says that the values do not depend on the points.
        self.step = (self.step * ((c_sigma / d_sigma) * (length / chi - 1.0)).exp()).clamp(1e-12, 1e4);

        let symmetric = 0.5 * (&self.covariance + self.covariance.transpose());
        let eigen = symmetric.clone().symmetric_eigen();
        self.covariance = symmetric;
        self.axes = eigen.eigenvectors;
        self.lengths = eigen.eigenvalues.map(|v| v.max(1e-20).sqrt());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::rand_core::SeedableRng;

    fn maximise(f: &dyn Fn(&[f64]) -> f64, start: &[f64], generations: usize, seed: u64) -> Vec<f64> {
        let mut search = CmaEs::new(start, &vec![0.5; start.len()], None).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        for _ in 0..generations {
            let points = search.ask(&mut rng);
            let values: Vec<f64> = points.iter().map(|p| f(p)).collect();
            search.tell(&points, &values).unwrap();
        }
        search.mean().to_vec()
    }

    /// Axis ratios of 10⁶ in six dimensions, turned; and a bent valley.
    #[test]
    fn hard_valleys_are_followed() {
        let ellipsoid = |p: &[f64]| {
            -(0..6)
                .map(|i| {
                    let turned = (p[i] - 1.0) + 0.5 * (p[(i + 1) % 6] - 1.0);
                    10f64.powf(i as f64 * 6.0 / 5.0) * turned * turned
                })
                .sum::<f64>()
        };
        let rosenbrock = |p: &[f64]| -(100.0 * (p[1] - p[0] * p[0]).powi(2) + (1.0 - p[0]).powi(2));
        for seed in 1..=5 {
            let found = maximise(&ellipsoid, &[0.0; 6], 600, seed);
            assert!(found.iter().all(|v| (v - 1.0).abs() < 1e-4), "{found:?}");
            let found = maximise(&rosenbrock, &[-1.0, 1.0], 300, seed);
            assert!(found.iter().all(|v| (v - 1.0).abs() < 1e-4), "{found:?}");
        }
    }

    #[test]
    fn values_that_tell_nothing_do_no_harm() {
        let found = maximise(&|_| 0.0, &[1.0, 2.0, 3.0], 500, 1);
        assert!(found.iter().all(|v| v.is_finite()));
        let mut search = CmaEs::new(&[0.0], &[1.0], None).unwrap();
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let points = search.ask(&mut rng);
        assert!(search.tell(&points, &[f64::NAN; 4]).is_err());
        assert!(search.tell(&points, &[0.0; 2]).is_err());
    }
}
