//! Dynamic programming in a map: the value function is a Gaussian process over support states \[RK04\].

use nalgebra::{DMatrix, DVector};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use stridemap_gp::{FitOptions, Gp, Hyperparameters, Points};
use stridemap_process::{Action, ActionDimension, Foreseen, Foresight, Situation, State, StrideProcess};

use crate::actor_critic::{ActorCriticConfig, Tally};
use crate::error::{LearnError, Place};
use crate::gaussian_policy::GaussianPolicy;
use crate::learner::{LearnOutcome, Learner, TrialReport};
use crate::network::Activations;
use crate::saved::{KeptPolicy, SavedPolicy};

/// Parameters of [`GpDp`]. The policy's shape and the discount are those of an [`ActorCriticConfig`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GpDpConfig {
    /// Support states, drawn as the process starts; at least 3.
    pub support: usize,
    /// Rounds of policy evaluation and improvement; at least 1. Fewer where no action moves any more.
    pub rounds: usize,
    /// Newton steps for each action in a round; at least 1.
    pub newton_steps: usize,
    /// Actions drawn beside the present one, from the best of which Newton sets out.
    pub candidates: usize,
    /// Most bases of the policy; at least 1.
    pub max_bases: usize,
}

impl Default for GpDpConfig {
    fn default() -> Self {
        Self { support: 40, rounds: 10, newton_steps: 8, candidates: 8, max_bases: 14 }
    }
}

impl GpDpConfig {
    /// Checks every field against its domain.
    ///
    /// # Errors
    ///
    /// [`LearnError::Parameter`] naming the field.
    pub fn validate(&self) -> Result<(), LearnError> {
        for (field, value, least, domain) in [
            ("support", self.support, 3, "at least 3"),
            ("rounds", self.rounds, 1, "at least 1"),
            ("newton_steps", self.newton_steps, 1, "at least 1"),
            ("max_bases", self.max_bases, 1, "at least 1"),
        ] {
            if value < least {
                return Err(LearnError::parameter(field, value, domain));
            }
        }
        Ok(())
    }
}

/// Policy iteration with the value function as a Gaussian process over support states.
///
/// With `x′ ~ N(m, diag(v))` foreseen of a stride, the expectation of the value's squared exponential kernel is known:
///
/// ```text
/// E[k(x′, s)] = σ_f² Π_d √(ℓ_d² / (ℓ_d² + v_d)) exp(−½ (m_d − s_d)² / (ℓ_d² + v_d))       [RK04, eq. (8)]
/// Q(u) = E[r] + γ (1 − P(fall)) (c + Σⱼ αⱼ E[k(x′, sⱼ)]),   α = (K + σₙ² I)⁻¹ (V − c)
/// ```
///
/// *Evaluation*: with the present actions V is the solution of a linear system, one equation a support state, to which
/// the hyperparameters are fitted, twice. *Improvement*: each action climbs Q by Newton's method within its bounds,
/// from the best of itself and some drawn ones. The policy is a network fitted to the actions by least squares, for the
/// robot needs one at every state.
///
/// The last action before a support state is taken to be the action itself, as it is when the gait has settled: where
/// rate limits matter, the policy asks for what it wants in the end. A next state is spread as all are, whether or not
/// it falls.
///
/// # References
///
/// \[RK04\]: see the [crate](crate) documentation.
#[derive(Clone, Debug)]
pub struct GpDp {
    /// The policy's shape, and the discount.
    pub network: ActorCriticConfig,
    /// The parameters.
    pub config: GpDpConfig,
}

impl Learner for GpDp {
    fn improve(
        &mut self,
        process: &mut dyn StrideProcess,
        _initial: Option<&SavedPolicy>,
        rng: &mut ChaCha8Rng,
        observer: &mut dyn FnMut(&TrialReport<'_>),
    ) -> Result<LearnOutcome, LearnError> {
        let config = self.config;
        config.validate()?;
        self.network.validate()?;
        let spec = process.spec().clone();
        let mut policy = GaussianPolicy::new(
            spec.clone(),
            &self.network.basis_widths,
            &self.network.units(),
            self.network.std_scale,
        )?;
        let (at, unit) = (Place { trial: 1, stride: 1 }, self.network.units());
        let mut support = Vec::with_capacity(config.support);
        for _ in 0..config.support {
            let start = process.reset(rng)?;
            at.check_state(&start.state, &spec)?;
            support.push(start);
        }
        let map = process.foresight().ok_or(LearnError::NoForesight { learner: "gp-dp" })?;
        let mut value = Value::unknown(&support, self.network.discount)?;
        let middle = |d: &ActionDimension| 0.5 * (d.lower + d.upper);
        let mut actions: Vec<Action> = vec![spec.action.iter().map(middle).collect(); support.len()];
        let mut trials = Vec::with_capacity(config.rounds);
        for round in 0..config.rounds {
            let mut moved = 0.0_f64;
            for (start, action) in support.iter().zip(&mut actions) {
                let better = self.improved(map, &value, start, action, &spec.action, rng)?;
                let units = better.iter().zip(action.iter()).zip(&unit);
                moved = moved.max(units.map(|((a, b), unit)| ((a - b) / unit).abs()).fold(0.0, f64::max));
                *action = better;
            }
            let seen: Vec<Foreseen> =
                support.iter().zip(&actions).map(|(s, u)| settled(map, s, u)).collect::<Result<_, _>>()?;
            value.evaluate(&seen, rng)?;
            fit_policy(&mut policy, &self.network, config.max_bases, &support, &actions, &value.values)?;
            let mut tally = Tally::default();
            let falls: f64 = seen.iter().map(|s| s.fall).sum();
            tally.add(seen.len(), seen.iter().map(|s| s.reward).sum(), falls.round() as usize);
            let summary = tally.summary(round + 1, policy.network().len());
            observer(&TrialReport { summary: &summary, policy: &policy });
            trials.push(summary);
            if round > 0 && moved < 1e-3 {
                break;
            }
        }
        let strides = trials.len() * support.len();
        Ok(LearnOutcome { policy: policy.to_saved(), trials, strides })
    }
}

impl GpDp {
    /// The action that is best at a support state as the value function stands.
    fn improved(
        &self,
        map: &dyn Foresight,
        value: &Value,
        start: &Situation,
        present: &Action,
        bounds: &[ActionDimension],
        rng: &mut ChaCha8Rng,
    ) -> Result<Action, LearnError> {
        let q = |u: &[f64]| -> Result<f64, LearnError> { Ok(value.ahead(&settled(map, start, u)?)) };
        let mut best = (q(present)?, present.clone());
        for _ in 0..self.config.candidates {
            let drawn: Action = bounds.iter().map(|d| d.lower + (d.upper - d.lower) * rng.random::<f64>()).collect();
            let worth = q(&drawn)?;
            if worth > best.0 {
                best = (worth, drawn);
            }
        }
        newton(&q, best, bounds, &self.network.units(), self.config.newton_steps)
    }
}

/// What is foreseen of a stride by an action that was there before.
fn settled(map: &dyn Foresight, start: &Situation, action: &[f64]) -> Result<Foreseen, LearnError> {
    let at =
        Situation { state: start.state.clone(), last_action: Action::from_slice(action), goal: start.goal.clone() };
    Ok(map.foresee(&at, action)?)
}

/// Climbs from a point with its value within bounds: Newton's steps where the curvature is negative, else along the
/// gradient; each halved until it climbs. Slopes and curvature are central differences.
fn newton(
    q: &dyn Fn(&[f64]) -> Result<f64, LearnError>,
    start: (f64, Action),
    bounds: &[ActionDimension],
    unit: &[f64],
    steps: usize,
) -> Result<Action, LearnError> {
    /// Differences reach so many units of the action.
    const REACH: f64 = 1e-2;
    /// A step along the gradient, in units of the action, before it is halved.
    const ALONG: f64 = 0.5;
    let m = unit.len();
    let (mut worth, mut u) = start;
    for _ in 0..steps {
        // Inside the bounds by the reach, for beyond them nothing changes any more.
        let reach: Vec<f64> =
            (0..m).map(|j| (REACH * unit[j]).min(0.25 * (bounds[j].upper - bounds[j].lower))).collect();
        let centre: Action =
            (0..m).map(|j| u[j].clamp(bounds[j].lower + reach[j], bounds[j].upper - reach[j])).collect();
        // The components that move, from the centre; the others as they are.
        let at = |moves: &[(usize, f64)]| {
            let mut moved = u.clone();
            for (j, sign) in moves {
                moved[*j] = centre[*j] + sign * reach[*j];
            }
            q(&moved)
        };
        let mut gradient = DVector::zeros(m);
        let mut curvature = DMatrix::zeros(m, m);
        for j in 0..m {
            let (ahead, here, behind) = (at(&[(j, 1.0)])?, at(&[(j, 0.0)])?, at(&[(j, -1.0)])?);
            // In steps of the reach: scales of components do not matter.
            gradient[j] = 0.5 * (ahead - behind);
            curvature[(j, j)] = ahead + behind - 2.0 * here;
            for i in 0..j {
                let corners = at(&[(i, 1.0), (j, 1.0)])? + at(&[(i, -1.0), (j, -1.0)])?
                    - at(&[(i, 1.0), (j, -1.0)])?
                    - at(&[(i, -1.0), (j, 1.0)])?;
                (curvature[(i, j)], curvature[(j, i)]) = (0.25 * corners, 0.25 * corners);
            }
        }
        // A component at a bound, with the gradient beyond it, stays.
        let held = |j: usize| {
            (u[j] <= bounds[j].lower && gradient[j] <= 0.0) || (u[j] >= bounds[j].upper && gradient[j] >= 0.0)
        };
        let free: Vec<usize> = (0..m).filter(|j| !held(*j) && reach[*j] > 0.0).collect();
        if free.is_empty() {
            break;
        }
        let g = DVector::from_iterator(free.len(), free.iter().map(|j| gradient[*j]));
        let h = DMatrix::from_fn(free.len(), free.len(), |a, b| -curvature[(free[a], free[b])]);
        let largest = g.amax().max(f64::MIN_POSITIVE);
        let step = h.cholesky().map_or_else(|| g.clone() * (ALONG / REACH / largest), |c| c.solve(&g));
        let mut scale = 1.0;
        let mut climbed = false;
        while scale > 1e-3 && !climbed {
            let mut moved = u.clone();
            for (k, j) in free.iter().enumerate() {
                moved[*j] = (moved[*j] + scale * step[k] * reach[*j]).clamp(bounds[*j].lower, bounds[*j].upper);
            }
            let found = q(&moved)?;
            if found > worth {
                (worth, u, climbed) = (found, moved, true);
            }
            scale *= 0.5;
        }
        if !climbed {
            break;
        }
    }
    Ok(u)
}

/// The value function.
struct Value {
    /// Support states, row by row.
    states: Vec<f64>,
    dims: usize,
    discount: f64,
    /// V at the support states.
    values: Vec<f64>,
    /// c: their mean.
    middle: f64,
    kernel: Option<Hyperparameters>,
    /// α.
    weights: DVector<f64>,
}

impl Value {
    /// Zero everywhere.
    fn unknown(support: &[Situation], discount: f64) -> Result<Self, LearnError> {
        let dims = support.first().map_or(1, |s| s.state.len());
        let states = support.iter().flat_map(|s| s.state.iter().copied()).collect();
        let values = vec![0.0; support.len()];
        Ok(Self { states, dims, discount, values, middle: 0.0, kernel: None, weights: DVector::zeros(support.len()) })
    }

    /// E[k(x′, s)] for each support state; zeros before there is a kernel.
    fn expected_kernel(&self, mean: &State, variance: &State) -> DVector<f64> {
        let Some(h) = &self.kernel else { return DVector::zeros(self.values.len()) };
        let squares: Vec<f64> = h.length_scales.iter().map(|l| l * l).collect();
        let spread: f64 = squares.iter().zip(variance).map(|(l, v)| (l / (l + v)).sqrt()).product();
        let rows = self.states.chunks_exact(self.dims).map(|s| {
            let along = s.iter().zip(mean).zip(squares.iter().zip(variance));
            let exponent: f64 = along.map(|((s, m), (l, v))| (m - s).powi(2) / (l + v)).sum();
            h.signal_variance * spread * (-0.5 * exponent).exp()
        });
        DVector::from_iterator(self.values.len(), rows)
    }

    /// Q of a stride.
    fn ahead(&self, seen: &Foreseen) -> f64 {
        let follows = self.middle + self.expected_kernel(&seen.mean, &seen.variance).dot(&self.weights);
        seen.reward + self.discount * (1.0 - seen.fall) * follows
    }

    /// The value of the present actions, of which the strides were foreseen; the kernel is fitted on the way.
    fn evaluate(&mut self, seen: &[Foreseen], rng: &mut ChaCha8Rng) -> Result<(), LearnError> {
        let n = seen.len();
        if self.kernel.is_none() {
            self.values = seen.iter().map(|s| s.reward / (1.0 - self.discount * (1.0 - s.fall))).collect();
            self.fit(rng)?;
        }
        const FITS: usize = 2;
        for _ in 0..FITS {
            let inverse = self.inverse()?;
            let rewards = DVector::from_iterator(n, seen.iter().map(|s| s.reward));
            let mut system = DMatrix::identity(n, n);
            for (i, s) in seen.iter().enumerate() {
                // E[V(x′)] = c + w (V − c), with c the mean of V.
                let w = inverse.as_ref().map(|k| (k * self.expected_kernel(&s.mean, &s.variance)).transpose());
                let w = w.unwrap_or_else(|| DMatrix::zeros(1, n).row(0).into_owned());
                let rest = (1.0 - w.sum()) / n as f64;
                let share = self.discount * (1.0 - s.fall);
                for j in 0..n {
                    system[(i, j)] -= share * (w[j] + rest);
                }
            }
            let found = system.lu().solve(&rewards);
            let found = found.filter(|v| v.iter().all(|v| v.is_finite()));
            self.values = found.ok_or(Place { trial: 1, stride: 1 }.diverged())?.as_slice().to_vec();
            self.fit(rng)?;
        }
        Ok(())
    }

    /// (K + σₙ² I)⁻¹, if there is a kernel.
    fn inverse(&self) -> Result<Option<DMatrix<f64>>, LearnError> {
        let Some(h) = &self.kernel else { return Ok(None) };
        let n = self.values.len();
        let none = State::from_elem(0.0, self.dims);
        let mut k = DMatrix::zeros(n, n);
        for (i, s) in self.states.chunks_exact(self.dims).enumerate() {
            k.set_column(i, &self.expected_kernel(&State::from_slice(s), &none));
            k[(i, i)] += h.noise_variance + 1e-8 * h.signal_variance;
        }
        let cholesky = k.cholesky().ok_or(Place { trial: 1, stride: 1 }.diverged())?;
        Ok(Some(cholesky.inverse()))
    }

    /// Fits the kernel to the values, and finds the weights.
    fn fit(&mut self, rng: &mut ChaCha8Rng) -> Result<(), LearnError> {
        let n = self.values.len();
        self.middle = self.values.iter().sum::<f64>() / n as f64;
        let y: Vec<f64> = self.values.iter().map(|v| v - self.middle).collect();
        let largest = y.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
        if largest <= 1e-12 * (1.0 + self.middle.abs()) {
            // All alike: the mean says it all.
            (self.kernel, self.weights) = (None, DVector::zeros(n));
            return Ok(());
        }
        let options = FitOptions { starts: 1, ..FitOptions::default() };
        let gp = Gp::fit(Points::new(&self.states, self.dims)?, &y, &options, rng)?;
        self.kernel = Some(gp.hyperparameters().clone());
        if let Some(inverse) = self.inverse()? {
            self.weights = inverse * DVector::from_vec(y);
        }
        Ok(())
    }
}

/// Fits the network to the actions at the support states: bases where none is active, weights by least squares.
fn fit_policy(
    policy: &mut GaussianPolicy,
    network: &ActorCriticConfig,
    most: usize,
    support: &[Situation],
    actions: &[Action],
    values: &[f64],
) -> Result<(), LearnError> {
    /// Added to the diagonal of the normal equations, in support states.
    const RIDGE: f64 = 1e-3;
    let m = policy.spec().action.len();
    let mut here = Activations::default();
    for start in support {
        policy.network().activate(&start.state, &mut here);
        if here.largest() < network.activation_threshold && policy.network().len() < most.min(network.max_bases) {
            policy.network_mut().allocate(&start.state);
        }
    }
    let bases = policy.network().len();
    let mut features = DMatrix::zeros(support.len(), bases);
    for (i, start) in support.iter().enumerate() {
        policy.network().activate(&start.state, &mut here);
        features.row_mut(i).copy_from_slice(here.normalized());
    }
    let normal = features.transpose() * &features + DMatrix::identity(bases, bases) * RIDGE;
    let normal = normal.cholesky().ok_or(Place { trial: 1, stride: 1 }.diverged())?;
    let unit = policy.action_unit().to_vec();
    let fitted = |targets: &mut dyn Iterator<Item = f64>| {
        let y = DVector::from_iterator(support.len(), targets);
        let mean = y.mean();
        normal.solve(&(features.transpose() * y.add_scalar(-mean))).add_scalar(mean)
    };
    let mut columns: Vec<DVector<f64>> = (0..m).map(|j| fitted(&mut actions.iter().map(|u| u[j] / unit[j]))).collect();
    columns.push(fitted(&mut values.iter().copied()));
    let value = policy.value_column();
    for base in 0..bases {
        let weights = policy.network_mut().weights_mut(base);
        for (j, column) in columns.iter().enumerate() {
            weights[if j < m { j } else { value }] = column[base];
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With one length scale and one support state, E[k] is the kernel smoothed by the variance, as a sum shows.
    #[test]
    fn the_expected_kernel_is_that_of_draws() {
        let mut value = Value::unknown(&[[0.4].into()], 0.9).unwrap();
        value.kernel = Some(Hyperparameters { length_scales: vec![0.7], signal_variance: 2.0, noise_variance: 0.01 });
        let (mean, variance) = (State::from_slice(&[0.9]), State::from_slice(&[0.09]));
        let exact = value.expected_kernel(&mean, &variance)[0];
        let width = 1e-3;
        let sum: f64 = (-6000..=6000)
            .map(|i| {
                let z = width * f64::from(i);
                let density = (-0.5 * z * z).exp() / (2.0 * std::f64::consts::PI).sqrt() * width;
                density * 2.0 * (-0.5 * ((0.9 + 0.3 * z - 0.4) / 0.7_f64).powi(2)).exp()
            })
            .sum();
        assert!((exact - sum).abs() < 1e-6, "{exact} {sum}");
    }

    /// A turned bowl whose top lies inside the bounds of one component and beyond those of the other.
    #[test]
    fn newton_climbs_to_the_top_within_bounds() {
        let bowl = |u: &[f64]| -> Result<f64, LearnError> {
            let (a, b) = (u[0] - 1.0, u[1] - 5.0);
            Ok(-(a * a + b * b + a * b))
        };
        let bound = |lower, upper| ActionDimension { name: "u".into(), lower, upper };
        let bounds = [bound(-9.0, 9.0), bound(0.0, 3.0)];
        let start = Action::from_slice(&[-4.0, 0.5]);
        let u = newton(&bowl, (bowl(&start).unwrap(), start), &bounds, &[1.0, 1.0], 20).unwrap();
        // At u₁ = 3, b = −2: 2 a + b = 0, a = 1.
        assert!((u[1] - 3.0).abs() < 1e-9 && (u[0] - 2.0).abs() < 1e-6, "{u:?}");
    }
}
