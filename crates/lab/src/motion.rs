//! How the base of a robot moves: means over a stride, and what the last ticks before a section show.

use std::collections::VecDeque;

use stridemap_record::Motion;
use stridemap_robot::kinematics::{inverse, rotate};
use stridemap_robot::{RobotState, Side};

use crate::measure::wrapped_rad;

/// Ticks over which attitude and rates are averaged.
const ATTITUDE_TICKS: usize = 10;
/// Ticks through which a line gives the place of the centre of mass.
const PLACE_TICKS: usize = 15;
/// Ticks over which the slope of the path is taken.
const PATH_TICKS: usize = 25;

/// Roll (+ to the right) and pitch (+ forward) of a base, from where gravity points in its axes.
pub(crate) fn roll_pitch(state: &RobotState) -> [f64; 2] {
    let [x, y, z] = rotate(inverse(state.base.orientation), [0.0, 0.0, -1.0]);
    [(-y).atan2(-z), x.atan2(-z)]
}

/// Means over a stride of one view of the robot.
#[derive(Clone, Copy, Debug, Default)]
struct Track {
    last: Option<([f64; 2], f64)>,
    elapsed_s: f64,
    /// Ways along and across the heading, turn, and integrals of roll, pitch and power.
    sums: [f64; 6],
}

impl Track {
    fn begin(&mut self) {
        *self = Self { last: self.last, ..Self::default() };
    }

    fn tick(&mut self, state: &RobotState, dt_s: f64) {
        let ([x, y, _], heading) = (state.base.position_m, state.base.heading_rad());
        let ([x0, y0], heading0) = self.last.replace(([x, y], heading)).unwrap_or(([x, y], heading));
        let turn = wrapped_rad(heading - heading0);
        let (sin, cos) = (heading0 + 0.5 * turn).sin_cos();
        let [roll, pitch] = roll_pitch(state);
        let power_w: f64 = state.joints.iter().map(|j| (j.torque_nm * j.velocity_rad_s).abs()).sum();
        let (dx, dy) = (x - x0, y - y0);
        let now = [cos * dx + sin * dy, cos * dy - sin * dx, turn, roll * dt_s, pitch * dt_s, power_w * dt_s];
        self.sums.iter_mut().zip(now).for_each(|(sum, now)| *sum += now);
        self.elapsed_s += dt_s;
    }

    fn motion(&self) -> Motion {
        let over = if self.elapsed_s > 0.0 { 1.0 / self.elapsed_s } else { 0.0 };
        Motion::of(self.sums.map(|sum| sum * over))
    }
}

/// What one tick shows.
#[derive(Clone, Copy, Debug)]
struct Look {
    time_s: f64,
    attitude: [f64; 5],
    /// Place of the base in the world, and its heading.
    base_m: [f64; 2],
    heading_rad: f64,
    /// Centre of mass from either foot, in the world.
    com_m: [[f64; 2]; 2],
}

/// What the last ticks before a section show of a robot whose sensors are noisy.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Recent {
    /// Roll, pitch (rad) and angular velocity (rad/s, in the base's axes), means over ten ticks.
    pub attitude: [f64; 5],
    /// Centre of mass ahead and to the left of the stance foot, along the heading: the end of a line through fifteen ticks.
    pub com_m: [f64; 2],
    /// Speed of the base along the heading and to its left: the slope of its path over twenty-five ticks.
    pub speed_m_s: [f64; 2],
}

/// Follows the base through a stride, as it is measured and as it truly is.
#[derive(Clone, Debug, Default)]
pub(crate) struct MotionMeter {
    measured: Track,
    truth: Track,
    looks: VecDeque<Look>,
    recent: Recent,
}

impl MotionMeter {
    /// A robot starts anew.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// A stride begins.
    pub fn begin_stride(&mut self) {
        self.measured.begin();
        self.truth.begin();
    }

    /// One control tick.
    pub fn tick(&mut self, state: &RobotState, truth: Option<&RobotState>, dt_s: f64) {
        self.measured.tick(state, dt_s);
        if let Some(truth) = truth {
            self.truth.tick(truth, dt_s);
        }
        let [roll, pitch] = roll_pitch(state);
        let [wx, wy, wz] = state.base.angular_velocity_rad_s;
        let [x, y, _] = state.base.position_m;
        let com = state.com.position_m;
        self.looks.push_back(Look {
            time_s: state.time_s,
            attitude: [roll, pitch, wx, wy, wz],
            base_m: [x, y],
            heading_rad: state.base.heading_rad(),
            com_m: state.feet.map(|foot| [com[0] - foot.centre_m[0], com[1] - foot.centre_m[1]]),
        });
        if self.looks.len() > PATH_TICKS {
            self.looks.pop_front();
        }
    }

    /// Measured and true motion of the stride so far.
    pub fn motion(&self) -> (Motion, Motion) {
        let measured = self.measured.motion();
        (measured, if self.truth.elapsed_s > 0.0 { self.truth.motion() } else { measured })
    }

    /// A section was reached: what its last ticks show, from the leg that the robot stands on.
    pub fn section(&mut self, stance: Option<Side>) {
        let Some(now) = self.looks.back() else { return };
        let (sin, cos) = now.heading_rad.sin_cos();
        let ahead_left = |[x, y]: [f64; 2]| [cos * x + sin * y, cos * y - sin * x];
        let newest = |count: usize| self.looks.iter().rev().take(count);
        let few = self.looks.len().min(ATTITUDE_TICKS) as f64;
        let attitude = [0, 1, 2, 3, 4].map(|i| newest(ATTITUDE_TICKS).map(|l| l.attitude[i]).sum::<f64>() / few);
        let foot = stance.unwrap_or(Side::Left).index();
        let line = |count: usize, of: &dyn Fn(&Look) -> f64| {
            line(newest(count).map(|look| (look.time_s - now.time_s, of(look))))
        };
        let com = [0, 1].map(|k| line(PLACE_TICKS, &|look| look.com_m[foot][k])[0]);
        let speed = [0, 1].map(|k| line(PATH_TICKS, &|look| look.base_m[k])[1]);
        self.recent = Recent { attitude, com_m: ahead_left(com), speed_m_s: ahead_left(speed) };
    }

    /// What the last ticks before the last section showed.
    pub const fn recent(&self) -> &Recent {
        &self.recent
    }
}

/// Value at zero and slope of the least-squares line through points.
fn line(points: impl Iterator<Item = (f64, f64)> + Clone) -> [f64; 2] {
    let n = points.clone().count().max(1) as f64;
    let sum = |of: &dyn Fn((f64, f64)) -> f64| points.clone().map(of).sum::<f64>();
    let (x, y) = (sum(&|p| p.0) / n, sum(&|p| p.1) / n);
    let spread = sum(&|p| (p.0 - x).powi(2));
    let slope = if spread > 0.0 { sum(&|p| (p.0 - x) * (p.1 - y)) / spread } else { 0.0 };
    [y - slope * x, slope]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A base that drives a circle: 0.5 m/s along its heading, 0.1 m/s to its left, 0.4 rad/s, leaning by (0.02, 0.05).
    fn at(t: f64) -> RobotState {
        let heading = 0.4 * t;
        let half = |angle: f64| ((0.5 * angle).cos(), (0.5 * angle).sin());
        let ((cy, sy), (cp, sp), (cr, sr)) = (half(heading), half(0.05), half(0.02));
        let orientation = [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ];
        // The integral of the turned velocity.
        let (sin, cos) = heading.sin_cos();
        let x = (0.5 * sin - 0.1 * (1.0 - cos)) / 0.4;
        let y = (0.5 * (1.0 - cos) + 0.1 * sin) / 0.4;
        let mut state = RobotState { time_s: t, ..RobotState::default() };
        state.base.position_m = [x, y, 0.7];
        state.base.orientation = orientation;
        state.base.angular_velocity_rad_s = [0.0, 0.0, 0.4];
        state.com.position_m = [x + 0.03 * cos - 0.01 * sin, y + 0.03 * sin + 0.01 * cos, 0.7];
        state.feet = state.feet.map(|foot| stridemap_robot::FootState { centre_m: [x, y, 0.0], ..foot });
        state
    }

    #[test]
    fn a_circle_has_the_speeds_with_which_it_is_driven() {
        let mut meter = MotionMeter::default();
        meter.tick(&at(0.0), None, 0.02);
        meter.begin_stride();
        for k in 1..=50 {
            meter.tick(&at(0.02 * f64::from(k)), None, 0.02);
        }
        meter.section(Some(Side::Left));
        let (motion, truth) = meter.motion();
        assert_eq!(motion, truth);
        for (found, expected) in motion.values().iter().zip([0.5, 0.1, 0.4, 0.02, 0.05, 0.0]) {
            assert!((found - expected).abs() < 1e-4, "{motion:?}");
        }
        let recent = meter.recent();
        assert!((recent.com_m[0] - 0.03).abs() < 1e-3 && (recent.com_m[1] - 0.01).abs() < 1e-3, "{recent:?}");
        // The chord of the last half second lags half of its turn behind the heading.
        assert!((recent.speed_m_s[0].hypot(recent.speed_m_s[1]) - 0.26_f64.sqrt()).abs() < 1e-2);
        assert!((recent.attitude[1] - 0.05).abs() < 1e-4 && (recent.attitude[4] - 0.4).abs() < 1e-12);
    }
}
