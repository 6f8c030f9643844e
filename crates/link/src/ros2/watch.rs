//! A joint that does not follow its commands.

use stridemap_robot::JointState;

/// Compares what the joints were told with what they do, over windows.
#[derive(Clone, Debug, Default)]
pub(crate) struct Watch {
    since_s: f64,
    told: Vec<[f64; 2]>,
    seen: Vec<[f64; 2]>,
}

impl Watch {
    /// Length of a window: longer than a stride.
    const WINDOW_S: f64 = 1.5;
    /// A joint that was told to move by this much over a window, ...
    const TOLD_RAD: f64 = 0.05;
    /// ... and moved by less than this share of it, is stuck.
    const SHARE: f64 = 0.15;

    /// Takes one period; the joint that is stuck, if one is.
    pub fn joint_stuck(&mut self, now_s: f64, told: &[f64], seen: &[JointState]) -> Option<usize> {
        if self.told.len() != told.len() || now_s < self.since_s {
            *self = Self {
                since_s: now_s,
                told: told.iter().map(|v| [*v; 2]).collect(),
                seen: seen.iter().map(|j| [j.position_rad; 2]).collect(),
            };
            return None;
        }
        let grow = |range: &mut [f64; 2], value: f64| {
            *range = [range[0].min(value), range[1].max(value)];
        };
        for (range, value) in self.told.iter_mut().zip(told) {
            grow(range, *value);
        }
        for (range, joint) in self.seen.iter_mut().zip(seen) {
            grow(range, joint.position_rad);
        }
        if now_s - self.since_s < Self::WINDOW_S {
            return None;
        }
        let width = |range: &[f64; 2]| range[1] - range[0];
        let stuck = self
            .told
            .iter()
            .zip(&self.seen)
            .position(|(told, seen)| width(told) > Self::TOLD_RAD && width(seen) < Self::SHARE * width(told));
        self.told.clear();
        stuck
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_joint_that_stands_while_it_is_told_to_move_is_found_within_two_windows() {
        let mut watch = Watch::default();
        let mut found = None;
        let mut k = 0;
        while found.is_none() && k < 1000 {
            let now_s = 0.008 * f64::from(k);
            let told = 0.1 * (6.0 * now_s).sin();
            let joint = |position_rad| JointState { position_rad, ..JointState::default() };
            // The second sticks from the first second on.
            let stuck = if now_s < 1.0 { told } else { 0.1 * 6.0_f64.sin() };
            found = watch.joint_stuck(now_s, &[told; 2], &[joint(told), joint(stuck)]);
            k += 1;
        }
        assert_eq!(found, Some(1));
        assert!(0.008 * f64::from(k) < 1.0 + 2.0 * Watch::WINDOW_S + 0.1);
    }
}
