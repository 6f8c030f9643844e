//! Footsteps straight ahead: where feet are and will be, and the zero-moment points that follow from them.

use std::f64::consts::PI;
use stridemap_robot::Side;

use super::ZmpConfig;

/// What is asked of the next steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Step {
    pub length_m: f64,
    pub time_s: f64,
    /// The zero-moment point outwards from the middle of the foot.
    pub outwards_m: f64,
    /// Feedback on the foot that lands next.
    pub moved_m: [f64; 2],
}

/// The present step, and what follows from it. Places are those of the soles' middles in the plan's axes: x forward, y
/// left.
#[derive(Clone, Debug)]
pub(super) struct Footsteps {
    half_width_m: f64,
    feet: [[f64; 2]; 2],
    /// Where the foot in the air left the floor, and where it lands.
    from: [f64; 2],
    to: [f64; 2],
    /// The leg that bears; `None` while it stands.
    stance: Option<Side>,
    /// The zero-moment point at the end of the step before.
    last_zmp: [f64; 2],
    step: Step,
    left_s: f64,
    elapsed_s: f64,
}

impl Footsteps {
    /// Standing at the origin until the first step.
    pub fn standing(config: &ZmpConfig) -> Self {
        let feet = Side::BOTH.map(|side| [0.0, side.lateral_sign() * config.stance_half_width_m]);
        let step = Step {
            length_m: config.step_length_m,
            time_s: config.step_time_s,
            outwards_m: config.zmp_offset_m,
            moved_m: [0.0; 2],
        };
        Self {
            half_width_m: config.stance_half_width_m,
            feet,
            from: feet[0],
            to: feet[0],
            stance: None,
            last_zmp: [0.0; 2],
            step,
            left_s: config.stand_s,
            elapsed_s: 0.0,
        }
    }

    /// The leg that bears.
    pub fn stance(&self) -> Option<Side> {
        self.stance
    }

    /// Middle of a foot on the floor.
    pub fn foot_m(&self, side: Side) -> [f64; 2] {
        self.feet[side.index()]
    }

    /// The zero-moment point of a foot that bears.
    fn under(&self, side: Side, foot: [f64; 2]) -> [f64; 2] {
        [foot[0], foot[1] + side.lateral_sign() * self.step.outwards_m]
    }

    /// Where a foot lands that follows one on the other side.
    fn landing(&self, side: Side, other: [f64; 2]) -> [f64; 2] {
        [other[0] + self.step.length_m, side.lateral_sign() * self.half_width_m]
    }

    /// Goes on by a planning period; a step that begins takes what is asked.
    pub fn advance(&mut self, period_s: f64, asked: &Step) {
        self.elapsed_s += period_s;
        self.left_s -= period_s;
        if let Some(stance) = self.stance {
            // The foot in the air follows the feedback until it is half way down.
            if self.elapsed_s < 0.75 * self.step.time_s {
                let landing = self.landing(stance.other(), self.foot_m(stance));
                self.to = [landing[0] + asked.moved_m[0], landing[1] + asked.moved_m[1]];
            }
        }
        if self.left_s > 1e-9 {
            return;
        }
        let next = match self.stance {
            None => Side::Left,
            Some(stance) => {
                self.last_zmp = self.under(stance, self.foot_m(stance));
                self.feet[stance.other().index()] = self.to;
                stance.other()
            }
        };
        self.stance = Some(next);
        self.step = *asked;
        (self.left_s, self.elapsed_s) = (self.step.time_s, 0.0);
        self.from = self.foot_m(next.other());
        self.to = self.landing(next.other(), self.foot_m(next));
    }

    /// The zero-moment point some time ahead: over the first share of a step from one foot to the next.
    pub fn zmp_m(&self, ahead_s: f64, double_support: f64) -> [f64; 2] {
        let mut left = ahead_s - self.left_s;
        let (mut before, mut side, mut foot, mut elapsed) = match self.stance {
            None if left < 0.0 => return self.last_zmp,
            None => (self.last_zmp, Side::Left, self.foot_m(Side::Left), left),
            Some(side) => (self.last_zmp, side, self.foot_m(side), self.elapsed_s + ahead_s),
        };
        if self.stance.is_some() && left >= 0.0 {
            before = self.under(side, foot);
            side = side.other();
            foot = self.to;
            elapsed = left;
        }
        while left >= self.step.time_s {
            left -= self.step.time_s;
            before = self.under(side, foot);
            foot = self.landing(side.other(), foot);
            side = side.other();
            elapsed = left;
        }
        let now = self.under(side, foot);
        let share = (elapsed / (double_support * self.step.time_s)).clamp(0.0, 1.0);
        [0, 1].map(|i| before[i] + share * (now[i] - before[i]))
    }

    /// Where the middle of a sole is meant to be, some time after the planning period: x, y, height.
    pub fn swing_m(&self, side: Side, since_plan_s: f64, lift_m: f64, double_support: f64) -> [f64; 3] {
        let [x, y] = self.foot_m(side);
        if self.stance.is_none() || self.stance == Some(side) {
            return [x, y, 0.0];
        }
        let on_both_s = double_support * self.step.time_s;
        let s = ((self.elapsed_s + since_plan_s - on_both_s) / (self.step.time_s - on_both_s)).clamp(0.0, 1.0);
        let way = s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
        let along = |i: usize| self.from[i] + way * (self.to[i] - self.from[i]);
        [along(0), along(1), 16.0 * lift_m * (s * (1.0 - s)).powi(2)]
    }

    /// Half a turn a step: from zero when the leg begins to bear.
    pub fn phase_rad(&self, leg: Side) -> Option<f64> {
        let stance = self.stance?;
        let of_step = PI * (self.elapsed_s / self.step.time_s).min(1.0);
        Some(if stance == leg { of_step } else { of_step - PI })
    }
}
