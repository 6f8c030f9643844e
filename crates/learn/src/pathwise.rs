//! The gradient of a policy's reward along sampled paths of a map.

use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};
use stridemap_process::{Foreseen, Foresight, ProcessError, Situation, StrideProcess};

use crate::actor_critic::{ActorCriticConfig, Tally};
use crate::error::{LearnError, Place, check_number};
use crate::gaussian_policy::GaussianPolicy;
use crate::learner::{LearnOutcome, Learner, TrialReport};
use crate::network::Activations;
use crate::policy::Policy;
use crate::policy_gradient::beginning;
use crate::saved::{KeptPolicy, SavedPolicy};

/// Parameters of [`Pathwise`]. The policy's shape and limits and the discount are those of an [`ActorCriticConfig`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PathwiseConfig {
    /// Steps along the gradient; at least 1.
    pub trials: usize,
    /// Paths, the same in every trial; at least 1.
    pub paths: usize,
    /// Strides of a path; at least 1.
    pub strides: usize,
    /// Largest step of a weight in a trial, in outputs; positive. It shrinks to a hundredth in the second half.
    pub step: f64,
    /// Most bases of the policy; at least 1.
    pub max_bases: usize,
}

impl Default for PathwiseConfig {
    fn default() -> Self {
        Self { trials: 150, paths: 40, strides: 16, step: 0.1, max_bases: 14 }
    }
}

impl PathwiseConfig {
    /// Checks every field against its domain.
    ///
    /// # Errors
    ///
    /// [`LearnError::Parameter`] naming the field.
    pub fn validate(&self) -> Result<(), LearnError> {
        for (field, value) in
            [("trials", self.trials), ("paths", self.paths), ("strides", self.strides), ("max_bases", self.max_bases)]
        {
            if value == 0 {
                return Err(LearnError::parameter(field, value, "at least 1"));
            }
        }
        check_number("step", self.step, self.step > 0.0, "positive and finite")
    }
}

/// Climbs the gradient of the discounted reward along paths whose random numbers are held fixed \[NJ00\], each stride
/// drawn as a function of its situation, so that the path can be differentiated \[DR11; MC-PILCO\]:
///
/// ```text
/// u = μ_w(x),  x′ = m(x, u) + s(x, u) z,  z fixed
/// J = Σₖ γᵏ Sₖ E[r | x, u],   Sₖ₊₁ = Sₖ (1 − P(fall | x, u))
/// ```
///
/// The reward is the expectation of the stride's, which has less variance than a drawn one, and a fall takes its share
/// of the path instead of ending it, so that J is smooth. Slopes of the map are central differences of what it
/// foresees, those of the policy exact. Steps are Adam's \[KB15\].
///
/// # References
///
/// \[NJ00\], \[DR11\], \[MC-PILCO\], \[KB15\]: see the [crate](crate) documentation.
#[derive(Clone, Debug)]
pub struct Pathwise {
    /// The policy's shape and limits, and the discount.
    pub network: ActorCriticConfig,
    /// The parameters.
    pub config: PathwiseConfig,
}

/// Where paths begin, and the random numbers of their strides.
pub(crate) struct Scenario {
    starts: Vec<Situation>,
    /// `[path][stride][component]`.
    draws: Vec<Vec<Vec<f64>>>,
}

/// J of some paths per path and stride, its gradient by the mean weights (base by base), and the falls expected of
/// them all.
pub(crate) struct Climb {
    pub value: f64,
    pub gradient: DVector<f64>,
    falls: f64,
}

impl Learner for Pathwise {
    fn improve(
        &mut self,
        process: &mut dyn StrideProcess,
        initial: Option<&SavedPolicy>,
        rng: &mut ChaCha8Rng,
        observer: &mut dyn FnMut(&TrialReport<'_>),
    ) -> Result<LearnOutcome, LearnError> {
        let config = self.config;
        config.validate()?;
        let mut policy = beginning(&self.network, process, initial)?;
        let scenario = self.scenario(process, rng)?;
        let map = process.foresight().ok_or(LearnError::NoForesight { learner: "pathwise" })?;
        let (mut first, mut second) = (DVector::zeros(0), DVector::zeros(0));
        let mut trials = Vec::with_capacity(config.trials);
        for trial in 0..config.trials {
            self.add_bases(&mut policy, map, &scenario)?;
            let at = Place { trial: trial + 1, stride: 1 };
            let climb = self.climb(&policy, map, &scenario)?;
            if !(climb.value.is_finite() && climb.gradient.iter().all(|g| g.is_finite())) {
                return Err(at.diverged());
            }
            let d = climb.gradient.len();
            first = first.resize_vertically(d, 0.0);
            second = second.resize_vertically(d, 0.0);
            self.step(&mut policy, trial, &climb.gradient, (&mut first, &mut second));
            let mut tally = Tally::default();
            let made = config.paths * config.strides;
            tally.add(made, climb.value * made as f64, climb.falls.round() as usize);
            let summary = tally.summary(trial + 1, policy.network().len());
            observer(&TrialReport { summary: &summary, policy: &policy });
            trials.push(summary);
        }
        let strides = config.trials * config.paths * config.strides;
        Ok(LearnOutcome { policy: policy.to_saved(), trials, strides })
    }
}

impl Pathwise {
    /// Draws where paths begin and the numbers of their strides.
    pub(crate) fn scenario(
        &self,
        process: &mut dyn StrideProcess,
        rng: &mut ChaCha8Rng,
    ) -> Result<Scenario, LearnError> {
        let (paths, strides, n) = (self.config.paths, self.config.strides, process.spec().state.len());
        let at = Place { trial: 1, stride: 1 };
        let mut starts = Vec::with_capacity(paths);
        for _ in 0..paths {
            let start = process.reset(rng)?;
            at.check_state(&start.state, process.spec())?;
            starts.push(start);
        }
        let stride = |rng: &mut ChaCha8Rng| (0..n).map(|_| StandardNormal.sample(rng)).collect();
        let draws = (0..paths).map(|_| (0..strides).map(|_| stride(rng)).collect()).collect();
        Ok(Scenario { starts, draws })
    }

    /// Adds bases where the paths of the policy go and none is active.
    fn add_bases(
        &self,
        policy: &mut GaussianPolicy,
        map: &dyn Foresight,
        scenario: &Scenario,
    ) -> Result<(), LearnError> {
        let most = self.config.max_bases.min(self.network.max_bases);
        let mut here = Activations::default();
        for (start, draws) in scenario.starts.iter().zip(&scenario.draws) {
            let mut at = start.clone();
            for z in draws {
                policy.network().activate(&at.state, &mut here);
                if here.largest() < self.network.activation_threshold && policy.network().len() < most {
                    policy.network_mut().allocate(&at.state);
                }
                if policy.network().len() >= most {
                    return Ok(());
                }
                let seen = map.foresee(&at, &policy.mean(&at))?;
                at = drawn(&at, &seen, z);
            }
        }
        Ok(())
    }

    /// J and its gradient.
    pub(crate) fn climb(
        &self,
        policy: &GaussianPolicy,
        map: &dyn Foresight,
        scenario: &Scenario,
    ) -> Result<Climb, LearnError> {
        let spec = policy.spec();
        let (n, m) = (spec.state.len(), spec.action.len());
        let weights = policy.network().len() * m;
        let gamma = self.network.discount;
        let mut sum = Climb { value: 0.0, gradient: DVector::zeros(weights), falls: 0.0 };
        let mut scale = 0.0;
        for (start, draws) in scenario.starts.iter().zip(&scenario.draws) {
            let mut at = start.clone();
            // Slopes of state and last action by the weights, and of the share of the path that has not fallen.
            let mut of_at = DMatrix::zeros(n + m, weights);
            let (mut share, mut of_share) = (1.0, DVector::zeros(weights));
            let mut weight = 1.0;
            for z in draws {
                let (action, of_action) = policy_slopes(policy, &at, &of_at.rows(0, n).into_owned());
                let (seen, slopes) = map_slopes(map, &at, &action, &self.network)?;
                let mut inputs = DMatrix::zeros(n + 2 * m, weights);
                inputs.rows_mut(0, n + m).copy_from(&of_at);
                inputs.rows_mut(n + m, m).copy_from(&of_action);
                let outputs = slopes * inputs;
                let row = |k: usize| outputs.row(k).transpose();
                sum.value += weight * share * seen.reward;
                sum.gradient += weight * (seen.reward * &of_share + share * row(2 * n));
                sum.falls += share * seen.fall;
                of_share = (1.0 - seen.fall) * of_share - share * row(2 * n + 1);
                share *= 1.0 - seen.fall;
                for (i, z) in z.iter().enumerate() {
                    of_at.set_row(i, &(outputs.row(i) + *z * outputs.row(n + i)));
                }
                for j in 0..m {
                    of_at.set_row(n + j, &outputs.row(2 * n + 2 + j));
                }
                at = drawn(&at, &seen, z);
                scale += weight;
                weight *= gamma;
            }
        }
        sum.value /= scale;
        sum.gradient /= scale;
        Ok(sum)
    }

    /// One step of Adam, then the limits of the weights.
    fn step(
        &self,
        policy: &mut GaussianPolicy,
        trial: usize,
        gradient: &DVector<f64>,
        (first, second): (&mut DVector<f64>, &mut DVector<f64>),
    ) {
        const DECAYS: [f64; 2] = [0.9, 0.99];
        let half = 0.5 * self.config.trials as f64;
        let factor = 1.0 - 0.99 * ((trial as f64 - half) / half).clamp(0.0, 1.0);
        *first = DECAYS[0] * &*first + (1.0 - DECAYS[0]) * gradient;
        *second = DECAYS[1] * &*second + (1.0 - DECAYS[1]) * gradient.component_mul(gradient);
        let [bias, bias_of_squares] = DECAYS.map(|d| 1.0 - d.powi(trial as i32 + 1));
        let m = policy.spec().action.len();
        let bounds = self.network.mean_weight_bounds(policy.spec());
        let within = |j: usize, w: f64, policy: &GaussianPolicy| match bounds.get(j) {
            Some([low, high]) => w.clamp(*low, *high),
            None => {
                let (bound, unit) = (&policy.spec().action[j], policy.action_unit()[j]);
                w.clamp(bound.lower / unit, bound.upper / unit)
            }
        };
        for i in 0..policy.network().len() {
            for j in 0..m {
                let k = i * m + j;
                let along = first[k] / bias / ((second[k] / bias_of_squares).sqrt() + 1e-12);
                let moved = policy.network().weights(i)[j] + self.config.step * factor * along;
                let moved = within(j, moved, policy);
                policy.network_mut().weights_mut(i)[j] = moved;
            }
        }
    }
}

/// The next situation of a path.
fn drawn(at: &Situation, seen: &Foreseen, z: &[f64]) -> Situation {
    let normal = seen.mean.iter().zip(&seen.variance).zip(z);
    Situation {
        state: normal.map(|((mean, variance), z)| mean + variance.sqrt() * z).collect(),
        last_action: seen.applied.clone(),
        goal: at.goal.clone(),
    }
}

/// The mean action, and its slopes by the mean weights where the state has slopes `of_state` by them.
fn policy_slopes(policy: &GaussianPolicy, at: &Situation, of_state: &DMatrix<f64>) -> (Vec<f64>, DMatrix<f64>) {
    let (network, m) = (policy.network(), policy.spec().action.len());
    let mut here = Activations::default();
    network.activate(&at.state, &mut here);
    let slopes = network.slopes(&at.state, &here);
    let mut of_action = DMatrix::zeros(m, of_state.ncols());
    let action = (0..m)
        .map(|j| {
            let unit = policy.action_unit()[j];
            let output = network.output(&here, j);
            let clipped = policy.clip(output, j);
            if (clipped - output * unit).abs() <= 1e-12 * (1.0 + clipped.abs()) {
                for (i, b) in here.normalized().iter().enumerate() {
                    of_action[(j, i * m + j)] += unit * b;
                }
                for (k, slope) in slopes[j].iter().enumerate() {
                    let mut row = of_action.row_mut(j);
                    row += unit * *slope * of_state.row(k);
                }
            }
            clipped
        })
        .collect();
    (action, of_action)
}

/// What the map foresees, and its slopes: rows `mean | sd | reward | fall | applied`, columns
/// `state | last action | action`.
fn map_slopes(
    map: &dyn Foresight,
    at: &Situation,
    action: &[f64],
    scales: &ActorCriticConfig,
) -> Result<(Foreseen, DMatrix<f64>), ProcessError> {
    /// Central differences reach so many widths of a base, or units of the action.
    const REACH: f64 = 1e-3;
    let (n, m) = (at.state.len(), action.len());
    let flat = |s: Foreseen| -> DVector<f64> {
        let sd = s.variance.iter().map(|v| v.sqrt());
        let all = s.mean.iter().copied().chain(sd).chain([s.reward, s.fall]).chain(s.applied.iter().copied());
        DVector::from_iterator(2 * n + 2 + m, all)
    };
    let mut slopes = DMatrix::zeros(2 * n + 2 + m, n + 2 * m);
    let mut column = |k: usize, reach: f64, moved: &dyn Fn(f64) -> Result<Foreseen, ProcessError>| {
        let (ahead, behind) = (flat(moved(reach)?), flat(moved(-reach)?));
        slopes.set_column(k, &((ahead - behind) / (2.0 * reach)));
        Ok::<(), ProcessError>(())
    };
    for k in 0..n {
        column(k, REACH * scales.basis_widths[k], &|by| {
            let mut at = at.clone();
            at.state[k] += by;
            map.foresee(&at, action)
        })?;
    }
    for j in 0..m {
        let reach = REACH * scales.outputs[j].unit;
        if map.remembers() {
            column(n + j, reach, &|by| {
                let mut at = at.clone();
                at.last_action[j] += by;
                map.foresee(&at, action)
            })?;
        }
        column(n + m + j, reach, &|by| {
            let mut action = action.to_vec();
            action[j] += by;
            map.foresee(at, &action)
        })?;
    }
    Ok((map.foresee(at, action)?, slopes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::rand_core::SeedableRng;
    use stridemap_testbed::{LinearGaussianMap, LinearGaussianParameters};

    fn map() -> LinearGaussianMap {
        let p = LinearGaussianParameters { action_bounds: vec![[-50.0, 50.0]], ..LinearGaussianParameters::stepping() };
        LinearGaussianMap::new(LinearGaussianParameters { noise_std: vec![0.2], ..p }).unwrap()
    }

    fn learner(paths: usize, strides: usize) -> Pathwise {
        let config = PathwiseConfig { paths, strides, ..PathwiseConfig::default() };
        Pathwise { network: ActorCriticConfig { discount: 0.6, ..ActorCriticConfig::stepping() }, config }
    }

    /// The gradient is that of its own J by central differences, with three bases and falls of none.
    #[test]
    fn the_gradient_is_that_of_the_value() {
        let (mut map, learner) = (map(), learner(5, 8));
        let scenario = learner.scenario(&mut map, &mut ChaCha8Rng::seed_from_u64(2)).unwrap();
        let network = &learner.network;
        let mut policy = GaussianPolicy::new(map.spec().clone(), &network.basis_widths, &network.units(), 0.5).unwrap();
        for (centre, weight) in [(1.5, 0.2), (2.2, 1.1), (3.0, 1.6)] {
            policy.network_mut().allocate(&[centre]);
            let last = policy.network().len() - 1;
            policy.network_mut().weights_mut(last)[0] = weight;
        }
        let climb = learner.climb(&policy, &map, &scenario).unwrap();
        for base in 0..3 {
            let at = |by: f64| {
                let mut moved = policy.clone();
                moved.network_mut().weights_mut(base)[0] += by;
                learner.climb(&moved, &map, &scenario).unwrap().value
            };
            let numerical = (at(1e-5) - at(-1e-5)) / 2e-5;
            let exact = climb.gradient[base];
            assert!((numerical - exact).abs() < 1e-6 * (1.0 + exact.abs()), "{numerical} {exact}");
        }
    }

    /// With one base the action is a constant: the exact gradient is the slope of the exact value from the start
    /// distribution, and each path's gradient scatters about it.
    #[test]
    fn the_mean_gradient_is_the_exact_one() {
        let (mut map, learner) = (map(), learner(1, 60));
        let (gamma, mean_weight, unit) = (learner.network.discount, 0.4, learner.network.outputs[0].unit);
        let mut policy = GaussianPolicy::new(map.spec().clone(), &[0.5], &[unit], 0.5).unwrap();
        policy.network_mut().allocate(&[2.0]);
        policy.network_mut().weights_mut(0)[0] = mean_weight;
        let none = DVector::zeros(1);
        let value = |action: f64| {
            let v = map.evaluate(&DMatrix::zeros(1, 1), &DVector::from_element(1, action), &none, gamma).unwrap();
            let p = map.parameters();
            v.value(&p.initial_mean) - v.quadratic[(0, 0)] * p.initial_std[0].powi(2)
        };
        let h = 1e-4;
        let exact = unit * (value(mean_weight * unit + h) - value(mean_weight * unit - h)) / (2.0 * h);
        let scale: f64 = (0..60).map(|k| gamma.powi(k)).sum();
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let gradients: Vec<f64> = (0..400)
            .map(|_| {
                let scenario = learner.scenario(&mut map, &mut rng).unwrap();
                scale * learner.climb(&policy, &map, &scenario).unwrap().gradient[0]
            })
            .collect();
        let n = gradients.len() as f64;
        let mean = gradients.iter().sum::<f64>() / n;
        let error = (gradients.iter().map(|g| (g - mean).powi(2)).sum::<f64>() / n / (n - 1.0)).sqrt();
        assert!((mean - exact).abs() < 4.0 * error, "{mean} ± {error}, exact {exact}");
        assert!(error < 0.1 * exact.abs());
    }
}
