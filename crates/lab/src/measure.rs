//! What is measured of a stride, whether or not it is rewarded.

use stridemap_record::StrideMeasures;
use stridemap_robot::{JointTargets, RobotDescription, RobotState};
use stridemap_section::Pendulum;

/// Gravity, for the cost of transport.
const GRAVITY_M_S2: f64 = 9.81;
/// Ways under this count as this in the cost of transport.
const LEAST_WAY_M: f64 = 0.01;

/// An angle brought into [−π, π).
pub(crate) fn wrapped_rad(angle_rad: f64) -> f64 {
    use std::f64::consts::PI;
    (angle_rad + PI).rem_euclid(2.0 * PI) - PI
}

/// Measures one stride after another.
#[derive(Clone, Debug)]
pub struct StrideMeter {
    /// The leg joints: place among the robot's joints, and angle at rest.
    legs: Vec<(usize, f64)>,
    mass_kg: f64,
    first_heading_rad: f64,
    /// Change of heading from the episode's first to the beginning of this stride.
    turned_rad: f64,
    start: Instant,
    pitch_rate_integral_deg: f64,
    energy_j: f64,
    peak_foot_load_n: f64,
    deviation_square_integral_rad2_s: f64,
    elapsed_s: f64,
}

#[derive(Clone, Copy, Debug, Default)]
struct Instant {
    time_s: f64,
    com_m: [f64; 2],
    heading_rad: f64,
}

impl Instant {
    fn of(state: &RobotState) -> Self {
        let [x, y, _] = state.com.position_m;
        Self { time_s: state.time_s, com_m: [x, y], heading_rad: state.base.heading_rad() }
    }
}

impl StrideMeter {
    /// A meter for a robot that rests in `rest`.
    #[must_use]
    pub fn new(robot: &RobotDescription, rest: &JointTargets) -> Self {
        let leg = |joint: usize| Some((joint, rest.joints.get(joint)?.position_rad));
        let legs = robot.legs.roles();
        Self {
            legs: legs.filter_map(|(.., role)| leg(role.joint)).collect(),
            mass_kg: robot.mass_kg,
            first_heading_rad: 0.0,
            turned_rad: 0.0,
            start: Instant::default(),
            pitch_rate_integral_deg: 0.0,
            energy_j: 0.0,
            peak_foot_load_n: 0.0,
            deviation_square_integral_rad2_s: 0.0,
            elapsed_s: 0.0,
        }
    }

    /// An episode begins at a section: its heading is the direction in which ways are measured.
    pub fn begin_episode(&mut self, state: &RobotState) {
        self.first_heading_rad = state.base.heading_rad();
        self.start = Instant::of(state);
        self.turned_rad = 0.0;
        self.begin_stride(state);
    }

    fn turn_rad(&self, now: &Instant) -> f64 {
        wrapped_rad(now.heading_rad - self.start.heading_rad)
    }

    /// A stride begins.
    pub fn begin_stride(&mut self, state: &RobotState) {
        let now = Instant::of(state);
        self.turned_rad += self.turn_rad(&now);
        self.start = now;
        self.pitch_rate_integral_deg = 0.0;
        self.energy_j = 0.0;
        self.peak_foot_load_n = 0.0;
        self.deviation_square_integral_rad2_s = 0.0;
        self.elapsed_s = 0.0;
    }

    /// One control tick of `dt_s` inside the stride.
    pub fn tick(&mut self, state: &RobotState, pendulum: Option<&Pendulum>, dt_s: f64) {
        self.elapsed_s += dt_s;
        if let Some(p) = pendulum {
            self.pitch_rate_integral_deg += p.pitch_rate_rad_s.to_degrees() * dt_s;
        }
        let (mut power_w, mut square_rad2) = (0.0, 0.0);
        for (joint, rest_rad) in &self.legs {
            if let Some(j) = state.joints.get(*joint) {
                power_w += (j.torque_nm * j.velocity_rad_s).abs();
                square_rad2 += (j.position_rad - rest_rad).powi(2);
            }
        }
        self.energy_j += power_w * dt_s;
        self.deviation_square_integral_rad2_s += square_rad2 / self.legs.len().max(1) as f64 * dt_s;
        for foot in &state.feet {
            self.peak_foot_load_n = self.peak_foot_load_n.max(foot.load_n);
        }
    }

    /// What was measured up to this state; `at_end` is the pendulum at the section, or the last one
    /// seen where the stride ended otherwise. The gait's phase is the plant's to add.
    #[must_use]
    pub fn measures(&self, state: &RobotState, at_end: Option<&Pendulum>) -> StrideMeasures {
        let now = Instant::of(state);
        let [dx, dy] = [now.com_m[0] - self.start.com_m[0], now.com_m[1] - self.start.com_m[1]];
        let (sin, cos) = self.first_heading_rad.sin_cos();
        let (sin_now, cos_now) = self.start.heading_rad.sin_cos();
        let ahead_m = cos_now * dx + sin_now * dy;
        let turn_rad = self.turn_rad(&now);
        let to_stance = at_end.map_or(0.0, |p| p.stance.lateral_sign());
        let per_elapsed = |integral: f64| {
            if self.elapsed_s > 0.0 { integral / self.elapsed_s } else { 0.0 }
        };
        StrideMeasures {
            duration_s: now.time_s - self.start.time_s,
            forward_m: cos * dx + sin * dy,
            left_m: cos * dy - sin * dx,
            ahead_m,
            turn_deg: turn_rad.to_degrees(),
            psi_roll_deg: at_end.map_or(0.0, |p| p.roll_rad.to_degrees()),
            psi_pitch_deg: at_end.map_or(0.0, |p| p.pitch_rad.to_degrees()),
            psi_pitch_rate_deg_s: at_end.map_or(0.0, |p| p.pitch_rate_rad_s.to_degrees()),
            yaw_rate_deg_s: to_stance * state.base.angular_velocity_rad_s[2].to_degrees(),
            heading_deg: to_stance * (self.turned_rad + turn_rad).to_degrees(),
            gait_phase_deg: 0.0,
            mean_psi_pitch_rate_deg_s: per_elapsed(self.pitch_rate_integral_deg),
            energy_j: self.energy_j,
            peak_foot_load_n: self.peak_foot_load_n,
            posture_deviation_deg: per_elapsed(self.deviation_square_integral_rad2_s).sqrt().to_degrees(),
            cost_of_transport: self.energy_j / (self.mass_kg * GRAVITY_M_S2 * ahead_m.abs().max(LEAST_WAY_M)),
            ..StrideMeasures::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stridemap_robot::Side;

    fn heading(deg: f64, yaw_rate_rad_s: f64) -> RobotState {
        let mut state = RobotState::default();
        let half = 0.5 * deg.to_radians();
        state.base.orientation = [half.cos(), 0.0, 0.0, half.sin()];
        state.base.angular_velocity_rad_s[2] = yaw_rate_rad_s;
        state
    }

    fn standing_on(stance: Side) -> Pendulum {
        Pendulum { roll_rad: 0.0, roll_rate_rad_s: 0.0, pitch_rad: 0.0, pitch_rate_rad_s: 0.0, stance }
    }

    /// Four left turns of 100 deg, the feet alternating: the heading goes on to 400 deg, + on the left
    /// foot and − on the right; the yaw rate is mirrored alike. A new episode begins at zero.
    #[test]
    fn the_heading_goes_on_over_whole_turns_and_is_mirrored() {
        let mut meter = StrideMeter::new(&RobotDescription::default(), &JointTargets::default());
        meter.begin_episode(&heading(30.0, 0.0));
        for k in 1..=4 {
            let stance = if k % 2 == 0 { Side::Left } else { Side::Right };
            let now = heading(30.0 + 100.0 * f64::from(k), 0.1);
            let m = meter.measures(&now, Some(&standing_on(stance)));
            let sign = stance.lateral_sign();
            assert!((m.heading_deg - sign * 100.0 * f64::from(k)).abs() < 1e-9);
            assert!((m.turn_deg - 100.0).abs() < 1e-9);
            assert!((m.yaw_rate_deg_s - sign * 0.1_f64.to_degrees()).abs() < 1e-12);
            meter.begin_stride(&now);
        }
        meter.begin_episode(&heading(70.0, 0.0));
        let m = meter.measures(&heading(75.0, 0.0), Some(&standing_on(Side::Left)));
        assert!((m.heading_deg - 5.0).abs() < 1e-9);
    }
}
