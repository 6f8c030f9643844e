//! How far one command may go: a joint's range, its rate, its torque.

use crate::robot::JointLimits;
use crate::state::JointState;

/// How often a command was changed, by what.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LimitCounts {
    /// Moved into the joint's range.
    pub position_clamped: u64,
    /// Held back to the joint's rate.
    pub rate_limited: u64,
    /// Moved towards the measured angle, because the joint pushed harder than it may.
    pub torque_limited: u64,
}

impl std::ops::AddAssign for LimitCounts {
    fn add_assign(&mut self, other: Self) {
        self.position_clamped += other.position_clamped;
        self.rate_limited += other.rate_limited;
        self.torque_limited += other.torque_limited;
    }
}

/// A value moved into a range; the middle of a range that is empty.
fn within(value: f64, lower: f64, upper: f64) -> f64 {
    if lower <= upper { value.clamp(lower, upper) } else { 0.5 * (lower + upper) }
}

impl JointLimits {
    /// The command nearest to a wanted one that these limits allow.
    ///
    /// ```text
    /// range   wanted → [lower, upper]
    /// rate    … → [from − rate · period, from + rate · period]
    /// torque  |τ| > limit and the servo pulls towards the command:
    ///         … → within |from − q| · limit / |τ| of the measured angle q
    /// ```
    ///
    /// The torque of a position servo grows with the distance between command and angle, whatever its
    /// stiffness: a command at the share limit/|τ| of the present distance brings the torque to the limit.
    /// It wins over the rate, because it only ever gives way.
    ///
    /// # Arguments
    ///
    /// - `wanted_rad` – what is asked for; finite.
    /// - `from_rad` – the command in force.
    /// - `measured` – the joint as it was last read.
    /// - `period_s` – time until the next command.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_robot::{JointLimits, JointState};
    ///
    /// let limits = JointLimits { lower_rad: -1.0, upper_rad: 1.0, velocity_rad_s: 5.0, torque_nm: 2.0 };
    /// let still = JointState::default();
    /// // 5 rad/s for 0.01 s.
    /// assert_eq!(limits.hold(3.0, 0.0, &still, 0.01).0, 0.05);
    /// // A command 0.4 rad ahead makes 4 N m: half of it makes 2.
    /// let strained = JointState { torque_nm: 4.0, ..still };
    /// let (command, counts) = limits.hold(0.4, 0.4, &strained, 0.01);
    /// assert_eq!(command, 0.2);
    /// assert_eq!((counts.rate_limited, counts.torque_limited), (0, 1));
    /// ```
    #[must_use]
    pub fn hold(&self, wanted_rad: f64, from_rad: f64, measured: &JointState, period_s: f64) -> (f64, LimitCounts) {
        let ranged = within(wanted_rad, self.lower_rad, self.upper_rad);
        let reach = self.velocity_rad_s * period_s;
        let reached = within(ranged, from_rad - reach, from_rad + reach);
        let (ahead, torque) = (from_rad - measured.position_rad, measured.torque_nm);
        let strained = torque.abs() > self.torque_nm && ahead * torque > 0.0;
        let eased = if strained {
            let room = ahead.abs() * self.torque_nm / torque.abs();
            if ahead > 0.0 {
                reached.min(measured.position_rad + room)
            } else {
                reached.max(measured.position_rad - room)
            }
        } else {
            reached
        };
        let changed = |a: f64, b: f64| u64::from((a - b).abs() > 0.0);
        let counts = LimitCounts {
            position_clamped: changed(ranged, wanted_rad),
            rate_limited: changed(reached, ranged),
            torque_limited: changed(eased, reached),
        };
        (eased, counts)
    }
}

/// [`JointLimits::hold`] for every joint.
///
/// All slices have one entry per joint.
#[must_use]
pub fn hold_to_limits(
    wanted_rad: &[f64],
    from_rad: &[f64],
    measured: &[JointState],
    limits: &[JointLimits],
    period_s: f64,
) -> (Vec<f64>, LimitCounts) {
    let mut counts = LimitCounts::default();
    let held = wanted_rad
        .iter()
        .zip(from_rad)
        .zip(measured)
        .zip(limits)
        .map(|(((wanted, from), joint), limits)| {
            let (command, one) = limits.hold(*wanted, *from, joint, period_s);
            counts += one;
            command
        })
        .collect();
    (held, counts)
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: JointLimits = JointLimits { lower_rad: -1.0, upper_rad: 1.0, velocity_rad_s: 5.0, torque_nm: 1.0 };

    fn at(position_rad: f64, torque_nm: f64) -> JointState {
        JointState { position_rad, torque_nm, ..JointState::default() }
    }

    #[test]
    fn a_command_within_every_limit_is_left_alone_to_the_bit() {
        let (held, counts) = LIMITS.hold(0.1 + 0.2, 0.3, &at(0.29, 0.99), 0.008);
        assert_eq!(held.to_bits(), (0.1_f64 + 0.2).to_bits());
        assert_eq!(counts, LimitCounts::default());
    }

    /// A spring servo of any stiffness against a wall: the command is eased until the torque is the
    /// limit, and no further.
    #[test]
    fn a_blocked_joint_pushes_no_harder_than_its_limit() {
        for stiffness in [3.0, 20.0, 400.0] {
            for direction in [1.0, -1.0] {
                let mut command = 0.0;
                let mut torque = 0.0;
                for _ in 0..200 {
                    (command, _) = LIMITS.hold(0.9 * direction, command, &at(0.0, torque), 0.008);
                    torque = stiffness * command;
                }
                // The rate lets it overshoot by one period's reach before it is eased again.
                let most = 1.0 + stiffness * 0.04;
                assert!(torque.abs() <= most + 1e-12, "{stiffness}: {torque}");
                assert!(torque * direction > 0.0);
            }
        }
    }

    #[test]
    fn a_load_that_the_command_does_not_cause_is_not_fought_by_it() {
        // Somebody turns the joint: the torque opposes the way from the angle to the command.
        let (held, counts) = LIMITS.hold(0.2, 0.2, &at(0.1, -3.0), 0.008);
        assert!((held - 0.2).abs() < 1e-15 && counts.torque_limited == 0);
    }
}
