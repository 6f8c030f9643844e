//! Control without a map: Bayesian optimisation of the speed on the robot.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use stridemap_gp::{FitOptions, Gp, Mean, Points};
use stridemap_learn::{SavedPolicy, TrialSummary};
use stridemap_map::MapError;

use super::{ControlsConfig, Known, LearnerPart, value};
use crate::error::LabError;
use crate::registry::part;
use crate::task::Task;
use stridemap_record::{Proof, Region};

pub(super) struct OnRobot;

part!(OnRobot, "bayes_opt", "without a map: Bayesian optimisation of the speed on the robot");

impl LearnerPart for OnRobot {
    fn uses_map(&self) -> bool {
        false
    }

    fn explores(&self) -> bool {
        false
    }

    fn check(&self, task: &Task) -> Result<(), LabError> {
        ControlsConfig::check(task)
    }

    fn propose(
        &self,
        known: &Known<'_>,
        rng: &mut ChaCha8Rng,
        _observer: &mut dyn FnMut(&TrialSummary),
    ) -> Result<SavedPolicy, LabError> {
        let (_, region) = known.caution()?;
        let unit = known.task.of_each(|a| a.unit);
        let (config, proofs) = (known.task.controls()?, known.progress.proofs());
        let action = next(config, region, &unit, &proofs, rng)?;
        known.constant(&action)
    }
}

/// Bayesian optimisation of the speed over constant actions: a Gaussian process on the policies tried,
/// and the point of the region with the largest mean plus some standard deviations.
pub(super) fn next(
    config: &ControlsConfig,
    region: &Region,
    unit: &[f64],
    proofs: &[&Proof],
    rng: &mut ChaCha8Rng,
) -> Result<Vec<f64>, LabError> {
    const CANDIDATES: usize = 4000;
    let m = unit.len();
    let drawn = |rng: &mut ChaCha8Rng| -> Vec<f64> {
        let bounds = region.lower.iter().zip(&region.upper);
        bounds.map(|(l, u)| l + (u - l) * rng.random::<f64>()).collect()
    };
    let tried: Vec<&&Proof> = proofs.iter().filter(|p| p.action.len() == m).collect();
    if tried.len() < config.random_policies.max(2) {
        return Ok(drawn(rng));
    }
    let mut inputs = Vec::with_capacity(tried.len() * m);
    for p in &tried {
        inputs.extend(p.action.iter().zip(unit).map(|(a, u)| a / u));
    }
    let values: Vec<f64> = tried.iter().map(|p| value(p)).collect();
    let points = Points::new(&inputs, m).map_err(MapError::from)?;
    let options = FitOptions { mean: Mean::Constant, starts: 3, ..FitOptions::default() };
    let gp = Gp::fit(points, &values, &options, rng).map_err(MapError::from)?;
    let (mut best, mut most) = (drawn(rng), f64::NEG_INFINITY);
    for _ in 0..CANDIDATES {
        let point = drawn(rng);
        let scaled: Vec<f64> = point.iter().zip(unit).map(|(a, u)| a / u).collect();
        let p = gp.predict(&scaled).map_err(MapError::from)?;
        let bound = p.mean + config.ucb_stds * p.latent_variance.sqrt();
        if bound > most {
            (best, most) = (point, bound);
        }
    }
    Ok(best)
}
