//! In which ways the oscillator gait can be changed.

use crate::config::GaitConfig;
use crate::gait::Modulation;

// Positions in the list of modulations.
pub(crate) const STEP: usize = 0;
pub(crate) const WALK: usize = 1;
pub(crate) const ANKLE_ROLL_STEP: usize = 2;
pub(crate) const ROLL: usize = 3;
pub(crate) const PITCH: usize = 4;
pub(crate) const FREQUENCY: usize = 5;
pub(crate) const HIP_LEAN: usize = 6;
pub(crate) const ANKLE_LEAN: usize = 7;
pub(crate) const CROUCH: usize = 8;
pub(crate) const COUNT: usize = 9;

/// The modulations of a gait with this configuration, on a robot with ankle rolls or without.
pub(crate) fn modulations(config: &GaitConfig, ankle_rolls: bool) -> [Modulation; COUNT] {
    let ankle_roll_deg = if ankle_rolls { 20.0 } else { 0.0 };
    let m = |name, neutral, lower, upper, about| Modulation { name, neutral, lower, upper, about };
    [
        m("step_amplitude_deg", 0.0, -20.0, 20.0, "A_step: added to the pitch amplitude [MA09, eq. (26)]"),
        m(
            "walk_amplitude_deg",
            config.amplitude_deg.walk,
            -30.0,
            30.0,
            "A_walk: forward swing of hip and ankle [MA09, eq. (6)]",
        ),
        m(
            "ankle_roll_amplitude_deg",
            0.0,
            0.0 - ankle_roll_deg,
            ankle_roll_deg,
            "A_a_step: added to the ankle's roll amplitude [MA09, eq. (29)]; 0 without ankle rolls",
        ),
        m(
            "roll_amplitude_deg",
            config.amplitude_deg.hip_roll,
            0.0,
            30.0,
            "A_roll: roll amplitude of the hips; the ankles keep their difference to it",
        ),
        m(
            "pitch_amplitude_deg",
            config.amplitude_deg.pitch,
            0.0,
            30.0,
            "A_pitch: how high the feet are lifted [MA09, eq. (5)]",
        ),
        m(
            "natural_frequency_rad_s",
            config.natural_frequency_rad_s,
            0.1,
            50.0,
            "omega_c: natural frequency of the oscillators [MA09, eq. (2)]",
        ),
        m("hip_lean_deg", 0.0, -20.0, 20.0, "added to the hips' rest pitch; + leans the torso forward"),
        m("ankle_lean_deg", 0.0, -15.0, 15.0, "added to the ankles' rest pitch; + leans the whole body forward"),
        m("crouch_deg", 0.0, -30.0, 30.0, "added to hip and ankle, twice taken from the knee; - straightens the legs"),
    ]
}
