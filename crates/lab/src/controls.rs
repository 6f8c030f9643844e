//! Controls: policies proposed from strides on the robot without a map of its state.
//!
//! Each sees the same strides, limits, trust region, guard and proof as a learner with a map.

use nalgebra::{DMatrix, DVector};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use stridemap_gp::{FitOptions, Gp, Mean, Points};
use stridemap_learn::CmaEs;
use stridemap_returnmap::ActionLimits;

use crate::error::LabError;
use crate::proof::{Proof, Verdict};
use crate::strides::Transition;
use crate::trust::Region;

/// Parameters of the controls that search on the robot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlsConfig {
    /// Bayesian optimisation: standard deviations added to the mean of the speed (UCB).
    pub ucb_stds: f64,
    /// Bayesian optimisation: policies drawn at random in the region before the first fit.
    pub random_policies: usize,
    /// CMA-ES: candidates of a generation, at least 4.
    pub population: usize,
    /// CMA-ES: first standard deviation, in units of the trust region.
    pub first_std_units: f64,
}

/// What a search on the robot is told of a policy: its speed; half of it after a warning, nothing after
/// a fall.
#[must_use]
pub fn value(proof: &Proof) -> f64 {
    match proof.verdict {
        Verdict::Fell => 0.0,
        Verdict::Warned => 0.5 * proof.speed_m_s,
        Verdict::Proven | Verdict::Slower | Verdict::Unfinished => proof.speed_m_s,
    }
}

/// The corner of the region that is farthest from the nominal gait, in every component.
#[must_use]
pub fn grown(region: &Region, limits: &[ActionLimits], tried: &[[f64; 2]]) -> Vec<f64> {
    let up = |i: usize| {
        let neutral = limits[i].neutral;
        (tried[i][1] - neutral).abs() >= (tried[i][0] - neutral).abs()
    };
    let corner = |i: usize| {
        if up(i) {
            region.upper[i]
        } else {
            region.lower[i]
        }
    };
    (0..limits.len()).map(corner).collect()
}

/// The corner of the region that the regression of the stride's reward on the action recommends.
///
/// # Errors
///
/// [`LabError::TooFewStrides`] if the regression is not determined.
pub fn linear(region: &Region, transitions: &[&Transition]) -> Result<Vec<f64>, LabError> {
    let m = region.lower.len();
    let needed = m + 2;
    let too_few = LabError::TooFewStrides {
        found: transitions.len(),
        needed,
    };
    if transitions.len() < needed {
        return Err(too_few);
    }
    let mut rows = Vec::with_capacity(transitions.len() * (m + 1));
    for t in transitions {
        rows.push(1.0);
        rows.extend_from_slice(&t.action);
    }
    let z = DMatrix::from_row_slice(transitions.len(), m + 1, &rows);
    let rewards = transitions.iter().map(|t| t.reward);
    let y = DVector::from_iterator(transitions.len(), rewards);
    let normal = z.transpose() * &z;
    let slopes = normal
        .cholesky()
        .ok_or(too_few)?
        .solve(&(z.transpose() * y));
    let corner = |i: usize| {
        if slopes[i + 1] >= 0.0 {
            region.upper[i]
        } else {
            region.lower[i]
        }
    };
    Ok((0..m).map(corner).collect())
}

/// Bayesian optimisation of the speed over constant actions: a Gaussian process on the policies tried,
/// and the point of the region with the largest mean plus some standard deviations.
///
/// # Errors
///
/// [`LabError::Process`] if the Gaussian process cannot be fitted.
pub fn bayes_opt(
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
        bounds
            .map(|(l, u)| l + (u - l) * rng.random::<f64>())
            .collect()
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
    let points = Points::new(&inputs, m).map_err(gp_error)?;
    let options = FitOptions {
        mean: Mean::Constant,
        starts: 3,
        ..FitOptions::default()
    };
    let gp = Gp::fit(points, &values, &options, rng).map_err(gp_error)?;
    let (mut best, mut most) = (drawn(rng), f64::NEG_INFINITY);
    for _ in 0..CANDIDATES {
        let point = drawn(rng);
        let scaled: Vec<f64> = point.iter().zip(unit).map(|(a, u)| a / u).collect();
        let p = gp.predict(&scaled).map_err(gp_error)?;
        let bound = p.mean + config.ucb_stds * p.latent_variance.sqrt();
        if bound > most {
            (best, most) = (point, bound);
        }
    }
    Ok(best)
}

fn gp_error(error: stridemap_gp::GpError) -> LabError {
    LabError::Process(error.into())
}

/// CMA-ES over constant actions on the robot: the next candidate, after replaying all generations that
/// are complete. `stream` gives the generator of a generation.
///
/// # Errors
///
/// [`LabError::Learn`] for a configuration outside its domain.
pub fn cma_es(
    config: &ControlsConfig,
    region: &Region,
    unit: &[f64],
    proofs: &[&Proof],
    stream: &dyn Fn(usize) -> ChaCha8Rng,
) -> Result<Vec<f64>, LabError> {
    let start: Vec<f64> = region
        .lower
        .iter()
        .zip(&region.upper)
        .map(|(l, u)| 0.5 * (l + u))
        .collect();
    let std: Vec<f64> = unit.iter().map(|u| config.first_std_units * u).collect();
    let mut search = CmaEs::new(&start, &std, Some(config.population))?;
    let population = config.population;
    for (generation, told) in proofs.chunks(population).enumerate() {
        let points: Vec<Vec<f64>> = search
            .ask(&mut stream(generation))
            .iter()
            .map(|p| region.nearest(p))
            .collect();
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::{Role, stream};

    fn speed(action: &[f64]) -> f64 {
        0.4 - 0.02 * (action[0] - 3.0).powi(2) - 0.5 * (action[1] - 0.5).powi(2)
    }

    fn proof(action: Vec<f64>) -> Proof {
        Proof {
            verdict: Verdict::Slower,
            warning: None,
            speed_m_s: speed(&action),
            strides: 30,
            attempts: 1,
            action,
        }
    }

    /// Both searches come near the top of a bowl on which they are tried 40 times.
    #[test]
    fn searches_on_the_robot_climb() {
        let config = ControlsConfig {
            ucb_stds: 1.5,
            random_policies: 4,
            population: 5,
            first_std_units: 0.5,
        };
        let region = Region {
            lower: vec![0.0, 0.0],
            upper: vec![6.0, 1.5],
        };
        let unit = [2.0, 0.5];
        for bayes in [true, false] {
            let mut proofs: Vec<Proof> = Vec::new();
            for i in 0..40 {
                let list: Vec<&Proof> = proofs.iter().collect();
                let action = if bayes {
                    bayes_opt(
                        &config,
                        &region,
                        &unit,
                        &list,
                        &mut stream(1, Role::Improve, i),
                    )
                } else {
                    let of = |g: usize| stream(1, Role::Improve, g as u64);
                    cma_es(&config, &region, &unit, &list, &of)
                };
                proofs.push(proof(action.unwrap()));
            }
            let best = proofs.iter().map(value).fold(f64::NEG_INFINITY, f64::max);
            assert!(best > 0.39, "{bayes}: {best}");
        }
    }
}
