//! Control without a map: CMA-ES on the robot.

use rand_chacha::ChaCha8Rng;
use stridemap_learn::{CmaEs, SavedPolicy, TrialSummary};

use super::{ControlsConfig, Known, LearnerPart, value};
use crate::error::LabError;
use crate::registry::part;
use crate::seed::{Role, stream};
use crate::task::Task;
use stridemap_record::{Proof, Region};

pub(super) struct OnRobot;

part!(OnRobot, "cma_es", "without a map: CMA-ES on the robot");

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
        _rng: &mut ChaCha8Rng,
        _observer: &mut dyn FnMut(&TrialSummary),
    ) -> Result<SavedPolicy, LabError> {
        let (_, region) = known.caution()?;
        let unit = known.task.of_each(|a| a.unit);
        let (config, proofs) = (known.task.controls()?, known.progress.proofs());
        let of = |g: usize| stream(known.seed, Role::RobotSearch, g as u64);
        let action = next(config, region, &unit, &proofs, &of)?;
        known.constant(&action)
    }
}

/// CMA-ES over constant actions on the robot: the next candidate, after replaying all generations that
/// are complete. `stream` gives the generator of a generation.
pub(super) fn next(
    config: &ControlsConfig,
    region: &Region,
    unit: &[f64],
    proofs: &[&Proof],
    stream: &dyn Fn(usize) -> ChaCha8Rng,
) -> Result<Vec<f64>, LabError> {
    let start: Vec<f64> = region.lower.iter().zip(&region.upper).map(|(l, u)| 0.5 * (l + u)).collect();
    let std: Vec<f64> = unit.iter().map(|u| config.first_std_units * u).collect();
    let mut search = CmaEs::new(&start, &std, Some(config.population))?;
    let population = config.population;
    for (generation, told) in proofs.chunks(population).enumerate() {
        let points: Vec<Vec<f64>> = search.ask(&mut stream(generation)).iter().map(|p| region.nearest(p)).collect();
        if told.len() < population {
            return Ok(points[told.len()].clone());
        }
        let values: Vec<f64> = told.iter().map(|p| value(p)).collect();
        search.tell(&points, &values)?;
    }
    let generation = proofs.len() / population;
    let points = search.ask(&mut stream(generation));
    Ok(region.nearest(&points[0]))
}
