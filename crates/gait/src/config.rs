//! Which gait a task names, with the parameters of each.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::gait::GaitError;
use crate::phase::{PhaseConfig, PhaseSource};
use crate::policy::{ClockConfig, ModelConfig, PolicyConfig};
use crate::zmp::ZmpConfig;

/// Nominal amplitudes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AmplitudeConfig {
    /// `A_hroll`, degrees.
    pub hip_roll: f64,
    /// `A_aroll`, degrees.
    pub ankle_roll: f64,
    /// `A^pitch`, degrees.
    pub pitch: f64,
    /// `A_walk`, degrees; 0 steps in place.
    pub walk: f64,
}

/// When amplitudes grow from zero to full, `[begin, end]` in seconds after a reset.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RampConfig {
    /// Roll amplitudes.
    pub roll: [f64; 2],
    /// Pitch and walking amplitudes.
    pub pitch: [f64; 2],
}

/// Which gait, and the parameters of an [`OscillatorGait`](crate::OscillatorGait); defaults are Table 1 of \[MA09\], simulated stepping.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GaitConfig {
    /// Which gait; left out: the oscillators.
    #[serde(default = "oscillator", skip_serializing_if = "is_oscillator")]
    pub kind: String,
    /// Parameters of the gait by zero-moment points (`kind = "zmp"`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub zmp: Option<ZmpConfig>,
    /// Parameters of a gait of one's own, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub own: BTreeMap<String, f64>,
    /// For `kind = "onnx"`: a file with the tables `policy`, `clock` and `model`, which then stand here and in `robot`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub policy_file: Option<PathBuf>,
    /// For `kind = "onnx"`: the network, what it sees, what its answer means.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub policy: Option<PolicyConfig>,
    /// For `kind = "onnx"`: the phases that the network sees.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clock: Option<ClockConfig>,
    /// For `kind = "onnx"`: the robot on which the network was trained, where `robot` does not say it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<ModelConfig>,
    /// For `kind = "onnx"`: nominal command, speed forward and to the left (m/s) and yaw rate (rad/s).
    #[serde(default, skip_serializing_if = "is_still")]
    pub command: [f64; 3],
    /// `ω_c`, natural angular frequency of the oscillators.
    pub natural_frequency_rad_s: f64,
    /// `K_c`, coupling to the robot's phase.
    pub coupling_rad_s: f64,
    /// Seconds after a reset before the coupling acts.
    pub coupling_delay_s: f64,
    /// Nominal amplitudes, degrees.
    pub amplitude_deg: AmplitudeConfig,
    /// When amplitudes grow from zero to full.
    pub ramp_s: RampConfig,
    /// How the robot's phase is detected.
    pub phase: PhaseConfig,
}

fn oscillator() -> String {
    "oscillator".into()
}

fn is_oscillator(kind: &str) -> bool {
    kind == "oscillator"
}

fn is_still(command: &[f64; 3]) -> bool {
    command.iter().all(|c| c.to_bits() == 0)
}

impl Default for GaitConfig {
    fn default() -> Self {
        Self {
            kind: oscillator(),
            zmp: None,
            own: BTreeMap::new(),
            policy_file: None,
            policy: None,
            clock: None,
            model: None,
            command: [0.0; 3],
            natural_frequency_rad_s: 3.5,
            coupling_rad_s: 10.0,
            coupling_delay_s: 0.0,
            amplitude_deg: AmplitudeConfig { hip_roll: 4.0, ankle_roll: 4.0, pitch: 6.0, walk: 0.0 },
            ramp_s: RampConfig { roll: [0.0, 1.0], pitch: [1.0, 4.0] },
            phase: PhaseConfig {
                source: PhaseSource::CentreOfPressure,
                position_filter_s: 0.05,
                velocity_filter_s: 0.03,
                half_stance_m: 0.09,
            },
        }
    }
}

impl GaitConfig {
    /// Checks every value.
    ///
    /// # Errors
    ///
    /// [`GaitError::Parameter`] that names the key at fault.
    pub fn validate(&self) -> Result<(), GaitError> {
        let within = |name, value: f64, range: std::ops::RangeInclusive<f64>, requirement| {
            if value.is_finite() && range.contains(&value) {
                Ok(())
            } else {
                Err(GaitError::Parameter { name, value, requirement })
            }
        };
        within("natural_frequency_rad_s", self.natural_frequency_rad_s, 0.1..=50.0, "must be 0.1 to 50 rad/s")?;
        within("coupling_rad_s", self.coupling_rad_s, 0.0..=200.0, "must be 0 to 200 rad/s")?;
        within("coupling_delay_s", self.coupling_delay_s, 0.0..=60.0, "must be 0 to 60 s")?;
        let a = self.amplitude_deg;
        for (name, value) in [
            ("amplitude_deg.hip_roll", a.hip_roll),
            ("amplitude_deg.ankle_roll", a.ankle_roll),
            ("amplitude_deg.pitch", a.pitch),
        ] {
            within(name, value, 0.0..=30.0, "must be 0 to 30 deg")?;
        }
        within("amplitude_deg.walk", a.walk, -30.0..=30.0, "must be -30 to 30 deg")?;
        for (name, [begin, end]) in [("ramp_s.roll", self.ramp_s.roll), ("ramp_s.pitch", self.ramp_s.pitch)] {
            within(name, begin, 0.0..=60.0, "must begin at 0 to 60 s")?;
            within(name, end, begin..=60.0, "must end after it begins, within 60 s")?;
        }
        self.phase.validate()
    }
}
