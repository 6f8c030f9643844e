//! A learned map as a file.

use serde::{Deserialize, Serialize};
use stridemap_gp::{Card, Fitted, GpError, Warning};

use stridemap_process::ProcessSpec;

use crate::map_config::MapConfig;

/// The version of the map files that this crate writes and reads.
pub(crate) const FORMAT: u32 = 1;

/// A learned map as a file: the Gaussian processes with their data, and how far each can be trusted.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SavedMap {
    /// Version of this format.
    pub format: u32,
    /// Iteration of Algorithm 1, from 1.
    pub iteration: usize,
    /// How it was fitted and is drawn from.
    pub config: MapConfig,
    /// Names and bounds.
    pub spec: ProcessSpec,
    /// Strides that it was fitted to.
    pub samples: usize,
    /// One per component of the next state, and the reward's last where it has its own.
    pub outputs: Vec<SavedOutput>,
}

/// One output of a learned map.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SavedOutput {
    /// What it predicts.
    pub name: String,
    /// `log p(y | X, θ)`, nats.
    pub log_marginal_likelihood: f64,
    /// `ℓ`, one per input dimension, in its unit.
    pub length_scales: Vec<f64>,
    /// `σ_f²`.
    pub signal_variance: f64,
    /// `σₙ²`.
    pub noise_variance: f64,
    /// What the model says against itself, in plain words.
    pub warnings: Vec<String>,
    /// Predictions of each stride by all the others.
    pub leave_one_out: SavedLeaveOneOut,
    /// Size, hyperparameters, scores, conditioning.
    pub card: Card,
    /// The model itself, with its data; predictions are bit-identical when it is read again.
    pub gp: Fitted,
}

/// Predictions of each stride by all the others, noise included.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SavedLeaveOneOut {
    /// Predicted means.
    pub mean: Vec<f64>,
    /// Predicted standard deviations.
    pub std: Vec<f64>,
    /// What was observed.
    pub actual: Vec<f64>,
}

impl SavedOutput {
    pub(crate) fn of(gp: &Fitted, name: String, inputs: &[String]) -> Result<Self, GpError> {
        let scores = gp.leave_one_out()?;
        let card = gp.card();
        let h = gp.hyperparameters();
        Ok(Self {
            name,
            log_marginal_likelihood: gp.log_marginal_likelihood(),
            length_scales: h.length_scales.clone(),
            signal_variance: h.signal_variance,
            noise_variance: h.noise_variance,
            warnings: (card.warnings.iter())
                .map(|warning| match warning {
                    Warning::ConstantInput { dimension } => {
                        format!("{} never changes", inputs[*dimension])
                    }
                    other => other.to_string(),
                })
                .collect(),
            leave_one_out: SavedLeaveOneOut {
                mean: gp.targets().iter().zip(&scores.residuals).map(|(y, r)| y - r).collect(),
                std: scores.variances.iter().map(|v| v.sqrt()).collect(),
                actual: gp.targets().to_vec(),
            },
            card,
            gp: gp.clone(),
        })
    }
}
