//! A gait by zero-moment points: footsteps, preview control of the centre of mass, inverse kinematics, and a stabiliser
//! on the divergent component of motion (MA09, sec. 8.2, names such a controller as the next to be improved).

mod leg;
mod preview;
mod steps;

pub use leg::LegLengths;
pub use preview::{Preview, PreviewAxis};

use serde::{Deserialize, Serialize};
use stridemap_robot::{JointTargets, LegJoint, LegRole, RobotDescription, RobotState, Side};

use crate::gait::{Gait, GaitError, Modulation};
use preview::GRAVITY_M_S2;
use steps::{Footsteps, Step};

/// Parameters of a [`ZmpGait`]: the robot's lengths, and the nominal step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ZmpConfig {
    /// Hip to knee.
    pub thigh_m: f64,
    /// Knee to ankle.
    pub shank_m: f64,
    /// Half the distance between the hips.
    pub hip_half_width_m: f64,
    /// Half the distance between the feet's tracks.
    pub stance_half_width_m: f64,
    /// Height of the centre of mass over the floor.
    pub com_height_m: f64,
    /// How far ahead of the hips the centre of mass is.
    pub com_ahead_m: f64,
    /// How far ahead of the ankles the feet's middle is.
    pub sole_ahead_m: f64,
    /// Way forward of a step in the nominal gait.
    pub step_length_m: f64,
    /// Time of a step.
    pub step_time_s: f64,
    /// Height of the hips over the ankles.
    pub hip_height_m: f64,
    /// How high a foot is lifted.
    pub lift_m: f64,
    /// Share of a step on both feet, above 0, below 1.
    pub double_support: f64,
    /// How far the zero-moment point is led outwards from the middle of the foot; + outwards.
    pub zmp_offset_m: f64,
    /// Of the ankles of the stance leg, per metre of error of the divergent component: rad/m.
    pub ankle_gain_rad_m: f64,
    /// Of the next footstep, per metre of that error.
    pub step_gain: f64,
    /// Standing still after a start, before the first step.
    pub stand_s: f64,
}

impl ZmpConfig {
    fn validate(&self) -> Result<(), GaitError> {
        let within = |name, value: f64, range: std::ops::RangeInclusive<f64>, requirement| {
            if value.is_finite() && range.contains(&value) {
                Ok(())
            } else {
                Err(GaitError::Parameter { name, value, requirement })
            }
        };
        for (name, value) in [
            ("zmp.thigh_m", self.thigh_m),
            ("zmp.shank_m", self.shank_m),
            ("zmp.hip_half_width_m", self.hip_half_width_m),
            ("zmp.stance_half_width_m", self.stance_half_width_m),
            ("zmp.com_height_m", self.com_height_m),
            ("zmp.hip_height_m", self.hip_height_m),
        ] {
            within(name, value, 0.005..=2.0, "must be 0.005 to 2 m")?;
        }
        within("zmp.com_ahead_m", self.com_ahead_m, -0.5..=0.5, "must be -0.5 to 0.5 m")?;
        within("zmp.sole_ahead_m", self.sole_ahead_m, -0.5..=0.5, "must be -0.5 to 0.5 m")?;
        within("zmp.double_support", self.double_support, 0.01..=0.9, "must be 0.01 to 0.9")?;
        within("zmp.stand_s", self.stand_s, 0.5..=60.0, "must be 0.5 to 60 s")?;
        within("zmp.lift_m", self.lift_m, 0.0..=0.3, "must be 0 to 0.3 m")
    }
}

// Positions in the list of modulations.
const LENGTH: usize = 0;
const TIME: usize = 1;
const HEIGHT: usize = 2;
const OFFSET: usize = 3;
const ANKLE: usize = 4;
const STEP: usize = 5;
const LIFT: usize = 6;
const COUNT: usize = 7;

/// The modulations of a gait with this configuration.
fn modulations(c: &ZmpConfig) -> [Modulation; COUNT] {
    let m = |name, neutral, lower, upper, about| Modulation { name, neutral, lower, upper, about };
    let leg_m = c.thigh_m + c.shank_m;
    [
        m("step_length_m", c.step_length_m, -leg_m, leg_m, "way forward of a step"),
        m("step_time_s", c.step_time_s, 0.1, 3.0, "time of a step"),
        m("hip_height_m", c.hip_height_m, 0.3 * leg_m, leg_m, "height of the hips over the ankles"),
        m("zmp_offset_m", c.zmp_offset_m, -0.1, 0.1, "zero-moment point outwards from the middle of the foot"),
        m("ankle_gain_rad_m", c.ankle_gain_rad_m, -5.0, 5.0, "stance ankle per metre of DCM error"),
        m("step_gain", c.step_gain, -3.0, 3.0, "next footstep per metre of DCM error"),
        m("lift_m", c.lift_m, 0.0, 0.3, "how high a foot is lifted"),
    ]
}

/// Footsteps straight ahead, the centre of mass by [`Preview`] control over them, joint angles by [`LegLengths`], and
/// feedback of the divergent component of motion `ξ = x + ẋ / ω`, measured from the stance foot, against the plan's:
///
/// ```text
/// stance ankle ← −k_a (ξ − ξ_plan)      moves the pressure towards where the mass escapes
/// next step    ← +k_s (ξ − ξ_plan)      the capture point's way                        [Pratt06; Englsberger15]
/// ```
///
/// It walks by its own clock; modulations act from the next planning period on, those of the step from the next step.
///
/// # References
///
/// - \[Kajita03\] S. Kajita et al., *Biped walking pattern generation by using preview control of zero-moment point*,
///   ICRA 2003.
/// - \[Pratt06\] J. Pratt et al., *Capture point: a step toward humanoid push recovery*, Humanoids 2006.
/// - \[Englsberger15\] J. Englsberger, C. Ott and A. Albu-Schäffer, *Three-dimensional bipedal walking control based on
///   divergent component of motion*, IEEE Transactions on Robotics 31(2), 2015.
#[derive(Clone, Debug)]
pub struct ZmpGait {
    config: ZmpConfig,
    rest: JointTargets,
    rest_height_m: f64,
    legs: Vec<(Side, LegJoint, LegRole)>,
    modulations: [Modulation; COUNT],
    values: [f64; COUNT],
    preview: Preview,
    axes: [PreviewAxis; 2],
    before: [f64; 2],
    steps: Footsteps,
    height_m: f64,
    /// Time since the last planning period, and since the reset.
    since_plan_s: f64,
    time_s: f64,
    error_m: [f64; 2],
}

impl ZmpGait {
    /// Planning period, of \[Kajita03\] twice.
    const PERIOD_S: f64 = 0.01;
    /// How far the preview looks.
    const FUTURE_S: f64 = 1.6;
    /// Time constant with which the hips go to their height.
    const HEIGHT_S: f64 = 0.3;
    /// Time constant of the filter on the error of the divergent component.
    const ERROR_S: f64 = 0.02;
    /// Largest error that is fed back.
    const LARGEST_ERROR_M: f64 = 0.08;

    /// A gait for a robot, which starts from the robot's rest posture.
    ///
    /// # Errors
    ///
    /// [`GaitError::Parameter`] for a configuration outside its domain; [`GaitError::NoJoint`] for a robot that lacks
    /// a joint other than a hip yaw.
    pub fn new(config: ZmpConfig, robot: &RobotDescription) -> Result<Self, GaitError> {
        config.validate()?;
        let mut needed = robot.legs.iter().filter(|(_, j, _)| *j != LegJoint::HipYaw);
        if let Some((side, joint, _)) = needed.find(|(.., role)| role.is_none()) {
            let (side, joint) = (side.name(), joint.name());
            return Err(GaitError::NoJoint { side, joint });
        }
        let modulations = modulations(&config);
        let rest_rad = |joint: LegJoint| {
            let role = robot.legs[(Side::Left, joint)];
            role.and_then(|r| Some(r.sign * robot.joints.get(r.joint)?.rest_rad)).unwrap_or(0.0)
        };
        let thigh_rad = rest_rad(LegJoint::HipPitch);
        let shank_rad = thigh_rad + rest_rad(LegJoint::Knee);
        let mut gait = Self {
            rest: robot.rest(),
            rest_height_m: config.thigh_m * thigh_rad.cos() + config.shank_m * shank_rad.cos(),
            legs: robot.legs.roles().collect(),
            values: std::array::from_fn(|i| modulations[i].neutral),
            modulations,
            preview: Preview::new(config.com_height_m, Self::PERIOD_S, Self::FUTURE_S),
            axes: [PreviewAxis::default(); 2],
            before: [0.0; 2],
            steps: Footsteps::standing(&config),
            height_m: 0.0,
            since_plan_s: 0.0,
            time_s: 0.0,
            error_m: [0.0; 2],
            config,
        };
        gait.reset();
        Ok(gait)
    }

    /// One planning period.
    fn plan(&mut self) {
        let v = &self.values;
        let step = Step {
            length_m: v[LENGTH],
            time_s: v[TIME],
            outwards_m: v[OFFSET],
            moved_m: self.error_m.map(|e| v[STEP] * e),
        };
        self.steps.advance(Self::PERIOD_S, &step);
        self.before = self.axes.map(|axis| axis.position_m());
        let samples = self.preview.samples();
        let ahead: Vec<[f64; 2]> =
            (0..=samples).map(|j| self.steps.zmp_m(j as f64 * Self::PERIOD_S, self.config.double_support)).collect();
        for (i, axis) in self.axes.iter_mut().enumerate() {
            let ahead: Vec<f64> = ahead.iter().map(|p| p[i]).collect();
            self.preview.advance(axis, &ahead);
        }
        let share = Self::PERIOD_S / Self::HEIGHT_S;
        self.height_m += share * (v[HEIGHT] - self.height_m);
    }

    /// Error of the divergent component, seen from the stance foot in axes of the pelvis' heading: measured less planned.
    fn measure(&mut self, state: &RobotState, dt_s: f64) {
        let Some(stance) = self.steps.stance() else { return };
        let foot = state.foot(stance).centre_m;
        let fall_s = (self.config.com_height_m / GRAVITY_M_S2).sqrt();
        let (com, rate) = (state.com.position_m, state.com.velocity_m_s);
        let there = [0, 1].map(|i| com[i] + fall_s * rate[i] - foot[i]);
        let (sin, cos) = state.base.heading_rad().sin_cos();
        let seen = [cos * there[0] + sin * there[1], cos * there[1] - sin * there[0]];
        let planned = self.steps.foot_m(stance);
        for i in 0..2 {
            let error = seen[i] - (self.axes[i].divergent_m(self.config.com_height_m) - planned[i]);
            let error = error.clamp(-Self::LARGEST_ERROR_M, Self::LARGEST_ERROR_M);
            self.error_m[i] += dt_s / (Self::ERROR_S + dt_s) * (error - self.error_m[i]);
        }
    }

    /// Angles of a leg now, with the stance ankle's feedback.
    fn leg_rad(&self, side: Side) -> [f64; 6] {
        let share = self.since_plan_s / Self::PERIOD_S;
        let com: [f64; 2] =
            std::array::from_fn(|i| self.before[i] + share * (self.axes[i].position_m() - self.before[i]));
        let c = &self.config;
        let foot = self.steps.swing_m(side, self.since_plan_s, self.values[LIFT], c.double_support);
        let hip = [com[0] - c.com_ahead_m, com[1] + side.lateral_sign() * c.hip_half_width_m];
        let ankle = [foot[0] - c.sole_ahead_m - hip[0], foot[1] - hip[1], foot[2] - self.height_m];
        let leg = LegLengths { thigh_m: c.thigh_m, shank_m: c.shank_m };
        let mut angles = leg.angles_rad(ankle, 0.0);
        if self.steps.stance() == Some(side) {
            angles[LegJoint::AnklePitch.index()] -= self.values[ANKLE] * self.error_m[0];
            angles[LegJoint::AnkleRoll.index()] -= self.values[ANKLE] * self.error_m[1];
        }
        angles
    }
}

impl Gait for ZmpGait {
    fn modulations(&self) -> &[Modulation] {
        &self.modulations
    }

    fn rest(&self) -> &JointTargets {
        &self.rest
    }

    fn reset(&mut self) {
        self.values = std::array::from_fn(|i| self.modulations[i].neutral);
        self.axes = [PreviewAxis::default(); 2];
        self.before = [0.0; 2];
        self.steps = Footsteps::standing(&self.config);
        self.height_m = self.rest_height_m;
        (self.since_plan_s, self.time_s, self.error_m) = (0.0, 0.0, [0.0; 2]);
    }

    fn modulate(&mut self, index: usize, value: f64) -> Result<(), GaitError> {
        let m = self.modulations.get(index).ok_or(GaitError::NoSuchModulation { index, count: COUNT })?;
        if !(m.lower..=m.upper).contains(&value) {
            return Err(GaitError::ModulationOutOfRange { name: m.name, value, lower: m.lower, upper: m.upper });
        }
        self.values[index] = value;
        Ok(())
    }

    fn targets(&mut self, state: &RobotState, dt_s: f64, out: &mut JointTargets) {
        self.measure(state, dt_s);
        self.time_s += dt_s;
        self.since_plan_s += dt_s;
        while self.since_plan_s >= Self::PERIOD_S - 1e-9 {
            self.since_plan_s = (self.since_plan_s - Self::PERIOD_S).max(0.0);
            self.plan();
        }
        out.joints.clone_from(&self.rest.joints);
        // From the rest posture into the plan's while it stands.
        let share = (2.0 * self.time_s / self.config.stand_s).min(1.0);
        let angles = Side::BOTH.map(|side| self.leg_rad(side));
        for &(side, joint, LegRole { joint: at, sign }) in &self.legs {
            if let Some(command) = out.joints.get_mut(at) {
                let wanted = sign * angles[side.index()][joint.index()];
                command.position_rad += share * (wanted - command.position_rad);
            }
        }
    }

    fn start_up_s(&self) -> f64 {
        self.config.stand_s + 4.0 * self.config.step_time_s
    }

    /// Half a turn a step, by the clock: zero for a leg when its foot begins to bear.
    fn phase_rad(&self, leg: Side) -> Option<f64> {
        self.steps.phase_rad(leg)
    }
}

#[cfg(test)]
mod tests;
