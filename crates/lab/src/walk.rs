//! How fast a policy walks: distance over time on the ground.

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use stridemap_learn::Policy;
use stridemap_returnmap::{Action, StrideEnd};

use crate::strides::{Act, Next, Transition};

/// What a walk from stepping on the spot came to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Walk {
    /// Ground distance along the first heading over the time since the first section, to the fall if
    /// one came.
    pub speed_m_s: f64,
    /// Time upright since the first section, up to the time asked for.
    pub upright_s: f64,
    /// Way to the left of the first heading.
    pub drift_m: f64,
    /// Change of heading, + to the left.
    pub heading_change_deg: f64,
}

impl Walk {
    /// Sums up the strides of the first episode. The way counts as often as it was made on the
    /// ground: the last stride of a fall is left out of it, its time is not.
    ///
    /// # Arguments
    ///
    /// - `transitions` – strides from a fresh start, of which those of episode 0 are looked at.
    /// - `at_most_s` – the time asked for.
    ///
    /// # Example
    ///
    /// ```
    /// assert_eq!(stridemap_lab::Walk::of(&[], 60.0).speed_m_s, 0.0);
    /// ```
    #[must_use]
    pub fn of(transitions: &[Transition], at_most_s: f64) -> Self {
        let mut walk = Self::default();
        let (mut forward_m, mut time_s) = (0.0, 0.0);
        for t in transitions.iter().filter(|t| t.episode == 0) {
            time_s += t.measures.duration_s;
            if t.end == StrideEnd::Crossing {
                forward_m += t.measures.forward_m;
                walk.drift_m += t.measures.left_m;
                walk.heading_change_deg += t.measures.turn_deg;
            }
        }
        if time_s > 0.0 {
            walk.speed_m_s = forward_m / time_s;
        }
        walk.upright_s = time_s.min(at_most_s);
        walk
    }
}

/// A policy's mean, until a time has passed or the robot is down.
pub struct Walker<'a> {
    policy: &'a dyn Policy,
    left_s: f64,
}

impl<'a> Walker<'a> {
    /// Walks for this long.
    #[must_use]
    pub const fn new(policy: &'a dyn Policy, seconds: f64) -> Self {
        Self {
            policy,
            left_s: seconds,
        }
    }
}

impl Act for Walker<'_> {
    fn act(&mut self, state: &[f64], _rng: &mut ChaCha8Rng) -> Action {
        self.policy.mean(state)
    }

    fn saw(&mut self, transition: &Transition) -> Next {
        self.left_s -= transition.measures.duration_s;
        if self.left_s <= 0.0 || transition.end != StrideEnd::Crossing {
            Next::Stop
        } else {
            Next::Go
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::StrideMeasures;
    use crate::strides::{StridePhase, StrideRole};

    fn stride(end: StrideEnd) -> Transition {
        Transition {
            iteration: 1,
            phase: StridePhase::Record,
            role: StrideRole::Record,
            episode: 0,
            k: 0,
            time_s: 0.0,
            stance: None,
            state: smallvec::smallvec![0.0],
            last_action: smallvec::smallvec![0.0],
            action: smallvec::smallvec![0.0],
            next_state: smallvec::smallvec![0.0],
            reward: 0.0,
            end,
            true_psi_roll_deg: None,
            measures: StrideMeasures {
                duration_s: 0.5,
                forward_m: 0.2,
                left_m: -0.01,
                turn_deg: 1.0,
                ..Default::default()
            },
        }
    }

    /// Three strides of 0.2 m in 0.5 s are 0.4 m/s; with a fall after them 0.6 m in 2 s are 0.3 m/s.
    #[test]
    fn speed_is_distance_over_time_to_the_fall() {
        let mut strides = vec![stride(StrideEnd::Crossing); 3];
        let walk = Walk::of(&strides, 60.0);
        assert!((walk.speed_m_s - 0.4).abs() < 1e-12 && (walk.upright_s - 1.5).abs() < 1e-12);
        assert!((walk.drift_m + 0.03).abs() < 1e-12);
        assert!((walk.heading_change_deg - 3.0).abs() < 1e-12);
        strides.push(stride(StrideEnd::Fell));
        let fell = Walk::of(&strides, 60.0);
        assert!((fell.speed_m_s - 0.3).abs() < 1e-12 && (fell.upright_s - 2.0).abs() < 1e-12);
        assert!((Walk::of(&strides, 1.0).upright_s - 1.0).abs() < 1e-12);
    }
}
