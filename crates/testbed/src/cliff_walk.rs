//! A walk that pays more the faster it is, up to a cliff: its best policy is computed on a grid.

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use statrs::distribution::{Continuous, ContinuousCDF, Normal};
use stridemap_process::{
    Action, ActionDimension, Foreseen, Foresight, Goal, ProcessError, ProcessSpec, Situation, State, StateDimension,
    Stride, StrideEnd, StrideProcess, clipped_action,
};

/// Parameters of a [`CliffWalk`]; no units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CliffWalkParameters {
    /// Share of the speed that stays from stride to stride, from 0 to below 1.
    pub keeps: f64,
    /// What the full action adds to the speed; positive.
    pub push: f64,
    /// Standard deviation of the noise; positive.
    pub noise_std: f64,
    /// Beyond this speed it falls.
    pub cliff: f64,
    /// Reward of a fall.
    pub fall_reward: f64,
}

impl Default for CliffWalkParameters {
    fn default() -> Self {
        Self { keeps: 0.6, push: 0.6, noise_std: 0.08, cliff: 1.0, fall_reward: -1.0 }
    }
}

/// `x′ = keeps x + push u + noise`, u from 0 to 1, rewarded by x′ (a speed), and a fall where x′ is beyond the
/// cliff. The best policy keeps a margin that only the noise and the price of falling decide.
#[derive(Clone, Debug)]
pub struct CliffWalk {
    parameters: CliffWalkParameters,
    spec: ProcessSpec,
    state: Option<f64>,
}

/// Values of a policy, or of the best one, at speeds from [`CliffWalk::LOWEST`] to the cliff.
#[derive(Clone, Debug, PartialEq)]
pub struct GridValues {
    /// V(x), evenly spaced.
    pub values: Vec<f64>,
    /// The expected next speed that is best of all, where it can be reached.
    pub best_mean: f64,
}

impl CliffWalk {
    /// Lowest speed of the grid.
    pub const LOWEST: f64 = -0.6;
    /// Points of the grid.
    const POINTS: usize = 321;

    /// A walk that must be reset before its first stride.
    #[must_use]
    pub fn new(parameters: CliffWalkParameters) -> Self {
        let spec = ProcessSpec {
            state: vec![StateDimension { name: "speed".into() }],
            action: vec![ActionDimension { name: "push".into(), lower: 0.0, upper: 1.0 }],
            goal: Vec::new(),
        };
        Self { parameters, spec, state: None }
    }

    fn mean(&self, x: f64, u: f64) -> f64 {
        self.parameters.keeps * x + self.parameters.push * u
    }

    /// Expected reward and probability of a fall of a stride with this expected speed:
    /// `E[r] = m Φ(z) − σ φ(z) + (1 − Φ(z)) r_fall`, `z = (cliff − m) / σ`.
    fn outlook(&self, mean: f64) -> (f64, f64) {
        let p = &self.parameters;
        let z = (p.cliff - mean) / p.noise_std;
        let normal = Normal::standard();
        let safe = normal.cdf(z);
        (mean * safe - p.noise_std * normal.pdf(z) + (1.0 - safe) * p.fall_reward, 1.0 - safe)
    }

    fn grid(&self) -> impl Iterator<Item = f64> {
        let step = (self.parameters.cliff - Self::LOWEST) / (Self::POINTS - 1) as f64;
        (0..Self::POINTS).map(move |i| Self::LOWEST + step * i as f64)
    }

    /// V at a speed by linear interpolation; zero beyond the cliff, the lowest below the grid.
    fn at(&self, values: &[f64], x: f64) -> f64 {
        if x > self.parameters.cliff {
            return 0.0;
        }
        let place = (x - Self::LOWEST) / (self.parameters.cliff - Self::LOWEST) * (Self::POINTS - 1) as f64;
        let place = place.clamp(0.0, (Self::POINTS - 1) as f64);
        let below = (place.floor() as usize).min(Self::POINTS - 2);
        let share = place - below as f64;
        (1.0 - share) * values[below] + share * values[below + 1]
    }

    /// `E[r + γ V(x′)]` of a stride with this expected speed, by 201 midpoints over five standard deviations.
    fn ahead(&self, values: &[f64], mean: f64, discount: f64) -> f64 {
        const MIDPOINTS: i32 = 100;
        let (width, normal) = (5.0 / f64::from(MIDPOINTS), Normal::standard());
        let follows: f64 = (-MIDPOINTS..=MIDPOINTS)
            .map(|i| {
                let z = width * f64::from(i);
                normal.pdf(z) * width * self.at(values, mean + self.parameters.noise_std * z)
            })
            .sum();
        self.outlook(mean).0 + discount * follows
    }

    /// The best values, by value iteration: a stride's worth depends on its expected speed alone, so the best
    /// action is the one whose expected speed is nearest to the best of those in reach.
    #[must_use]
    pub fn optimal(&self, discount: f64) -> GridValues {
        let mut values = vec![0.0; Self::POINTS];
        loop {
            let means: Vec<f64> = self.grid().collect();
            let worth: Vec<f64> = means.iter().map(|m| self.ahead(&values, *m, discount)).collect();
            let within = |x: f64| {
                let (low, high) = (self.mean(x, 0.0), self.mean(x, 1.0));
                let inside = means.iter().zip(&worth).filter(|(m, _)| (low..=high).contains(*m));
                inside.map(|(_, w)| *w).fold(f64::NEG_INFINITY, f64::max)
            };
            let next: Vec<f64> = means.iter().map(|x| within(*x)).collect();
            let change = next.iter().zip(&values).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            values = next;
            if change < 1e-6 {
                let best = means.iter().zip(&worth).max_by(|a, b| a.1.total_cmp(b.1));
                return GridValues { best_mean: best.map_or(0.0, |(m, _)| *m), values };
            }
        }
    }

    /// The value of a deterministic policy from rest, by iterating its values on the grid.
    pub fn value_from_rest(&self, policy: &dyn Fn(f64) -> f64, discount: f64) -> f64 {
        let mut values = vec![0.0; Self::POINTS];
        loop {
            let ahead = |x: f64| self.ahead(&values, self.mean(x, policy(x).clamp(0.0, 1.0)), discount);
            let next: Vec<f64> = self.grid().map(ahead).collect();
            let change = next.iter().zip(&values).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            values = next;
            if change < 1e-4 {
                return self.at(&values, 0.0);
            }
        }
    }

    /// The best value from rest.
    #[must_use]
    pub fn best_from_rest(&self, discount: f64) -> f64 {
        self.at(&self.optimal(discount).values, 0.0)
    }
}

impl Foresight for CliffWalk {
    fn foresee(&self, at: &Situation, action: &[f64]) -> Result<Foreseen, ProcessError> {
        let applied = clipped_action(&self.spec, action)?;
        let Some(&x) = at.state.first() else {
            return Err(ProcessError::Length { what: "state", expected: 1, found: 0 });
        };
        let mean = self.mean(x, applied[0]);
        let (reward, fall) = self.outlook(mean);
        let variance = State::from_slice(&[self.parameters.noise_std.powi(2)]);
        Ok(Foreseen { applied, mean: State::from_slice(&[mean]), variance, reward, fall })
    }
}

impl StrideProcess for CliffWalk {
    fn spec(&self) -> &ProcessSpec {
        &self.spec
    }

    /// Anywhere from rest to the cliff.
    fn reset(&mut self, rng: &mut ChaCha8Rng) -> Result<Situation, ProcessError> {
        let x = self.parameters.cliff * rand::Rng::random::<f64>(rng);
        self.state = Some(x);
        Ok(Situation { state: State::from_slice(&[x]), last_action: Action::from_slice(&[0.0]), goal: Goal::new() })
    }

    fn stride(&mut self, action: &[f64], rng: &mut ChaCha8Rng) -> Result<Stride, ProcessError> {
        let applied = clipped_action(&self.spec, action)?;
        let x = self.state.take().ok_or(ProcessError::NotReset)?;
        let z: f64 = StandardNormal.sample(rng);
        let next = self.mean(x, applied[0]) + self.parameters.noise_std * z;
        let fell = next > self.parameters.cliff;
        self.state = (!fell).then_some(next);
        let (reward, end) =
            if fell { (self.parameters.fall_reward, StrideEnd::Fell) } else { (next, StrideEnd::Crossing) };
        let next = Situation { state: State::from_slice(&[next]), last_action: applied, goal: Goal::new() };
        Ok(Stride { next, reward, end })
    }

    fn foresight(&self) -> Option<&dyn Foresight> {
        Some(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    /// The grid's best value is that of the policy it means, and roll-outs of that policy earn it.
    #[test]
    fn the_best_value_is_earned_by_the_best_policy() {
        let (gamma, mut map) = (0.9, CliffWalk::new(CliffWalkParameters::default()));
        let best = map.optimal(gamma);
        assert!((0.6..0.9).contains(&best.best_mean), "{}", best.best_mean);
        let policy = |x: f64| ((best.best_mean - 0.6 * x) / 0.6).clamp(0.0, 1.0);
        let (value, optimum) = (map.value_from_rest(&policy, gamma), map.best_from_rest(gamma));
        assert!((value - optimum).abs() < 1e-3 * optimum, "{value} {optimum}");
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let returns: Vec<f64> = (0..4000)
            .map(|_| {
                map.reset(&mut rng).unwrap();
                map.state = Some(0.0);
                let (mut sum, mut weight) = (0.0, 1.0);
                let mut x = 0.0;
                while weight > 1e-4 {
                    let stride = map.stride(&[policy(x)], &mut rng).unwrap();
                    sum += weight * stride.reward;
                    weight *= if stride.end == StrideEnd::Fell { 0.0 } else { gamma };
                    x = stride.next.state[0];
                }
                sum
            })
            .collect();
        let mean = returns.iter().sum::<f64>() / 4000.0;
        let std = (returns.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 4000.0).sqrt();
        assert!((mean - value).abs() < 4.0 * std / 4000_f64.sqrt() + 2e-3, "{mean} {value}");
    }

    /// What is foreseen of a stride is what strides do.
    #[test]
    fn foresight_agrees_with_strides() {
        let mut map = CliffWalk::new(CliffWalkParameters::default());
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let (mut reward, mut falls) = (0.0, 0.0);
        let n = 20_000;
        for _ in 0..n {
            map.state = Some(0.6);
            let stride = map.stride(&[0.95], &mut rng).unwrap();
            reward += stride.reward / f64::from(n);
            falls += f64::from(u8::from(stride.end == StrideEnd::Fell)) / f64::from(n);
        }
        let seen = map.foresee(&[0.6].into(), &[0.95]).unwrap();
        assert!((reward - seen.reward).abs() < 0.02 && (falls - seen.fall).abs() < 0.01, "{seen:?} {reward} {falls}");
    }
}
