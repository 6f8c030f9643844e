//! Feedback on one component of the action from the Jacobian of a learned map.
//!
//! About the map's own steady state under constant actions,
//!
//! ```text
//! x(k+1) = F x(k) + g u(k) + h u(k−1) + n(k),    u(k) = (1 − γ) u(k−1) + γ K x(k)
//! ```
//!
//! in deviations, with γ the gain of the action law. The policy sees x(k) and not u(k−1), so that K is
//! a static output feedback, for which there is no Riccati equation: its three numbers are searched
//! for least stationary cost
//!
//! ```text
//! Σ_i var(x_i) / var(n_i) + R var(u) / unit²
//! ```
//!
//! where the stationary covariance is that of the linear system under the map's own noise.

use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use stridemap_learn::{CmaEs, LinearPolicy, SavedPolicy};
use stridemap_returnmap::{ActionLimits, LearnedMap, MapSample, ProcessSpec, State};

use crate::error::LabError;

/// Feedback about constants found in the map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JacobianFeedbackConfig {
    /// The modulation that is fed back, by name.
    pub modulates: String,
    /// R: cost of the action's variance, in its unit squared, beside the state's in noise variances.
    pub action_cost: f64,
    /// Largest correction, in the unit of the action.
    pub limit: f64,
}

/// A linear model of a map about its steady state.
#[derive(Clone, Debug)]
pub struct StrideModel {
    /// The steady state; the mean over a cycle of two where the map flips.
    pub state: State,
    /// F.
    pub of_state: DMatrix<f64>,
    /// g, for one component of the action.
    pub of_action: DVector<f64>,
    /// h, for the same component of the last action.
    pub of_last_action: DVector<f64>,
    /// Variances of n, at least those of a twentieth of the data's spread: a simulator has next to
    /// none, and a model of it is not that good.
    pub noise: DVector<f64>,
    /// Spread of the data.
    pub spread: DVector<f64>,
}

/// Linearizes a map about its steady state under constant actions, by central differences.
///
/// # Errors
///
/// [`LabError::Process`] if the map cannot be evaluated.
pub fn stride_model(
    map: &LearnedMap,
    constants: &[f64],
    component: usize,
    unit: f64,
) -> Result<StrideModel, LabError> {
    const STRIDES: usize = 120;
    const AVERAGED: usize = 20;
    /// Steps of the differences: this share of the data's spread, or of the action's unit.
    const STEP: f64 = 0.2;
    const LEAST_NOISE: f64 = 0.05;
    let samples = map.samples();
    let n = map.outputs().len();
    let count = samples.len().max(1) as f64;
    // A component on which nothing depends is as spread as its change; it may begin anywhere.
    let free = |i: usize| map.config().is_invariant(i);
    let value = |s: &MapSample, i: usize| {
        if free(i) {
            s.state[i] + s.next_state[i]
        } else {
            s.state[i]
        }
    };
    let mean = |i: usize| samples.iter().map(|s| value(s, i)).sum::<f64>() / count;
    let spread = |i: usize| {
        let m = mean(i);
        let squares: f64 = samples.iter().map(|s| (value(s, i) - m).powi(2)).sum();
        (squares / count).sqrt().max(1e-6)
    };
    let bounds: Vec<[f64; 2]> = (0..n)
        .map(|i| {
            let all = samples.iter().map(|s| s.state[i]);
            all.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], v| {
                [l.min(v), h.max(v)]
            })
        })
        .collect();
    let mut x: State = (0..n)
        .map(|i| if free(i) { 0.0 } else { mean(i) })
        .collect();
    let mut state: State = (0..n).map(|_| 0.0).collect();
    for k in 0..STRIDES {
        let (next, _) = map.predict(&x, constants, constants)?;
        // A map that flips stays where it has data.
        x = next
            .iter()
            .zip(&bounds)
            .enumerate()
            .map(|(i, (v, [l, h]))| if free(i) { *v } else { v.clamp(*l, *h) })
            .collect();
        if k >= STRIDES - AVERAGED {
            for (sum, v) in state.iter_mut().zip(&x) {
                *sum += v / AVERAGED as f64;
            }
        }
    }
    let difference = |moved: &dyn Fn(f64) -> Result<State, LabError>, step: f64| {
        let (above, below) = (moved(step)?, moved(-step)?);
        let slope = above
            .iter()
            .zip(&below)
            .map(|(a, b)| (a - b) / (2.0 * step));
        Ok::<_, LabError>(DVector::from_iterator(n, slope))
    };
    let mut of_state = DMatrix::zeros(n, n);
    for i in 0..n {
        let column = difference(
            &|d| {
                let mut moved = state.clone();
                moved[i] += d;
                Ok(map.predict(&moved, constants, constants)?.0)
            },
            STEP * spread(i),
        )?;
        of_state.set_column(i, &column);
    }
    let moved = |d: f64| {
        let mut action = constants.to_vec();
        action[component] += d;
        action
    };
    let of_action = difference(
        &|d| Ok(map.predict(&state, &moved(d), constants)?.0),
        STEP * unit,
    )?;
    let of_last_action = difference(
        &|d| Ok(map.predict(&state, constants, &moved(d))?.0),
        STEP * unit,
    )?;
    let noise = map.outputs().iter().enumerate().map(|(i, gp)| {
        let least = (LEAST_NOISE * spread(i)).powi(2);
        gp.hyperparameters().noise_variance.max(least)
    });
    Ok(StrideModel {
        state,
        of_state,
        of_action,
        of_last_action,
        noise: DVector::from_iterator(n, noise),
        spread: DVector::from_iterator(n, (0..n).map(spread)),
    })
}

impl StrideModel {
    /// The closed loop over (x, u(k−1)) with the row K and the action law's gain.
    #[must_use]
    pub fn closed_loop(&self, feedback: &[f64], law_gain: f64) -> DMatrix<f64> {
        let n = self.of_state.nrows();
        let mut a = DMatrix::zeros(n + 1, n + 1);
        for i in 0..n {
            for j in 0..n {
                a[(i, j)] = self.of_state[(i, j)] + self.of_action[i] * law_gain * feedback[j];
            }
            a[(i, n)] = self.of_last_action[i] + self.of_action[i] * (1.0 - law_gain);
            a[(n, i)] = law_gain * feedback[i];
        }
        a[(n, n)] = 1.0 - law_gain;
        a
    }

    /// Largest magnitude of the multipliers of the closed loop.
    #[must_use]
    pub fn spectral_radius(&self, feedback: &[f64], law_gain: f64) -> f64 {
        let multipliers = self.closed_loop(feedback, law_gain).complex_eigenvalues();
        multipliers.iter().map(|m| m.norm()).fold(0.0, f64::max)
    }

    /// The stationary cost of a feedback; infinite where the loop is not stable.
    #[must_use]
    pub fn cost(&self, feedback: &[f64], law_gain: f64, action_cost: f64) -> f64 {
        const STRIDES: usize = 300;
        let n = self.of_state.nrows();
        let a = self.closed_loop(feedback, law_gain);
        let mut w = DMatrix::zeros(n + 1, n + 1);
        for i in 0..n {
            w[(i, i)] = self.noise[i];
        }
        let mut covariance = w.clone();
        for _ in 0..STRIDES {
            let next = &a * &covariance * a.transpose() + &w;
            let change = (&next - &covariance).amax();
            covariance = next;
            if change.is_nan() || covariance.amax() > 1e12 {
                return f64::INFINITY;
            }
            if change <= 1e-9 * covariance.amax() {
                break;
            }
        }
        // u(k) is the last entry of the next stride's (x, u(k−1)).
        let state: f64 = (0..n).map(|i| covariance[(i, i)] / self.noise[i]).sum();
        state + action_cost * covariance[(n, n)]
    }
}

/// Constants with the feedback that the map's Jacobian recommends.
///
/// # Arguments
///
/// - `spec` – the process's components and bounds; the policy clips to them.
/// - `unit` – what counts as one unit of the action that is fed back.
///
/// # Errors
///
/// [`LabError::Process`] if the map cannot be evaluated, [`LabError::Learn`] if the policy cannot be
/// built.
pub fn with_feedback(
    map: &LearnedMap,
    spec: &ProcessSpec,
    limits: &[ActionLimits],
    constants: &[f64],
    (component, unit): (usize, f64),
    config: &JacobianFeedbackConfig,
    rng: &mut ChaCha8Rng,
) -> Result<SavedPolicy, LabError> {
    const GENERATIONS: usize = 60;
    let model = stride_model(map, constants, component, unit)?;
    let n = model.state.len();
    let law_gain = limits[component].gain;
    // Among feedbacks under which the loop is not stable, the one nearer to it is better: a heading
    // left alone is not stable, and the search must find its way from there.
    let cost = |k: &[f64]| {
        const UNSTABLE: f64 = 1e20;
        let cost = model.cost(k, law_gain, config.action_cost / (unit * unit));
        if cost.is_finite() {
            cost.min(UNSTABLE)
        } else {
            let radius = model.spectral_radius(k, law_gain);
            UNSTABLE * (1.0 + if radius.is_finite() { radius } else { 1e6 })
        }
    };
    // One unit of action for a state as far off as the data are wide would be a strong feedback.
    let std: Vec<f64> = (0..n).map(|i| 0.3 * unit / model.spread[i]).collect();
    let mut search = CmaEs::new(&vec![0.0; n], &std, None)?;
    let (mut best, mut least) = (vec![0.0; n], cost(&vec![0.0; n]));
    for _ in 0..GENERATIONS {
        let points = search.ask(rng);
        let costs: Vec<f64> = points.iter().map(|p| cost(p)).collect();
        for (point, cost) in points.iter().zip(&costs) {
            if *cost < least {
                (best, least) = (point.clone(), *cost);
            }
        }
        search.tell(&points, &costs.iter().map(|c| -c).collect::<Vec<_>>())?;
    }
    let mut gain = vec![vec![0.0; n]; limits.len()];
    let mut limit = vec![0.0; limits.len()];
    gain[component] = best;
    limit[component] = config.limit;
    let policy =
        LinearPolicy::new(spec.clone(), constants, &gain, &model.state)?.limited(&limit)?;
    Ok(SavedPolicy::Linear(policy))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scalar map that flips at −0.9: without feedback the variance is 1 / (1 − 0.81); the feedback
    /// that cancels it leaves that of the noise alone.
    #[test]
    fn the_cost_is_the_stationary_variance() {
        let model = StrideModel {
            state: [0.0].into_iter().collect(),
            of_state: nalgebra::dmatrix![-0.9],
            of_action: nalgebra::dvector![0.5],
            of_last_action: nalgebra::dvector![0.0],
            noise: nalgebra::dvector![0.04],
            spread: nalgebra::dvector![1.0],
        };
        assert!((model.cost(&[0.0], 1.0, 0.0) - 1.0 / 0.19).abs() < 1e-6);
        assert!((model.cost(&[1.8], 1.0, 0.0) - 1.0).abs() < 1e-9);
        // u = 1.8 x: its variance is 1.8² times that of x.
        assert!((model.cost(&[1.8], 1.0, 1.0) - (1.0 + 1.8 * 1.8 * 0.04)).abs() < 1e-9);
        assert!(model.cost(&[-1.0], 1.0, 0.0).is_infinite());
    }
}
