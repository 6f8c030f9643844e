//! The return map of a measured gait: lines through (ψ(k), ψ(k+1)) and (ψ(k), ψ(k+2)).

use serde::{Deserialize, Serialize};
use stridemap_map::{MapError, ReturnLine};
use stridemap_process::StrideEnd;

use crate::stride::Transition;

/// A least-squares line through pairs (ψ(k), ψ(k+lag)), as it is written to files.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReturnMapLine {
    /// Slope, dimensionless; below one in magnitude the gait comes back.
    pub slope: f64,
    /// Standard error of the slope.
    pub slope_std_error: f64,
    /// Where the line meets the diagonal: intercept / (1 − slope); null for a slope of one.
    pub fixed_point_deg: Option<f64>,
    /// Pairs behind the line.
    pub pairs: usize,
}

impl ReturnMapLine {
    /// The line through pairs; `None` where they determine none (fewer than three, or no spread).
    ///
    /// # Errors
    ///
    /// [`MapError`] for a value that is not finite.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_record::ReturnMapLine;
    ///
    /// // ψ′ = 1 + ψ / 2 meets the diagonal at 2.
    /// let line = ReturnMapLine::fit(&[(0.0, 1.0), (1.0, 1.5), (4.0, 3.0)])?.unwrap();
    /// assert!((line.slope - 0.5).abs() < 1e-12);
    /// assert!((line.fixed_point_deg.unwrap() - 2.0).abs() < 1e-12);
    /// assert!(ReturnMapLine::fit(&[(0.0, 1.0)])?.is_none());
    /// # Ok::<(), stridemap_map::MapError>(())
    /// ```
    pub fn fit(pairs: &[(f64, f64)]) -> Result<Option<Self>, MapError> {
        match ReturnLine::fit(pairs) {
            Ok(line) => Ok(Some(Self {
                slope: line.slope,
                slope_std_error: line.slope_std_error,
                fixed_point_deg: line.fixed_point().ok(),
                pairs: line.pairs,
            })),
            Err(MapError::TooFewPairs { .. } | MapError::NoSpread { .. }) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// The line through the pairs of strides `lag` apart, both ends at a section and no other start
    /// between them. `None` where they determine none.
    #[must_use]
    pub fn of(transitions: &[Transition], lag: usize) -> Option<Self> {
        let pairs: Vec<(f64, f64)> = transitions
            .windows(lag + 1)
            .filter(|w| w.iter().all(|t| t.end == StrideEnd::Crossing))
            .filter(|w| w.iter().all(|t| t.episode == w[0].episode))
            .map(|w| (w[0].measures.psi_roll_deg, w[lag].measures.psi_roll_deg))
            .filter(|(a, b)| a.is_finite() && b.is_finite())
            .collect();
        Self::fit(&pairs).ok().flatten()
    }
}
