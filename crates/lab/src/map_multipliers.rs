//! Multipliers of a learned map with its policy in the loop, with the posterior of the map's slopes.

use nalgebra::{DMatrix, DVector};
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};
use stridemap_learn::Policy;
use stridemap_map::LearnedMap;
use stridemap_process::{Action, Goal, Situation, State};
use stridemap_stability::Estimate;

use crate::error::LabError;
use crate::feedback::{StrideModel, stride_model};
use crate::seed::{Role, stream};
use crate::task::Task;

/// Multipliers that a map gives a policy, with 95 % intervals over its slopes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MapMultipliers {
    /// Largest modulus.
    pub largest: Estimate,
    /// Largest real part.
    pub slow: Estimate,
    /// Smallest real part.
    pub flip: Estimate,
    /// Strides that the map was fitted to.
    pub samples: usize,
}

/// dπ/dx at a state, m by n, by central differences.
fn policy_slopes(policy: &dyn Policy, model: &StrideModel, action: &Action) -> DMatrix<f64> {
    const STEP: f64 = 0.2;
    let n = model.state.len();
    let asked = |i: usize, by: f64| {
        let mut state = model.state.clone();
        state[i] += by;
        policy.mean(&Situation { state, last_action: action.clone(), goal: Goal::new() })
    };
    let mut slopes = DMatrix::zeros(action.len(), n);
    for i in 0..n {
        let step = STEP * model.spread[i];
        let (above, below) = (asked(i, step), asked(i, -step));
        for j in 0..action.len() {
            slopes[(j, i)] = (above[j] - below[j]) / (2.0 * step);
        }
    }
    slopes
}

/// Multipliers of a map under a policy: eigenvalues of `F + (G + H) dπ/dx` at its steady state, over draws of the slopes
/// (F, G, H) from their posterior. Components of which the robot's walk does not depend, such as its heading, are left out.
///
/// # Errors
///
/// [`LabError::Map`] if the map cannot be evaluated.
pub fn map_multipliers(
    task: &Task,
    map: &LearnedMap,
    policy: &dyn Policy,
    seed: u64,
) -> Result<MapMultipliers, LabError> {
    const DRAWS: usize = 1000;
    let units: Vec<(usize, f64)> =
        task.action_limits()?.iter().map(|l| 0.1 * (l.upper - l.lower)).enumerate().collect();
    let neutral: Action = task.action_limits()?.iter().map(|l| l.neutral).collect();
    let (mut action, mut state): (Action, Option<State>) = (neutral.clone(), None);
    // Where the gait settles and what the policy does there depend on one another.
    for _ in 0..4 {
        let at = state.unwrap_or_else(|| map.samples().first().map(|s| s.at.state.clone()).unwrap_or_default());
        action = policy.mean(&Situation { state: at, last_action: action, goal: Goal::new() });
        state = Some(stride_model(map, &action, &units)?.state);
    }
    let model = stride_model(map, &action, &units)?;
    let gains = policy_slopes(policy, &model, &action);
    let (n, m) = (model.state.len(), action.len());
    let kept: Vec<usize> = (0..n).filter(|i| !map.config().is_invariant(*i)).collect();
    let mean = DMatrix::from_fn(n, n + 2 * m, |i, j| match j {
        j if j < n => model.of_state[(i, j)],
        j if j < n + m => model.of_action[(i, j - n)],
        j => model.of_last_action[(i, j - n - m)],
    });
    let factors: Vec<DMatrix<f64>> = model
        .slope_covariance
        .iter()
        .map(|c| {
            let eigen = c.clone().symmetric_eigen();
            &eigen.eigenvectors * DMatrix::from_diagonal(&eigen.eigenvalues.map(|v| v.max(0.0).sqrt()))
        })
        .collect();
    let mut rng = stream(seed, Role::Check, 7);
    let mut modes: [Vec<f64>; 3] = Default::default();
    for _ in 0..DRAWS {
        let mut slopes = mean.clone();
        for (i, factor) in factors.iter().enumerate() {
            let z = DVector::from_fn(n + 2 * m, |_, _| StandardNormal.sample(&mut rng));
            let moved = factor * z;
            (0..n + 2 * m).for_each(|j| slopes[(i, j)] += moved[j]);
        }
        let closed = slopes.columns(0, n) + (slopes.columns(n, m) + slopes.columns(n + m, m)) * &gains;
        let own = DMatrix::from_fn(kept.len(), kept.len(), |i, j| closed[(kept[i], kept[j])]);
        let eigenvalues = own.complex_eigenvalues();
        modes[0].push(eigenvalues.iter().map(|z| z.norm()).fold(0.0, f64::max));
        modes[1].push(eigenvalues.iter().map(|z| z.re).fold(f64::NEG_INFINITY, f64::max));
        modes[2].push(eigenvalues.iter().map(|z| z.re).fold(f64::INFINITY, f64::min));
    }
    let [largest, slow, flip] = modes.map(Estimate::of);
    Ok(MapMultipliers { largest, slow, flip, samples: map.samples().len() })
}
