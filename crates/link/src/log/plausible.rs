//! Rates and angles of a log that contradict each other: another unit, sign or order than the link says.

use stridemap_robot::kinematics::{inverse, product, rotation_vector};
use stridemap_robot::{Ros2Config, SensorFrame};

use super::LoggedEpisode;

/// Readings over which rates are summed up: noise of angles then counts little.
const SPAN: usize = 10;
/// Less change than this, root mean square over a span, is noise.
const MOVES_RAD: f64 = 0.005;
/// Rates that are too large or too small by more than this factor are in another unit.
const FACTOR: f64 = 4.0;
/// Rates and changes that go together less than this are of other axes, joints or signs.
const TOGETHER: f64 = 0.3;

/// Sums of what rates say of the changes of angles, and of the changes.
#[derive(Default)]
struct Compared {
    spans: f64,
    rates: f64,
    changes: f64,
    both: f64,
}

impl Compared {
    fn add(&mut self, by_rates_rad: f64, change_rad: f64) {
        self.spans += 1.0;
        self.rates += by_rates_rad * by_rates_rad;
        self.changes += change_rad * change_rad;
        self.both += by_rates_rad * change_rad;
    }

    /// What is wrong with the rates, if anything is: how they differ, and where that comes from.
    fn fault(&self) -> Option<String> {
        /// What rates in another unit are too large by.
        const UNITS: [(f64, &str); 4] = [
            (180.0 / std::f64::consts::PI, "deg/s instead of rad/s"),
            (30.0 / std::f64::consts::PI, "turns a minute instead of rad/s"),
            (1e3, "thousandths of a rad/s"),
            (std::f64::consts::PI / 180.0, "rad/s while link.angle_unit says degrees"),
        ];
        // Rates of 0 are not measured.
        if self.changes < self.spans * MOVES_RAD * MOVES_RAD || self.rates <= 0.0 {
            return None;
        }
        let ratio = (self.rates / self.changes).sqrt();
        let together = self.both / (self.rates * self.changes).sqrt();
        if together < TOGETHER {
            let why = if together < -TOGETHER { "opposite to" } else { "unlike" };
            return Some(format!(
                "{why} the changes of the angles (correlation {together:.2}): another sign or order?"
            ));
        }
        (!(1.0 / FACTOR..=FACTOR).contains(&ratio)).then(|| {
            let unit = UNITS.iter().find(|(factor, _)| (ratio / factor).ln().abs() < 0.25_f64.ln_1p());
            let unit = unit.map_or("another unit", |(_, unit)| unit);
            format!("{ratio:.3} times the changes of the angles: {unit}?")
        })
    }
}

/// What contradicts itself in readings.
pub(super) fn contradiction(episodes: &[LoggedEpisode], link: &Ros2Config) -> Option<String> {
    let (mut joints, mut turn) = (Compared::default(), Compared::default());
    for window in episodes.iter().flat_map(|e| e.frames.windows(SPAN + 1).step_by(SPAN)) {
        let (first, last) = (&window[0], &window[SPAN]);
        let sum = |rate: &dyn Fn(&SensorFrame) -> f64| -> f64 {
            let steps = window.windows(2);
            steps.map(|w| 0.5 * (w[1].time_s - w[0].time_s) * (rate(&w[0]) + rate(&w[1]))).sum()
        };
        for (at, (before, after)) in first.joints.iter().zip(&last.joints).enumerate() {
            let by_rates = sum(&|f| f.joints.get(at).map_or(0.0, |j| j.velocity_rad_s));
            joints.add(by_rates, after.position_rad - before.position_rad);
        }
        let turned = rotation_vector(product(inverse(first.orientation), last.orientation));
        for (axis, change) in turned.into_iter().enumerate() {
            turn.add(sum(&|f| f.angular_velocity_rad_s[axis]), change);
        }
    }
    let (told, imu) = (&link.joint_states, &link.imu);
    if let Some(fault) = joints.fault() {
        return Some(format!("the joints' velocities on {told} are {fault}"));
    }
    let fault = turn.fault()?;
    Some(format!("the angular velocity on {imu} is {fault}"))
}
