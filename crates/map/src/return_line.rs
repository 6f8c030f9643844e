//! The return map of a scalar: a line through pairs (x(k), x(k+2)) \[MA09, fig. 10\].

use crate::error::MapError;

/// A line fitted to pairs by least squares, with its fixed point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReturnLine {
    /// Slope, dimensionless; below one in magnitude the map is stable.
    pub slope: f64,
    /// Standard error of the slope.
    pub slope_std_error: f64,
    /// Value at zero, in the unit of the pairs.
    pub intercept: f64,
    /// Standard error of the intercept.
    pub intercept_std_error: f64,
    /// Standard deviation of the residuals, with n − 2 degrees of freedom.
    pub residual_std: f64,
    /// Number of pairs.
    pub pairs: usize,
    /// Covariance of slope and intercept.
    covariance: f64,
}

impl ReturnLine {
    /// Fits a line to pairs (x, x′).
    ///
    /// # Errors
    ///
    /// [`MapError::TooFewPairs`] below three, [`MapError::NoSpread`] if all x are equal,
    /// [`MapError::NotFinite`] for NaN or an infinity.
    ///
    /// # Example
    ///
    /// Through (0, 1), (1, 1), (2, 3): means 1 and 5/3, slope 1, intercept 2/3, residuals 1/3, −2/3,
    /// 1/3 with sum of squares 2/3 and one degree of freedom.
    ///
    /// ```
    /// # use stridemap_map::ReturnLine;
    /// let line = ReturnLine::fit(&[(0.0, 1.0), (1.0, 1.0), (2.0, 3.0)])?;
    /// assert!((line.slope - 1.0).abs() < 1e-15 && (line.intercept - 2.0 / 3.0).abs() < 1e-15);
    /// assert!((line.residual_std.powi(2) - 2.0 / 3.0).abs() < 1e-12);
    /// assert!((line.slope_std_error.powi(2) - 1.0 / 3.0).abs() < 1e-12); // s² / Σ(x − 1)²
    /// assert!(line.fixed_point().is_err()); // slope one
    /// # Ok::<(), stridemap_map::MapError>(())
    /// ```
    pub fn fit(pairs: &[(f64, f64)]) -> Result<Self, MapError> {
        const NEEDED: usize = 3;
        if pairs.len() < NEEDED {
            return Err(MapError::TooFewPairs { found: pairs.len(), needed: NEEDED });
        }
        for (index, &(x, y)) in pairs.iter().enumerate() {
            for value in [x, y] {
                if !value.is_finite() {
                    return Err(MapError::NotFinite { quantity: "pairs", index, value });
                }
            }
        }
        let n = pairs.len() as f64;
        let mean_x = pairs.iter().map(|p| p.0).sum::<f64>() / n;
        let mean_y = pairs.iter().map(|p| p.1).sum::<f64>() / n;
        let s_xx: f64 = pairs.iter().map(|p| (p.0 - mean_x).powi(2)).sum();
        let s_xy: f64 = pairs.iter().map(|p| (p.0 - mean_x) * (p.1 - mean_y)).sum();
        // Spread of rounding only: a part in 10¹³ of the values themselves.
        let magnitude = pairs.iter().map(|p| p.0.abs()).fold(0.0, f64::max);
        if s_xx <= n * (1e-13 * magnitude).powi(2) {
            return Err(MapError::NoSpread { value: mean_x });
        }
        let slope = s_xy / s_xx;
        let intercept = mean_y - slope * mean_x;
        let squares: f64 = pairs.iter().map(|p| (p.1 - intercept - slope * p.0).powi(2)).sum();
        let variance = squares / (n - 2.0);
        Ok(Self {
            slope,
            slope_std_error: (variance / s_xx).sqrt(),
            intercept,
            intercept_std_error: (variance * (1.0 / n + mean_x * mean_x / s_xx)).sqrt(),
            residual_std: variance.sqrt(),
            pairs: pairs.len(),
            covariance: -mean_x * variance / s_xx,
        })
    }

    /// Where the line meets the diagonal: intercept / (1 − slope).
    ///
    /// # Errors
    ///
    /// [`MapError::NotIsolated`] for a slope of one, to rounding.
    pub fn fixed_point(&self) -> Result<f64, MapError> {
        let gap = 1.0 - self.slope;
        if gap.abs() < 1e-12 {
            return Err(MapError::NotIsolated);
        }
        Ok(self.intercept / gap)
    }

    /// Standard error of the fixed point, to first order in those of slope and intercept.
    ///
    /// # Errors
    ///
    /// As [`fixed_point`](Self::fixed_point).
    pub fn fixed_point_std_error(&self) -> Result<f64, MapError> {
        let x = self.fixed_point()?;
        // d x = (d intercept + x d slope) / (1 − slope)
        let variance =
            self.intercept_std_error.powi(2) + x * x * self.slope_std_error.powi(2) + 2.0 * x * self.covariance;
        Ok(variance.max(0.0).sqrt() / (1.0 - self.slope).abs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn data_that_determine_no_line_are_refused() {
        assert!(matches!(
            ReturnLine::fit(&[(0.0, 0.0), (1.0, 1.0)]),
            Err(MapError::TooFewPairs { found: 2, needed: 3 })
        ));
        assert!(matches!(ReturnLine::fit(&[(2.0, 0.0), (2.0, 1.0), (2.0, 3.0)]), Err(MapError::NoSpread { .. })));
        assert!(matches!(
            ReturnLine::fit(&[(2.0, 0.0), (1.0, f64::NAN), (2.0, 3.0)]),
            Err(MapError::NotFinite { index: 1, .. })
        ));
    }

    /// The fixed point of noisy data, over many samples, spreads as its standard error says.
    #[test]
    fn standard_errors_are_those_of_repeated_samples() {
        use rand::SeedableRng;
        use rand_distr::Distribution;
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let noise = rand_distr::Normal::new(0.0, 0.2).unwrap();
        let (mut points, mut slopes, mut claimed) = (Vec::new(), Vec::new(), (0.0, 0.0));
        let samples = 4000;
        for _ in 0..samples {
            let pairs: Vec<_> = (0..40)
                .map(|i| {
                    let x = 1.0 + 0.05 * f64::from(i);
                    (x, 1.4 + 0.3 * x + noise.sample(&mut rng))
                })
                .collect();
            let line = ReturnLine::fit(&pairs).unwrap();
            points.push(line.fixed_point().unwrap());
            slopes.push(line.slope);
            claimed.0 += line.fixed_point_std_error().unwrap() / f64::from(samples);
            claimed.1 += line.slope_std_error / f64::from(samples);
        }
        for (values, truth, std_error) in [(&points, 2.0, claimed.0), (&slopes, 0.3, claimed.1)] {
            let n = values.len() as f64;
            let mean = values.iter().sum::<f64>() / n;
            let std = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
            assert!((mean - truth).abs() < 4.0 * std / n.sqrt() + 2e-3, "{mean}");
            // A standard deviation from 4000 samples is known to about 1.1 %: four of these.
            assert!((std / std_error - 1.0).abs() < 0.045, "{std} against {std_error}");
        }
    }

    proptest! {
        #[test]
        fn exact_lines_are_found(slope in -0.9..0.9f64, fixed in -5.0..5.0f64) {
            let pairs: Vec<_> = (0..6)
                .map(|i| (f64::from(i), fixed + slope * (f64::from(i) - fixed)))
                .collect();
            let line = ReturnLine::fit(&pairs).unwrap();
            prop_assert!((line.slope - slope).abs() < 1e-12);
            prop_assert!((line.fixed_point().unwrap() - fixed).abs() < 1e-10);
        }
    }
}
