//! Which leg the robot stands on.

use serde::{Deserialize, Serialize};
use stridemap_robot::{RobotState, Side};

/// Load fractions at which the stance passes from one leg to the other.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StanceConfig {
    /// A leg becomes the stance leg when it carries more than this share of the load; between
    /// `1 − share` and `share` the stance stays as it was. In (0.5, 1).
    pub load_share: f64,
}

/// Follows the stance leg with hysteresis, so that one transfer of load is one change of stance.
///
/// # Example
///
/// ```
/// use stridemap_robot::{RobotState, Side};
/// use stridemap_section::{StanceConfig, StanceDetector};
///
/// let mut detector = StanceDetector::new(StanceConfig { load_share: 0.6 });
/// let mut state = RobotState::default();
/// let mut stance = |left_n, right_n| {
///     state.feet[Side::Left.index()].load_n = left_n;
///     state.feet[Side::Right.index()].load_n = right_n;
///     detector.update(&state)
/// };
/// assert_eq!(stance(50.0, 50.0), None);
/// assert_eq!(stance(30.0, 70.0), Some(Side::Right));
/// assert_eq!(stance(55.0, 45.0), Some(Side::Right));
/// assert_eq!(stance(65.0, 35.0), Some(Side::Left));
/// ```
#[derive(Clone, Debug)]
pub struct StanceDetector {
    config: StanceConfig,
    stance: Option<Side>,
}

impl StanceDetector {
    /// A detector that knows no stance yet.
    #[must_use]
    pub const fn new(config: StanceConfig) -> Self {
        Self { config, stance: None }
    }

    /// Forgets the stance.
    pub fn reset(&mut self) {
        self.stance = None;
    }

    /// The stance leg after this state; `None` until one leg has carried the larger share. In the
    /// air the last stance stays.
    pub fn update(&mut self, state: &RobotState) -> Option<Side> {
        if let Some(right) = state.right_load_fraction() {
            if right > self.config.load_share {
                self.stance = Some(Side::Right);
            } else if right < 1.0 - self.config.load_share {
                self.stance = Some(Side::Left);
            }
        }
        self.stance
    }
}
