//! How fast a policy walks: distance over time on the ground.

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use stridemap_learn::Policy;
use stridemap_returnmap::{Action, StrideEnd};

use crate::strides::{Act, Next, Transition};

/// How long a measured policy walks from stepping on the spot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WalkTimes {
    /// In all: who is still up then has not fallen.
    pub walk_s: f64,
    /// The first part, over which the speed is taken.
    pub speed_s: f64,
}

/// What a walk from stepping on the spot came to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Walk {
    /// Ground distance along the first heading over the time since the first section, up to the time
    /// asked for, or to the fall if one came before.
    pub speed_m_s: f64,
    /// The same as a simulator knows it, where the robot only estimates its way.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub true_speed_m_s: Option<f64>,
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
    /// - `times` – the times asked for; the stride during which one passes is the last that counts.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_lab::{Walk, WalkTimes};
    ///
    /// let times = WalkTimes { walk_s: 60.0, speed_s: 30.0 };
    /// assert_eq!(Walk::of(&[], times).speed_m_s, 0.0);
    /// ```
    #[must_use]
    pub fn of(transitions: &[Transition], times: WalkTimes) -> Self {
        let mut walk = Self::default();
        let (mut time_s, mut speed_time_s) = (0.0, 0.0);
        let (mut forward_m, mut true_forward_m) = (0.0, Some(0.0));
        for t in transitions.iter().filter(|t| t.episode == 0) {
            let counts = time_s < times.speed_s;
            time_s += t.measures.duration_s;
            if counts {
                speed_time_s = time_s;
            }
            if t.end == StrideEnd::Crossing {
                if counts {
                    forward_m += t.measures.forward_m;
                    true_forward_m = true_forward_m.zip(t.true_forward_m).map(|(s, m)| s + m);
                }
                walk.drift_m += t.measures.left_m;
                walk.heading_change_deg += t.measures.turn_deg;
            }
        }
        if speed_time_s > 0.0 {
            walk.speed_m_s = forward_m / speed_time_s;
            walk.true_speed_m_s = true_forward_m.map(|m| m / speed_time_s);
        }
        walk.upright_s = time_s.min(times.walk_s);
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
            fall: None,
            true_psi_roll_deg: None,
            true_forward_m: None,
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
        let asked = |walk_s, speed_s| WalkTimes { walk_s, speed_s };
        let walk = Walk::of(&strides, asked(60.0, 60.0));
        assert!((walk.speed_m_s - 0.4).abs() < 1e-12 && (walk.upright_s - 1.5).abs() < 1e-12);
        assert!((walk.drift_m + 0.03).abs() < 1e-12);
        assert!((walk.heading_change_deg - 3.0).abs() < 1e-12);
        assert_eq!(walk.true_speed_m_s, None);
        // Over the first 0.8 s: the stride in which they pass is the last that counts.
        strides[2].measures.forward_m = 9.0;
        let first = Walk::of(&strides, asked(60.0, 0.8));
        assert!((first.speed_m_s - 0.4).abs() < 1e-12 && (first.upright_s - 1.5).abs() < 1e-12);
        strides[2].measures.forward_m = 0.2;
        strides.push(stride(StrideEnd::Fell));
        let fell = Walk::of(&strides, asked(60.0, 60.0));
        assert!((fell.speed_m_s - 0.3).abs() < 1e-12 && (fell.upright_s - 2.0).abs() < 1e-12);
        assert!((Walk::of(&strides, asked(1.0, 1.0)).upright_s - 1.0).abs() < 1e-12);
        // The simulator's way, where it knows every stride's.
        strides
            .iter_mut()
            .for_each(|s| s.true_forward_m = Some(0.1));
        let known = Walk::of(&strides, asked(60.0, 60.0));
        assert!((known.true_speed_m_s.unwrap() - 0.15).abs() < 1e-12);
    }
}
