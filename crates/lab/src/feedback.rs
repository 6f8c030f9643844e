//! Feedback on some components of the action from the Jacobian of a learned map.
//!
//! About the map's own steady state under constant actions,
//!
//! ```text
//! x(k+1) = F x(k) + G u(k) + H u(k−1) + n(k),    u(k) = (1 − κ) u(k−1) + κ K x(k)
//! ```
//!
//! in deviations, with κ the gains of the action law. The policy sees x(k) and not u(k−1), so that K is
//! a static output feedback, for which there is no Riccati equation: its numbers are searched for
//! least cost
//!
//! ```text
//! 1/T Σ_k  Σ_i var(x_i(k)) / var(n_i) + R Σ_j var(u_j(k)) / unit_j²
//! ```
//!
//! over T strides from the steady state. The map does not know its own slopes exactly: their posterior
//! covariance C_i enters as noise that grows with the deviations z = (x, u, u₋₁),
//!
//! ```text
//! var(x_i(k+1)) = [A Σ Aᵀ]_ii + var(n_i) + tr(C_i E[z zᵀ])
//! ```
//!
//! which is how cautious control \[Åström & Wittenmark 1995, sec. 7.5\] charges for what is not known: a slope of
//! which the map knows little is not leant on.

use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use stridemap_learn::{CmaEs, LinearPolicy, SavedPolicy};
use stridemap_map::{LearnedMap, MapPoint, MapSample};
use stridemap_process::{Action, Goal, ProcessSpec, Situation, State};

use crate::error::LabError;
use crate::state::StateComponent;

/// Feedback about constants found in the map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JacobianFeedbackConfig {
    /// The modulations that are fed back, by name.
    pub modulates: Vec<String>,
    /// The components of the state that each of them sees.
    pub sees: Vec<Vec<StateComponent>>,
    /// R: cost of the variance of an action, in its unit squared, beside the state's in noise
    /// variances.
    pub action_cost: f64,
    /// Largest correction of each, in its unit.
    pub limit: Vec<f64>,
}

/// A component of the action that is fed back.
#[derive(Clone, Debug, PartialEq)]
pub struct FedBack {
    /// Which component of the action.
    pub component: usize,
    /// What counts as one unit of it.
    pub unit: f64,
    /// κ: its gain in the action law.
    pub law_gain: f64,
    /// Largest correction, in its unit.
    pub limit: f64,
    /// The components of the state that it may depend on.
    pub sees: Vec<usize>,
}

/// A linear model of a map about its steady state, for n components of the state and m of the action.
#[derive(Clone, Debug)]
pub struct StrideModel {
    /// The steady state; the mean over a cycle of two where the map flips.
    pub state: State,
    /// F, n by n.
    pub of_state: DMatrix<f64>,
    /// G, n by m.
    pub of_action: DMatrix<f64>,
    /// H, n by m.
    pub of_last_action: DMatrix<f64>,
    /// C: covariance of the row of slopes (F, G, H) of each component, n times (n + 2m) squared.
    pub slope_covariance: Vec<DMatrix<f64>>,
    /// Variances of n, at least those of a twentieth of the data's spread: a simulator has next to
    /// none, and a model of it is not that good.
    pub noise: DVector<f64>,
    /// Spread of the data.
    pub spread: DVector<f64>,
}

/// Linearizes a map about its steady state under constant actions, by central differences.
///
/// # Arguments
///
/// - `components` – which components of the action are varied, each with its unit.
///
/// # Errors
///
/// [`LabError::Map`] if the map cannot be evaluated.
pub fn stride_model(map: &LearnedMap, constants: &[f64], components: &[(usize, f64)]) -> Result<StrideModel, LabError> {
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
        if free(i) { s.at.state[i] + s.next_state[i] } else { s.at.state[i] }
    };
    let mean = |i: usize| samples.iter().map(|s| value(s, i)).sum::<f64>() / count;
    let spread = |i: usize| {
        let m = mean(i);
        let squares: f64 = samples.iter().map(|s| (value(s, i) - m).powi(2)).sum();
        (squares / count).sqrt().max(1e-6)
    };
    let bounds: Vec<[f64; 2]> = (0..n)
        .map(|i| {
            let all = samples.iter().map(|s| s.at.state[i]);
            all.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], v| [l.min(v), h.max(v)])
        })
        .collect();
    let constants = Action::from_slice(constants);
    let mut x: State = (0..n).map(|i| if free(i) { 0.0 } else { mean(i) }).collect();
    let mut state: State = (0..n).map(|_| 0.0).collect();
    for k in 0..STRIDES {
        let at = Situation { state: x, last_action: constants.clone(), goal: Goal::new() };
        let next = map.predict(&at, &constants)?.means;
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
    // Every direction z = (x, u, u₋₁) in which the map is differentiated, with its step.
    let m = components.len();
    let mut moves = Vec::with_capacity(n + 2 * m);
    let at = |dx: Option<(usize, f64)>, du: Option<(usize, f64)>, dl: Option<(usize, f64)>| {
        let at = Situation { state: state.clone(), last_action: constants.clone(), goal: Goal::new() };
        let mut point = MapPoint { at, action: constants.clone() };
        if let Some((i, d)) = dx {
            point.at.state[i] += d;
        }
        if let Some((c, d)) = du {
            point.action[c] += d;
        }
        if let Some((c, d)) = dl {
            point.at.last_action[c] += d;
        }
        point
    };
    for i in 0..n {
        let d = STEP * spread(i);
        moves.push((at(Some((i, d)), None, None), at(Some((i, -d)), None, None), d));
    }
    for &(c, unit) in components {
        let d = STEP * unit;
        moves.push((at(None, Some((c, d)), None), at(None, Some((c, -d)), None), d));
    }
    for &(c, unit) in components {
        let d = STEP * unit;
        moves.push((at(None, None, Some((c, d))), at(None, None, Some((c, -d))), d));
    }
    let (slopes, slope_covariance) = map.slopes(&moves)?;
    let noise = map.outputs().iter().enumerate().map(|(i, gp)| {
        let least = (LEAST_NOISE * spread(i)).powi(2);
        gp.hyperparameters().noise_variance.max(least)
    });
    Ok(StrideModel {
        state,
        of_state: slopes.columns(0, n).into_owned(),
        of_action: slopes.columns(n, m).into_owned(),
        of_last_action: slopes.columns(n + m, m).into_owned(),
        slope_covariance,
        noise: DVector::from_iterator(n, noise),
        spread: DVector::from_iterator(n, (0..n).map(spread)),
    })
}

impl StrideModel {
    /// The mean cost over the first strides of a feedback K, m by n, from the steady state.
    ///
    /// # Arguments
    ///
    /// - `law_gain` – κ of each component that is fed back.
    /// - `action_cost` – R over its unit squared, of each.
    ///
    /// # Cost
    ///
    /// A tenth of a millisecond.
    #[must_use]
    pub fn cost(&self, feedback: &DMatrix<f64>, law_gain: &[f64], action_cost: &[f64]) -> f64 {
        const STRIDES: usize = 60;
        const MOST: f64 = 1e12;
        let (n, m) = (self.of_state.nrows(), self.of_action.ncols());
        // z = M s with s = (x, u₋₁), and s' = A s.
        let mut to_z = DMatrix::zeros(n + 2 * m, n + m);
        to_z.view_mut((0, 0), (n, n)).fill_with_identity();
        to_z.view_mut((n + m, n), (m, m)).fill_with_identity();
        for (j, gain) in law_gain.iter().enumerate() {
            to_z.view_mut((n + j, 0), (1, n)).copy_from(&(feedback.row(j) * *gain));
            to_z[(n + j, n + j)] = 1.0 - gain;
        }
        let mut a = DMatrix::zeros(n + m, n + m);
        let of_z = |z: usize, i: usize| match z {
            z if z < n => self.of_state[(i, z)],
            z if z < n + m => self.of_action[(i, z - n)],
            z => self.of_last_action[(i, z - n - m)],
        };
        let slopes = DMatrix::from_fn(n, n + 2 * m, |i, z| of_z(z, i));
        a.view_mut((0, 0), (n, n + m)).copy_from(&(&slopes * &to_z));
        a.view_mut((n, 0), (m, n + m)).copy_from(&to_z.view((n, 0), (m, n + m)));
        let mut covariance = DMatrix::zeros(n + m, n + m);
        let mut total = 0.0;
        for _ in 0..STRIDES {
            let of_z = &to_z * &covariance * to_z.transpose();
            covariance = &a * &covariance * a.transpose();
            for i in 0..n {
                covariance[(i, i)] += self.noise[i] + self.slope_covariance[i].dot(&of_z);
                total += covariance[(i, i)] / self.noise[i];
            }
            total += (0..m).map(|j| action_cost[j] * covariance[(n + j, n + j)]).sum::<f64>();
            if total.is_nan() || total > MOST {
                return MOST;
            }
        }
        total / STRIDES as f64
    }
}

/// Constants with the feedback that the map's Jacobian recommends.
///
/// # Arguments
///
/// - `spec` – the process's components and bounds; the policy clips to them.
/// - `fed` – the components of the action that are fed back.
/// - `action_cost` – R.
///
/// # Errors
///
/// [`LabError::Map`] if the map cannot be evaluated, [`LabError::Learn`] if the policy cannot be
/// built.
pub fn with_feedback(
    map: &LearnedMap,
    spec: &ProcessSpec,
    constants: &[f64],
    fed: &[FedBack],
    action_cost: f64,
    rng: &mut ChaCha8Rng,
) -> Result<SavedPolicy, LabError> {
    const GENERATIONS: usize = 120;
    let components: Vec<(usize, f64)> = fed.iter().map(|f| (f.component, f.unit)).collect();
    let model = stride_model(map, constants, &components)?;
    let (n, m) = (model.state.len(), fed.len());
    let law_gain: Vec<f64> = fed.iter().map(|f| f.law_gain).collect();
    let action_cost: Vec<f64> = fed.iter().map(|f| action_cost / (f.unit * f.unit)).collect();
    // The entries of K that are free; the others are zero.
    let free: Vec<(usize, usize)> = (0..m).flat_map(|j| fed[j].sees.iter().map(move |i| (j, *i))).collect();
    let gain_of = |numbers: &[f64]| {
        let mut k = DMatrix::zeros(m, n);
        for (at, value) in free.iter().zip(numbers) {
            k[*at] = *value;
        }
        k
    };
    let cost = |numbers: &[f64]| model.cost(&gain_of(numbers), &law_gain, &action_cost);
    // One unit of action for a state as far off as the data are wide would be a strong feedback.
    let std: Vec<f64> = free.iter().map(|(j, i)| 0.3 * fed[*j].unit / model.spread[*i]).collect();
    let none = vec![0.0; free.len()];
    let mut search = CmaEs::new(&none, &std, None)?;
    let (mut least, mut best) = (cost(&none), none);
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
    let best = gain_of(&best);
    let mut gain = vec![vec![0.0; n]; spec.action.len()];
    let mut limit = vec![0.0; spec.action.len()];
    for (j, f) in fed.iter().enumerate() {
        gain[f.component] = best.row(j).iter().copied().collect();
        limit[f.component] = f.limit;
    }
    let policy = LinearPolicy::new(spec.clone(), constants, &gain, &model.state)?.limited(&limit)?;
    Ok(SavedPolicy::Linear(policy))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::dmatrix;

    fn scalar(slope_covariance: f64) -> StrideModel {
        let mut of_slopes = DMatrix::zeros(3, 3);
        of_slopes[(1, 1)] = slope_covariance;
        StrideModel {
            state: [0.0].into_iter().collect(),
            of_state: dmatrix![-0.9],
            of_action: dmatrix![0.5],
            of_last_action: dmatrix![0.0],
            slope_covariance: vec![of_slopes],
            noise: nalgebra::dvector![0.04],
            spread: nalgebra::dvector![1.0],
        }
    }

    /// A scalar map that flips at −0.9: without feedback var(x(k)) / var(n) = (1 − 0.81ᵏ) / 0.19, of
    /// which the mean over 60 strides is charged; the feedback that cancels the flip leaves that of the
    /// noise alone, and its action, 1.8 times the state before it, costs from the second stride on.
    #[test]
    fn the_cost_is_the_mean_variance() {
        let model = scalar(0.0);
        let expected = (1..=60).map(|k| (1.0 - 0.81_f64.powi(k)) / 0.19).sum::<f64>() / 60.0;
        assert!((model.cost(&dmatrix![0.0], &[1.0], &[0.0]) - expected).abs() < 1e-9);
        assert!((model.cost(&dmatrix![1.8], &[1.0], &[0.0]) - 1.0).abs() < 1e-9);
        let of_action = 59.0 / 60.0 * 1.8 * 1.8 * 0.04;
        assert!((model.cost(&dmatrix![1.8], &[1.0], &[1.0]) - (1.0 + of_action)).abs() < 1e-9);
    }

    /// What is not known of the slope of the action makes a strong feedback dear: with slope 0.5 ± s,
    /// cancelling costs var(x(k)) = 1 + (1.8 s)² var(x(k−1)).
    #[test]
    fn doubt_about_a_slope_is_noise_that_grows_with_the_action() {
        let grows = 1.8 * 1.8 * 0.09;
        let expected = (1..=60).map(|k| (1.0 - f64::powi(grows, k)) / (1.0 - grows)).sum::<f64>() / 60.0;
        let cost = scalar(0.09).cost(&dmatrix![1.8], &[1.0], &[0.0]);
        assert!((cost - expected).abs() < 1e-9, "{cost} {expected}");
    }
}
