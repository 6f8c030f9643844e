//! Discounted linear-quadratic feedback by iterating the Riccati equation.

use nalgebra::DMatrix;

/// Why there is no feedback.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoFeedback(pub &'static str);

impl std::fmt::Display for NoFeedback {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "the Riccati iteration found no feedback: {}", self.0)
    }
}

impl std::error::Error for NoFeedback {}

/// The optimal feedback `u = K x` and the matrix of its cost-to-go `xᵀ P x`.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearFeedback {
    /// K, m by n.
    pub gain: DMatrix<f64>,
    /// P, n by n, symmetric.
    pub cost_to_go: DMatrix<f64>,
}

/// The feedback that minimises `Σ γⁱ (x(i+1)ᵀ Q x(i+1) + u(i)ᵀ R u(i))` for `x(i+1) = A x(i) + B u(i)`.
///
/// The state is charged where the stride ends, as the paper's rewards are \[MA09, eqs. (18), (27)\]:
///
/// ```text
/// M = Q + γ P,   K = −(R + Bᵀ M B)⁻¹ Bᵀ M A,
/// P = (A + B K)ᵀ M (A + B K) + Kᵀ R K              [Bert12, sec. 4.2, with the cost moved by a stride]
/// ```
///
/// # Arguments
///
/// - `a`, `b` – A, n by n, and B, n by m.
/// - `state_cost`, `action_cost` – Q, n by n, and R, m by m; symmetric, not negative. R may be zero
///   where `Bᵀ Q B` is positive.
/// - `discount` – γ, from 0 to 1.
///
/// # Errors
///
/// [`NoFeedback`] if sizes do not agree, `R + Bᵀ M B` is not positive, or 10 000 iterations do not
/// converge to a part in 10¹².
///
/// # Example
///
/// With R = 0 the best that a scalar can do is to arrive at zero at once: K = −A / B.
///
/// ```
/// # use nalgebra::dmatrix;
/// # use stridemap_testbed::linear_quadratic_feedback;
/// let best = linear_quadratic_feedback(
///     &dmatrix![0.8], &dmatrix![-0.2], &dmatrix![1.0], &dmatrix![0.0], 0.95)?;
/// assert!((best.gain[0] - 4.0).abs() < 1e-12);
/// // A = B = Q = R = 1, γ = 1: P = M / (1 + M) with M = 1 + P, so P² + P = 1, the golden ratio's.
/// let one = dmatrix![1.0];
/// let best = linear_quadratic_feedback(&one, &one, &one, &one, 1.0)?;
/// assert!((best.cost_to_go[0] - (5f64.sqrt() - 1.0) / 2.0).abs() < 1e-12);
/// # Ok::<(), stridemap_testbed::NoFeedback>(())
/// ```
pub fn linear_quadratic_feedback(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    state_cost: &DMatrix<f64>,
    action_cost: &DMatrix<f64>,
    discount: f64,
) -> Result<LinearFeedback, NoFeedback> {
    const MOST_ITERATIONS: usize = 10_000;
    const TOLERANCE: f64 = 1e-12;
    let (n, m) = (a.nrows(), b.ncols());
    let (square, inputs) = ((n, n), (m, m));
    if (a.shape(), b.nrows(), state_cost.shape(), action_cost.shape()) != (square, n, square, inputs) {
        return Err(NoFeedback("the sizes of A, B, Q and R do not agree"));
    }
    if !(0.0..=1.0).contains(&discount) {
        return Err(NoFeedback("the discount must be from 0 to 1"));
    }
    let mut p = DMatrix::zeros(n, n);
    for _ in 0..MOST_ITERATIONS {
        let m_matrix = state_cost + discount * &p;
        let gain = greedy_gain(a, b, &m_matrix, action_cost)?;
        let closed = a + b * &gain;
        let mut next = closed.transpose() * &m_matrix * &closed + gain.transpose() * action_cost * &gain;
        next = 0.5 * (&next + next.transpose());
        let change = (&next - &p).amax();
        p = next;
        if !change.is_finite() {
            return Err(NoFeedback("the cost-to-go is not finite"));
        }
        if change <= TOLERANCE * p.amax().max(f64::MIN_POSITIVE) {
            let gain = greedy_gain(a, b, &(state_cost + discount * &p), action_cost)?;
            return Ok(LinearFeedback { gain, cost_to_go: p });
        }
    }
    Err(NoFeedback("no convergence; is the map stabilisable?"))
}

/// K = −(R + Bᵀ M B)⁻¹ Bᵀ M A.
fn greedy_gain(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    m_matrix: &DMatrix<f64>,
    action_cost: &DMatrix<f64>,
) -> Result<DMatrix<f64>, NoFeedback> {
    let curvature = action_cost + b.transpose() * m_matrix * b;
    if curvature.iter().any(|v| !v.is_finite()) {
        return Err(NoFeedback("A, B, Q or R is not finite"));
    }
    let cholesky = curvature
        .cholesky()
        .ok_or(NoFeedback("R + Bᵀ M B is not positive: some action has neither cost nor effect"))?;
    Ok(-cholesky.solve(&(b.transpose() * m_matrix * a)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::dmatrix;

    /// No other gain has a smaller cost, summed over the strides of a roll-out.
    #[test]
    fn the_gain_minimises_the_rolled_out_cost() {
        let (a, b) = (dmatrix![1.1, 0.3; -0.2, 0.7], dmatrix![0.5; -0.4]);
        let (q, r, gamma) = (dmatrix![1.0, 0.2; 0.2, 0.5], dmatrix![0.3], 0.95);
        let best = linear_quadratic_feedback(&a, &b, &q, &r, gamma).unwrap();
        let cost = |gain: &DMatrix<f64>| {
            let (mut x, mut sum, mut weight) = (dmatrix![1.0; -2.0], 0.0, 1.0);
            for _ in 0..2000 {
                let u = gain * &x;
                x = &a * &x + &b * &u;
                sum += weight * ((x.transpose() * &q * &x)[0] + (u.transpose() * &r * &u)[0]);
                weight *= gamma;
            }
            sum
        };
        let x = dmatrix![1.0; -2.0];
        let optimum = cost(&best.gain);
        assert!((optimum - (x.transpose() * &best.cost_to_go * &x)[0]).abs() < 1e-9 * optimum);
        for d in [dmatrix![0.01, 0.0], dmatrix![0.0, 0.01]] {
            assert!(cost(&(&best.gain + &d)) > optimum && cost(&(&best.gain - &d)) > optimum);
        }
    }

    #[test]
    fn what_has_no_solution_is_refused() {
        let one = dmatrix![1.0];
        let zero = dmatrix![0.0];
        assert!(linear_quadratic_feedback(&one, &zero, &one, &zero, 0.9).is_err());
        assert!(linear_quadratic_feedback(&dmatrix![2.0], &zero, &one, &one, 1.0).is_err());
        assert!(linear_quadratic_feedback(&dmatrix![f64::NAN], &one, &one, &one, 1.0).is_err());
        assert!(linear_quadratic_feedback(&dmatrix![1.0, 0.0], &one, &one, &one, 1.0).is_err());
    }
}
