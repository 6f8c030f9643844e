//! A linear map with normal noise and a quadratic reward: everything about it is known.

use nalgebra::{DMatrix, DVector};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use stridemap_process::{
    Action, ActionDimension, Foreseen, Foresight, Goal, MeanMap, ProcessError, ProcessSpec, Situation, State,
    StateDimension, Stride, StrideEnd, StrideProcess, clipped_action,
};

use crate::linear_quadratic::{NoFeedback, linear_quadratic_feedback};

/// Parameters of a [`LinearGaussianMap`]; n states, m actions, no units.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearGaussianParameters {
    /// A, n rows of n.
    pub a: Vec<Vec<f64>>,
    /// B, n rows of m.
    pub b: Vec<Vec<f64>>,
    /// c, n.
    pub offset: Vec<f64>,
    /// Standard deviations of the noise, n; not negative.
    pub noise_std: Vec<f64>,
    /// The state that is rewarded most, n.
    pub target: Vec<f64>,
    /// Q, diagonal, n; not negative.
    pub state_cost: Vec<f64>,
    /// R, diagonal, m; not negative.
    pub action_cost: Vec<f64>,
    /// Means and standard deviations of the state after a reset, n each.
    pub initial_mean: Vec<f64>,
    /// See `initial_mean`; not negative.
    pub initial_std: Vec<f64>,
    /// Bounds of the actions, m pairs, finite, the lower one first.
    pub action_bounds: Vec<[f64; 2]>,
    /// A stride that ends further from the target than this in some component is a fall, with
    /// reward −1. With `None` nothing falls and the answers below are exact.
    pub fall_beyond: Option<f64>,
}

impl LinearGaussianParameters {
    /// A map like that of a biped stepping in place, in degrees: `x′ = 2 + 0.78 (x − 2) −
    /// 0.137 (u − 2) + 0.04 n`, rewarded by −0.1 (2 − x′)² \[MA09, eq. (27)\], started widely about
    /// the target.
    #[must_use]
    pub fn stepping() -> Self {
        Self {
            a: vec![vec![0.78]],
            b: vec![vec![-0.137]],
            offset: vec![2.0 - 0.78 * 2.0 + 0.137 * 2.0],
            noise_std: vec![0.04],
            target: vec![2.0],
            state_cost: vec![0.1],
            action_cost: vec![0.0],
            initial_mean: vec![2.25],
            initial_std: vec![1.0],
            action_bounds: vec![[-1.5, 5.0]],
            fall_beyond: None,
        }
    }
}

/// `x′ = A x + B u + c + n`, `n ~ N(0, diag(noise_std²))`, with reward
/// `r = −(x′ − x_d)ᵀ Q (x′ − x_d) − uᵀ R u`.
///
/// # Example
///
/// ```
/// # use stridemap_testbed::*;
/// let mut quiet = LinearGaussianParameters::stepping();
/// quiet.noise_std = vec![0.0];
/// let map = LinearGaussianMap::new(quiet)?;
/// // Without noise and with a free action the best policy arrives at 2 in one stride: gain A / −B.
/// let best = map.optimal(0.95)?;
/// assert!((best.gain[(0, 0)] - 0.78 / 0.137).abs() < 1e-9);
/// assert!((best.action_at(&[2.0])[0] - 2.0).abs() < 1e-9);
/// assert!(best.value(&[5.0]).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct LinearGaussianMap {
    parameters: LinearGaussianParameters,
    spec: ProcessSpec,
    state: Option<State>,
}

/// A linear policy of a linear-Gaussian map, and its exact value, bounds and falls left aside:
/// `u = K x + k` and `V(x) = −(yᵀ P y + 2 pᵀ y + s)` with `y = x − x_d`.
#[derive(Clone, Debug, PartialEq)]
pub struct QuadraticValue {
    /// K, m by n.
    pub gain: DMatrix<f64>,
    /// k, m.
    pub offset: DVector<f64>,
    /// P, n by n.
    pub quadratic: DMatrix<f64>,
    /// p, n.
    pub linear: DVector<f64>,
    /// s.
    pub constant: f64,
    target: DVector<f64>,
}

impl QuadraticValue {
    /// V(x).
    #[must_use]
    pub fn value(&self, state: &[f64]) -> f64 {
        let y = DVector::from_column_slice(state) - &self.target;
        -(y.dot(&(&self.quadratic * &y)) + 2.0 * self.linear.dot(&y) + self.constant)
    }

    /// K x + k.
    #[must_use]
    pub fn action_at(&self, state: &[f64]) -> Action {
        let u = &self.gain * DVector::from_column_slice(state) + &self.offset;
        u.iter().copied().collect()
    }
}

impl LinearGaussianMap {
    /// A map that must be reset before its first stride.
    ///
    /// # Errors
    ///
    /// [`ProcessError::Length`] or [`ProcessError::Parameter`] naming the parameter.
    pub fn new(parameters: LinearGaussianParameters) -> Result<Self, ProcessError> {
        let p = &parameters;
        let (n, m) = (p.a.len(), p.action_bounds.len());
        let rows =
            p.a.iter()
                .map(|row| ("a row of a", row.len(), n))
                .chain(p.b.iter().map(|row| ("a row of b", row.len(), m)));
        let vectors = [
            ("offset", &p.offset, f64::MIN, n),
            ("target", &p.target, f64::MIN, n),
            ("initial_mean", &p.initial_mean, f64::MIN, n),
            ("noise_std", &p.noise_std, 0.0, n),
            ("state_cost", &p.state_cost, 0.0, n),
            ("action_cost", &p.action_cost, 0.0, m),
            ("initial_std", &p.initial_std, 0.0, n),
        ];
        let lengths = vectors.iter().map(|(what, values, _, expected)| (*what, values.len(), *expected));
        for (what, found, expected) in rows.chain(lengths).chain([("b", p.b.len(), n)]) {
            if found != expected {
                return Err(ProcessError::Length { what, expected, found });
            }
        }
        let matrices = p.a.iter().chain(&p.b).map(|row| ("a, b", row, f64::MIN, n));
        for (name, values, least, _) in matrices.chain(vectors) {
            if let Some(&value) = values.iter().find(|v| !(v.is_finite() && **v >= least)) {
                return Err(ProcessError::Parameter {
                    name,
                    value,
                    requirement: "must be finite, and a cost or spread not negative",
                });
            }
        }
        for &[lower, upper] in &p.action_bounds {
            if !(lower.is_finite() && upper.is_finite() && lower <= upper) {
                let requirement = "bounds must be finite, the lower one first";
                return Err(ProcessError::Parameter { name: "action_bounds", value: lower, requirement });
            }
        }
        let spec = ProcessSpec {
            state: (0..n).map(|i| StateDimension { name: format!("x{i}") }).collect(),
            action: p
                .action_bounds
                .iter()
                .enumerate()
                .map(|(j, &[lower, upper])| ActionDimension { name: format!("u{j}"), lower, upper })
                .collect(),
            goal: Vec::new(),
        };
        Ok(Self { parameters, spec, state: None })
    }

    /// The parameters.
    #[must_use]
    pub const fn parameters(&self) -> &LinearGaussianParameters {
        &self.parameters
    }

    /// The policy of greatest discounted reward, and its value: a Riccati iteration for K and P, and
    /// the affine part by iterating `p`. Bounds and falls are left aside.
    ///
    /// # Errors
    ///
    /// [`NoFeedback`] if there is none.
    pub fn optimal(&self, discount: f64) -> Result<QuadraticValue, NoFeedback> {
        let s = self.system();
        let feedback = linear_quadratic_feedback(&s.a, &s.b, &s.q, &s.r, discount)?;
        let (gain, p_matrix) = (feedback.gain, feedback.cost_to_go);
        let m_matrix = &s.q + discount * &p_matrix;
        let curvature = &s.r + s.b.transpose() * &m_matrix * &s.b;
        let inverse = curvature.try_inverse().ok_or(NoFeedback("R + Bᵀ M B is singular"))?;
        // In y = x − x_d, y′ = A y + B u + d.
        let d = &s.a * &s.target + &s.offset - &s.target;
        let mut p = DVector::zeros(s.target.len());
        let mut k = DVector::zeros(s.r.nrows());
        for _ in 0..100_000 {
            k = -&inverse * s.b.transpose() * (&m_matrix * &d + discount * &p);
            let closed = &s.a + &s.b * &gain;
            let f = &s.b * &k + &d;
            let next = closed.transpose() * (&m_matrix * f + discount * &p) + gain.transpose() * &s.r * &k;
            let change = (&next - &p).amax();
            p = next;
            if change <= 1e-14 * p.amax() {
                break;
            }
        }
        let offset: DVector<f64> = k - &gain * &s.target;
        self.evaluate(&gain, &offset, &DVector::zeros(s.r.nrows()), discount)
    }

    /// The value of `u ~ N(K x + k, diag(std²))`, bounds and falls left aside.
    ///
    /// ```text
    /// P = Fᵀ M F + Kᵀ R K,   F = A + B K,   M = Q + γ P
    /// p = Fᵀ (M f + γ p) + Kᵀ R k_y
    /// s = fᵀ M f + 2 γ pᵀ f + k_yᵀ R k_y + tr(M N) + Σ_j std_j² (R + Bᵀ M B)_jj + γ s
    /// ```
    ///
    /// with `f = B k_y + A x_d + c − x_d`, `k_y = k + K x_d` and N the covariance of the noise.
    ///
    /// # Errors
    ///
    /// [`NoFeedback`] if the value is infinite.
    pub fn evaluate(
        &self,
        gain: &DMatrix<f64>,
        offset: &DVector<f64>,
        std: &DVector<f64>,
        discount: f64,
    ) -> Result<QuadraticValue, NoFeedback> {
        let s = self.system();
        let n = s.target.len();
        let closed = &s.a + &s.b * gain;
        let k = offset + gain * &s.target;
        let f = &s.b * &k + &s.a * &s.target + &s.offset - &s.target;
        let (mut p_matrix, mut p) = (DMatrix::zeros(n, n), DVector::zeros(n));
        let mut converged = false;
        for _ in 0..100_000 {
            let m_matrix = &s.q + discount * &p_matrix;
            let next_matrix = closed.transpose() * &m_matrix * &closed + gain.transpose() * &s.r * gain;
            let next = closed.transpose() * (&m_matrix * &f + discount * &p) + gain.transpose() * &s.r * &k;
            let change = (&next_matrix - &p_matrix).amax().max((&next - &p).amax());
            let size = next_matrix.amax().max(next.amax());
            (p_matrix, p) = (next_matrix, next);
            if change <= 1e-14 * size {
                converged = true;
                break;
            }
        }
        let m_matrix = &s.q + discount * &p_matrix;
        let by_action = &s.r + s.b.transpose() * &m_matrix * &s.b;
        let per_stride = f.dot(&(&m_matrix * &f))
            + 2.0 * discount * p.dot(&f)
            + k.dot(&(&s.r * &k))
            + (0..n).map(|i| m_matrix[(i, i)] * self.parameters.noise_std[i].powi(2)).sum::<f64>()
            + std.iter().enumerate().map(|(j, v)| by_action[(j, j)] * v * v).sum::<f64>();
        let constant = per_stride / (1.0 - discount);
        if !(converged && constant.is_finite()) {
            return Err(NoFeedback("the policy's value is infinite"));
        }
        Ok(QuadraticValue {
            gain: gain.clone(),
            offset: offset.clone(),
            quadratic: p_matrix,
            linear: p,
            constant,
            target: s.target,
        })
    }

    fn system(&self) -> System {
        let p = &self.parameters;
        let (n, m) = (p.a.len(), p.action_bounds.len());
        System {
            a: DMatrix::from_row_iterator(n, n, p.a.iter().flatten().copied()),
            b: DMatrix::from_row_iterator(n, m, p.b.iter().flatten().copied()),
            q: DMatrix::from_diagonal(&DVector::from_column_slice(&p.state_cost)),
            r: DMatrix::from_diagonal(&DVector::from_column_slice(&p.action_cost)),
            offset: DVector::from_column_slice(&p.offset),
            target: DVector::from_column_slice(&p.target),
        }
    }

    fn mean(&self, state: &[f64], action: &[f64]) -> State {
        let p = &self.parameters;
        p.offset
            .iter()
            .zip(p.a.iter().zip(&p.b))
            .map(|(c, (a, b))| {
                let ax: f64 = a.iter().zip(state).map(|(a, x)| a * x).sum();
                let bu: f64 = b.iter().zip(action).map(|(b, u)| b * u).sum();
                c + ax + bu
            })
            .collect()
    }
}

/// The parameters as matrices.
struct System {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    q: DMatrix<f64>,
    r: DMatrix<f64>,
    offset: DVector<f64>,
    target: DVector<f64>,
}

impl MeanMap for LinearGaussianMap {
    fn mean_next_state(&self, at: &Situation, action: &[f64]) -> Result<State, ProcessError> {
        let (expected, found) = (self.spec.state.len(), at.state.len());
        if found != expected {
            return Err(ProcessError::Length { what: "state", expected, found });
        }
        Ok(self.mean(&at.state, &clipped_action(&self.spec, action)?))
    }
}

/// The expected reward is exact, and nothing is foreseen of falls.
impl Foresight for LinearGaussianMap {
    fn foresee(&self, at: &Situation, action: &[f64]) -> Result<Foreseen, ProcessError> {
        let p = &self.parameters;
        let applied = clipped_action(&self.spec, action)?;
        let mean = self.mean_next_state(at, &applied)?;
        let variance: State = p.noise_std.iter().map(|s| s * s).collect();
        let of_state = (0..mean.len()).map(|i| p.state_cost[i] * ((mean[i] - p.target[i]).powi(2) + variance[i]));
        let of_action = applied.iter().zip(&p.action_cost).map(|(u, cost)| cost * u * u);
        let reward = -of_state.chain(of_action).sum::<f64>();
        Ok(Foreseen { applied, mean, variance, reward, fall: 0.0 })
    }
}

impl StrideProcess for LinearGaussianMap {
    fn spec(&self) -> &ProcessSpec {
        &self.spec
    }

    fn foresight(&self) -> Option<&dyn Foresight> {
        self.parameters.fall_beyond.is_none().then_some(self as &dyn Foresight)
    }

    fn reset(&mut self, rng: &mut ChaCha8Rng) -> Result<Situation, ProcessError> {
        let p = &self.parameters;
        let state: State = p
            .initial_mean
            .iter()
            .zip(&p.initial_std)
            .map(|(mean, std)| {
                let z: f64 = StandardNormal.sample(rng);
                mean + std * z
            })
            .collect();
        self.state = Some(state.clone());
        Ok(Situation {
            last_action: self.parameters.action_bounds.iter().map(|[l, h]| 0_f64.clamp(*l, *h)).collect(),
            state,
            goal: Goal::new(),
        })
    }

    fn stride(&mut self, action: &[f64], rng: &mut ChaCha8Rng) -> Result<Stride, ProcessError> {
        let action = clipped_action(&self.spec, action)?;
        let state = self.state.take().ok_or(ProcessError::NotReset)?;
        let mut next_state = self.mean(&state, &action);
        let p = &self.parameters;
        let mut reward = 0.0;
        let mut fell = false;
        for (i, x) in next_state.iter_mut().enumerate() {
            let z: f64 = StandardNormal.sample(rng);
            *x += p.noise_std[i] * z;
            let distance = *x - p.target[i];
            reward -= p.state_cost[i] * distance * distance;
            fell |= p.fall_beyond.is_some_and(|limit| distance.abs() > limit);
        }
        for (u, cost) in action.iter().zip(&p.action_cost) {
            reward -= cost * u * u;
        }
        self.state = (!fell).then(|| next_state.clone());
        let next = Situation { state: next_state, last_action: action, goal: Goal::new() };
        let (reward, end) = if fell { (-1.0, StrideEnd::Fell) } else { (reward, StrideEnd::Crossing) };
        Ok(Stride { next, reward, end })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use stridemap_map::{ReturnLine, fixed_point};

    fn planar() -> LinearGaussianMap {
        LinearGaussianMap::new(LinearGaussianParameters {
            a: vec![vec![0.9, 0.2], vec![-0.3, 0.7]],
            b: vec![vec![0.5], vec![0.3]],
            offset: vec![0.1, -0.2],
            noise_std: vec![0.1, 0.2],
            target: vec![0.5, 0.3],
            state_cost: vec![1.0, 0.4],
            action_cost: vec![0.2],
            initial_mean: vec![1.0, -1.0],
            initial_std: vec![0.0, 0.0],
            action_bounds: vec![[-100.0, 100.0]],
            fall_beyond: None,
        })
        .unwrap()
    }

    /// Discounted rewards of roll-outs agree with the exact value, for the optimal policy and for a
    /// perturbed one that explores; and the optimal one is better.
    #[test]
    fn values_are_those_of_roll_outs() {
        let mut map = planar();
        let gamma = 0.9;
        let best = map.optimal(gamma).unwrap();
        let other = map
            .evaluate(
                &(&best.gain + DMatrix::from_row_slice(1, 2, &[0.2, -0.1])),
                &best.offset.add_scalar(0.3),
                &DVector::from_element(1, 0.4),
                gamma,
            )
            .unwrap();
        assert!(best.value(&[1.0, -1.0]) > other.value(&[1.0, -1.0]));
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for (policy, std) in [(&best, 0.0), (&other, 0.4)] {
            let returns: Vec<f64> = (0..20_000)
                .map(|_| {
                    let mut x = map.reset(&mut rng).unwrap().state;
                    let (mut sum, mut weight) = (0.0, 1.0);
                    while weight > 1e-6 {
                        let z: f64 = StandardNormal.sample(&mut rng);
                        let u = policy.action_at(&x)[0] + std * z;
                        let stride = map.stride(&[u], &mut rng).unwrap();
                        sum += weight * stride.reward;
                        weight *= gamma;
                        x = stride.next.state;
                    }
                    sum
                })
                .collect();
            let n = returns.len() as f64;
            let mean = returns.iter().sum::<f64>() / n;
            let variance = returns.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
            let exact = policy.value(&[1.0, -1.0]);
            assert!((mean - exact).abs() < 4.0 * (variance / n).sqrt(), "{mean} is not {exact}");
        }
    }

    #[test]
    fn no_nearby_linear_policy_is_better_than_the_optimal_one() {
        let map = planar();
        let best = map.optimal(0.9).unwrap();
        let none = DVector::zeros(1);
        for x in [[1.0, -1.0], [0.5, 0.3], [-3.0, 2.0]] {
            let optimum = best.value(&x);
            for sign in [-1e-2, 1e-2] {
                for j in 0..2 {
                    let mut gain = best.gain.clone();
                    gain[j] += sign;
                    assert!(map.evaluate(&gain, &best.offset, &none, 0.9).unwrap().value(&x) < optimum);
                }
                let offset = best.offset.add_scalar(sign);
                assert!(map.evaluate(&best.gain, &offset, &none, 0.9).unwrap().value(&x) < optimum);
            }
        }
    }

    /// Closed loop with multiplier a: the fixed point by Newton is exact, and the line through pairs
    /// two strides apart has slope a².
    #[test]
    fn fixed_point_and_return_line_are_the_known_ones() {
        let mut parameters = LinearGaussianParameters::stepping();
        parameters.action_bounds = vec![[-50.0, 50.0]]; // never clipped
        let mut map = LinearGaussianMap::new(parameters).unwrap();
        let policy = |at: &Situation| Action::from_slice(&[2.1 + 1.5 * (at.state[0] - 2.0)]);
        let a = 0.78 - 0.137 * 1.5;
        let exact = 2.0 - 0.137 * 0.1 / (1.0 - a);
        let found = fixed_point(&map, &policy, &[3.0], &[0.1]).unwrap();
        assert!((found.state[0] - exact).abs() < 1e-9);
        assert!((found.multipliers[0].re - a).abs() < 1e-9);

        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let pairs: Vec<_> = (0..1000)
            .map(|_| {
                let pushed = map.reset(&mut rng).unwrap();
                let once = map.stride(&policy(&pushed), &mut rng).unwrap().next;
                let twice = map.stride(&policy(&once), &mut rng).unwrap().next;
                (pushed.state[0], twice.state[0])
            })
            .collect();
        let line = ReturnLine::fit(&pairs).unwrap();
        assert!((line.slope - a * a).abs() < 4.0 * line.slope_std_error);
        let error = line.fixed_point_std_error().unwrap();
        assert!((line.fixed_point().unwrap() - exact).abs() < 4.0 * error);
    }
}
