//! Components of the state at the section: lines of a task's `state`.

use stridemap_robot::RobotState;
use stridemap_section::Pendulum;

use crate::goal::GoalConfig;
use crate::motion::Recent;
use crate::registry::{Part, Registry, named};
use stridemap_record::StrideMeasures;

/// What there is to see where a stride ends.
pub struct AtSection<'a> {
    /// What was measured of the stride.
    pub measures: &'a StrideMeasures,
    /// The robot at its end.
    pub robot: &'a RobotState,
    /// The pendulum at the section, or the last one seen where the stride ended otherwise.
    pub pendulum: Option<&'a Pendulum>,
    /// What the task may ask for.
    pub goals: &'a [GoalConfig],
    /// What the stride was asked for, one number a component.
    pub goal: &'a [f64],
    /// What the last ticks before it showed.
    pub recent: &'a Recent,
}

/// A component of the state at the section.
pub struct StatePart {
    /// The name used in files, with its unit.
    pub name: &'static str,
    /// What it is, in a line.
    pub about: &'static str,
    /// Whether the robot walks alike whatever its value is: the map then learns its change alone.
    pub invariant: bool,
    /// Its value; lateral ones mirrored, so that steps of both legs are alike.
    pub of: fn(&AtSection<'_>) -> f64,
}

impl Part for StatePart {
    fn name(&self) -> &'static str {
        self.name
    }
    fn about(&self) -> &'static str {
        self.about
    }
}

named! {
    /// A component of the state, by name.
    StateComponent, StatePart, states
}

macro_rules! component {
    ($constant:ident, $name:literal, $about:literal, $invariant:literal, $field:ident) => {
        #[doc = $about]
        pub const $constant: Self = {
            static PART: StatePart =
                StatePart { name: $name, about: $about, invariant: $invariant, of: |at| at.measures.$field };
            Self(&PART)
        };
    };
}

macro_rules! recent {
    ($name:literal, $about:literal, $of:expr) => {{
        static PART: StatePart = StatePart {
            name: $name,
            about: $about,
            invariant: false,
            of: |at| {
                let of: fn(&Recent) -> f64 = $of;
                of(at.recent)
            },
        };
        &PART
    }};
}

impl StateComponent {
    component!(PSI_ROLL_DEG, "psi_roll_deg", "`ψ_roll`, deg, + when the mass is inside its foot", false, psi_roll_deg);
    component!(
        PSI_PITCH_DEG,
        "psi_pitch_deg",
        "`ψ_pitch`, deg, + when the mass is ahead of its foot",
        false,
        psi_pitch_deg
    );
    component!(PSI_PITCH_RATE_DEG_S, "psi_pitch_rate_deg_s", "rate of `ψ_pitch`, deg/s", false, psi_pitch_rate_deg_s);
    component!(
        YAW_RATE_DEG_S,
        "yaw_rate_deg_s",
        "yaw rate of the pelvis, deg/s, + towards the side of the stance leg",
        false,
        yaw_rate_deg_s
    );
    component!(
        HEADING_DEG,
        "heading_deg",
        "heading relative to the episode's first, deg, + towards the side of the stance leg",
        true,
        heading_deg
    );
    component!(
        GAIT_PHASE_DEG,
        "gait_phase_deg",
        "phase of the gait as the swing leg sees it, deg",
        false,
        gait_phase_deg
    );

    /// What the last ticks before the section show, for robots whose sensors are noisy: one stride is two steps, and
    /// nothing is mirrored.
    const RECENT: [&'static StatePart; 9] = [
        recent!("recent_roll_rad", "roll of the base, mean over 10 ticks, rad, + to the right", |r| r.attitude[0]),
        recent!("recent_pitch_rad", "pitch of the base, mean over 10 ticks, rad, + forward", |r| r.attitude[1]),
        recent!("recent_gyro_x_rad_s", "roll rate of the base, mean over 10 ticks, rad/s", |r| r.attitude[2]),
        recent!("recent_gyro_y_rad_s", "pitch rate of the base, mean over 10 ticks, rad/s", |r| r.attitude[3]),
        recent!("recent_gyro_z_rad_s", "yaw rate of the base, mean over 10 ticks, rad/s", |r| r.attitude[4]),
        recent!("recent_com_ahead_m", "centre of mass ahead of the stance foot, line through 15 ticks, m", |r| r.com_m
            [0]),
        recent!("recent_com_left_m", "centre of mass to the left of the stance foot, likewise, m", |r| r.com_m[1]),
        recent!("recent_forward_m_s", "speed of the base along its heading, slope over 25 ticks, m/s", |r| r.speed_m_s
            [0]),
        recent!("recent_lateral_m_s", "speed of the base to its left, likewise, m/s", |r| r.speed_m_s[1]),
    ];

    /// The name used in files, with its unit.
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.0.name
    }
}

/// The registry of components of the state.
#[must_use]
pub fn states() -> &'static Registry<StatePart> {
    static STATES: Registry<StatePart> = Registry::new(
        "state component",
        &[
            StateComponent::PSI_ROLL_DEG.0,
            StateComponent::PSI_PITCH_DEG.0,
            StateComponent::PSI_PITCH_RATE_DEG_S.0,
            StateComponent::YAW_RATE_DEG_S.0,
            StateComponent::HEADING_DEG.0,
            StateComponent::GAIT_PHASE_DEG.0,
            StateComponent::RECENT[0],
            StateComponent::RECENT[1],
            StateComponent::RECENT[2],
            StateComponent::RECENT[3],
            StateComponent::RECENT[4],
            StateComponent::RECENT[5],
            StateComponent::RECENT[6],
            StateComponent::RECENT[7],
            StateComponent::RECENT[8],
        ],
    );
    &STATES
}
