//! The running mean of `ψ_roll`: what may announce a fall on a robot with wide feet.
//!
//! Such a robot need not alternate before it falls. It may sway less and less far over its stance foot:
//! the mean of `ψ_roll` over the last strides rises, while a single one is too noisy to tell anything.

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

/// When the running mean of `ψ_roll` is high.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeanRollConfig {
    /// Strides over which the mean is taken; an episode must be as long before it says anything.
    pub strides: usize,
    /// The mean this far above that of the robot's own stepping in place is high, deg.
    pub above_in_place_deg: f64,
}

impl MeanRollConfig {
    /// The limit for a robot that steps in place with this mean.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_lab::MeanRollConfig;
    ///
    /// let config = MeanRollConfig { strides: 8, above_in_place_deg: 2.5 };
    /// assert_eq!(config.limit(6.5).above_deg, 9.0);
    /// ```
    #[must_use]
    pub fn limit(&self, in_place_deg: f64) -> MeanRollLimit {
        MeanRollLimit { strides: self.strides, above_deg: in_place_deg + self.above_in_place_deg }
    }
}

/// The limit of the running mean in degrees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeanRollLimit {
    /// Strides over which the mean is taken.
    pub strides: usize,
    /// A mean above this is high, deg.
    pub above_deg: f64,
}

/// Watches the strides of one episode.
#[derive(Clone, Debug, Default)]
pub(crate) struct MeanRoll {
    last_deg: VecDeque<f64>,
}

impl MeanRoll {
    /// Looks at the `ψ_roll` of one more stride; true if the mean over the last ones is high.
    pub(crate) fn is_high(&mut self, psi_roll_deg: f64, limit: MeanRollLimit) -> bool {
        self.last_deg.push_back(psi_roll_deg);
        while self.last_deg.len() > limit.strides {
            self.last_deg.pop_front();
        }
        let mean_deg = self.last_deg.iter().sum::<f64>() / limit.strides.max(1) as f64;
        self.last_deg.len() == limit.strides && mean_deg > limit.above_deg
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Over three strides and a limit of 5: (9, 0, 6) has the mean 5, (0, 6, 10) has 5.3.
    #[test]
    fn only_a_full_window_with_a_high_mean_tells() {
        let limit = MeanRollLimit { strides: 3, above_deg: 5.0 };
        let mut watch = MeanRoll::default();
        let seen = [9.0, 0.0, 6.0, 10.0, 2.0].map(|psi| watch.is_high(psi, limit));
        assert_eq!(seen, [false, false, false, true, true]);
    }
}
