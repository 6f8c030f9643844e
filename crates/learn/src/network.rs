//! Normalized Gaussian networks \[Doya00\] whose bases are allocated where the states are \[MD01\].

use smallvec::SmallVec;

use crate::error::{LearnError, check_length, check_number};

/// How strongly each base of a network responds to one state: evaluated once, shared by all outputs.
#[derive(Clone, Debug, Default)]
pub struct Activations {
    /// bᵢ(x), summing to one; empty for a network without bases.
    normalized: SmallVec<[f64; 32]>,
    largest: f64,
}

impl Activations {
    /// bᵢ(x) \[MA09, eq. (17)\]: not negative, sum one.
    #[must_use]
    pub fn normalized(&self) -> &[f64] {
        &self.normalized
    }

    /// The largest activation before normalization, maxᵢ aᵢ(x), from 0 to 1; 0 without bases.
    #[must_use]
    pub const fn largest(&self) -> f64 {
        self.largest
    }
}

/// Several functions of a state that share their basis functions:
///
/// ```text
/// fⱼ(x) = Σᵢ wᵢⱼ bᵢ(x),   bᵢ(x) = aᵢ(x) / Σₗ aₗ(x),          [MA09, eq. (17), (24), (25)]
/// aᵢ(x) = exp(−½ Σₖ ((xₖ − cᵢₖ) / sₖ)²)                       [MD01]
/// ```
///
/// with one width `sₖ` per component of the state (a standard deviation, in that component's unit).
/// Far from every centre the outputs go to those of the nearest one. Without bases they are zero.
///
/// # Example
///
/// Midway between two centres each counts half; far to the right only the right one counts.
///
/// ```
/// # use stridemap_learn::NormalizedGaussianNetwork;
/// let mut f = NormalizedGaussianNetwork::new(&[0.5], 1)?;
/// f.allocate(&[0.0]);
/// f.allocate(&[1.0]);
/// f.weights_mut(0)[0] = 2.0;
/// f.weights_mut(1)[0] = 4.0;
/// assert!((f.evaluate(&[0.5])[0] - 3.0).abs() < 1e-12);
/// assert!((f.evaluate(&[100.0])[0] - 4.0).abs() < 1e-12);
/// // At the left centre: a = (1, exp(-2)).
/// let a = f64::exp(-2.0);
/// assert!((f.evaluate(&[0.0])[0] - (2.0 + 4.0 * a) / (1.0 + a)).abs() < 1e-12);
/// # Ok::<(), stridemap_learn::LearnError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct NormalizedGaussianNetwork {
    widths: Vec<f64>,
    outputs: usize,
    /// Centres, one row of `widths.len()` numbers per base.
    centres: Vec<f64>,
    /// Weights, one row of `outputs` numbers per base.
    weights: Vec<f64>,
}

impl NormalizedGaussianNetwork {
    /// A network without bases.
    ///
    /// # Errors
    ///
    /// [`LearnError::Parameter`] for no width at all, a width that is not positive, or no output.
    pub fn new(widths: &[f64], outputs: usize) -> Result<Self, LearnError> {
        if widths.is_empty() {
            return Err(LearnError::parameter("basis_widths", "[]", "one width per component"));
        }
        for &w in widths {
            check_number("basis_widths", w, w > 0.0, "positive and finite")?;
        }
        if outputs == 0 {
            return Err(LearnError::parameter("outputs", outputs, "at least 1"));
        }
        Ok(Self { widths: widths.to_vec(), outputs, centres: Vec::new(), weights: Vec::new() })
    }

    /// A network with given bases: `centres` and `weights` hold one row per base.
    ///
    /// # Errors
    ///
    /// As [`new`](Self::new); [`LearnError::Length`] if rows do not match; [`LearnError::Parameter`]
    /// for NaN or an infinity.
    pub fn from_rows(widths: &[f64], outputs: usize, centres: Vec<f64>, weights: Vec<f64>) -> Result<Self, LearnError> {
        let mut network = Self::new(widths, outputs)?;
        let bases = centres.len() / widths.len();
        check_length("centres", centres.len(), bases * widths.len())?;
        check_length("weights", weights.len(), bases * outputs)?;
        for &c in &centres {
            check_number("centres", c, true, "finite")?;
        }
        for &w in &weights {
            check_number("weights", w, true, "finite")?;
        }
        network.centres = centres;
        network.weights = weights;
        Ok(network)
    }

    /// Number of bases.
    #[must_use]
    pub fn len(&self) -> usize {
        self.centres.len() / self.widths.len()
    }

    /// Whether there is no base yet.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.centres.is_empty()
    }

    /// Number of outputs.
    #[must_use]
    pub const fn outputs(&self) -> usize {
        self.outputs
    }

    /// Width of the bases in each component of the state, in its unit.
    #[must_use]
    pub fn widths(&self) -> &[f64] {
        &self.widths
    }

    /// Centre of a base. Panics, as slices do, if there is no such base; so do the next two.
    #[must_use]
    pub fn centre(&self, base: usize) -> &[f64] {
        let d = self.widths.len();
        &self.centres[base * d..(base + 1) * d]
    }

    /// Weights of a base, one per output.
    #[must_use]
    pub fn weights(&self, base: usize) -> &[f64] {
        &self.weights[base * self.outputs..(base + 1) * self.outputs]
    }

    /// Weights of a base, to be changed.
    #[must_use]
    pub fn weights_mut(&mut self, base: usize) -> &mut [f64] {
        &mut self.weights[base * self.outputs..(base + 1) * self.outputs]
    }

    pub(crate) fn all_weights(&self) -> &[f64] {
        &self.weights
    }

    pub(crate) fn all_weights_mut(&mut self) -> &mut [f64] {
        &mut self.weights
    }

    /// Evaluates all bases at a state, into `activations`.
    ///
    /// A state that is not finite, or of the wrong length, activates nothing: all bᵢ are NaN. No
    /// state, however far away, does so otherwise: the exponents are shifted by the largest.
    pub fn activate(&self, state: &[f64], activations: &mut Activations) {
        let b = &mut activations.normalized;
        b.clear();
        let valid = state.len() == self.widths.len();
        let mut largest_exponent = f64::NEG_INFINITY;
        for centre in self.centres.chunks_exact(self.widths.len()) {
            let mut square = if valid { 0.0 } else { f64::NAN };
            for ((x, c), s) in state.iter().zip(centre).zip(&self.widths) {
                // Beyond what can be squared all bases are equally far.
                let z = ((x - c) / s).clamp(-1e150, 1e150);
                square += z * z;
            }
            let exponent = -0.5 * square;
            largest_exponent = largest_exponent.max(exponent);
            b.push(exponent);
        }
        let mut sum = 0.0;
        for a in b.iter_mut() {
            *a = (*a - largest_exponent).exp();
            sum += *a;
        }
        for a in b.iter_mut() {
            *a /= sum;
        }
        activations.largest = if b.is_empty() { 0.0 } else { largest_exponent.exp() };
    }

    /// One output at a state whose bases were evaluated.
    #[must_use]
    pub fn output(&self, activations: &Activations, output: usize) -> f64 {
        self.weights.iter().skip(output).step_by(self.outputs).zip(&activations.normalized).map(|(w, b)| w * b).sum()
    }

    /// All outputs at a state whose bases were evaluated, into `outputs`.
    pub fn outputs_into(&self, activations: &Activations, outputs: &mut [f64]) {
        outputs.fill(0.0);
        for (row, b) in self.weights.chunks_exact(self.outputs).zip(&activations.normalized) {
            for (f, w) in outputs.iter_mut().zip(row) {
                *f += w * b;
            }
        }
    }

    /// Slopes of all outputs by the components of the state, where the bases were evaluated: a row per output.
    ///
    /// ```text
    /// ∂fⱼ/∂xₖ = Σᵢ wᵢⱼ bᵢ (gᵢₖ − Σₗ bₗ gₗₖ),   gᵢₖ = −(xₖ − cᵢₖ) / sₖ²
    /// ```
    #[must_use]
    pub fn slopes(&self, state: &[f64], activations: &Activations) -> Vec<Vec<f64>> {
        let b = activations.normalized();
        let pull = |i: usize, k: usize| -(state[k] - self.centre(i)[k]) / self.widths[k].powi(2);
        let mut slopes = vec![vec![0.0; self.widths.len()]; self.outputs];
        for k in 0..self.widths.len() {
            let mean: f64 = b.iter().enumerate().map(|(i, b)| b * pull(i, k)).sum();
            for (i, b) in b.iter().enumerate() {
                let moves = b * (pull(i, k) - mean);
                for (row, w) in slopes.iter_mut().zip(self.weights(i)) {
                    row[k] += w * moves;
                }
            }
        }
        slopes
    }

    /// All outputs at a state.
    #[must_use]
    pub fn evaluate(&self, state: &[f64]) -> SmallVec<[f64; 16]> {
        let mut activations = Activations::default();
        self.activate(state, &mut activations);
        let mut outputs = SmallVec::from_elem(0.0, self.outputs);
        self.outputs_into(&activations, &mut outputs);
        outputs
    }

    /// Adds a base at a state. Its weights are the outputs there, so those do not change: they are
    /// a weighted mean of themselves and of the new weights.
    pub fn allocate(&mut self, state: &[f64]) {
        let outputs = self.evaluate(state);
        self.centres.extend_from_slice(state);
        self.weights.extend_from_slice(&outputs);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> NormalizedGaussianNetwork {
        NormalizedGaussianNetwork::from_rows(
            &[0.5, 2.0],
            2,
            vec![0.0, 0.0, 1.0, 1.0, 0.3, -2.0],
            vec![1.0, -1.0, 2.0, 0.5, 3.0, 0.0],
        )
        .unwrap()
    }

    #[test]
    fn a_new_base_leaves_the_outputs_at_its_centre_unchanged() {
        let mut network = example();
        for state in [[0.7, -0.4], [5.0, 9.0], [-80.0, 3.0]] {
            let before = network.evaluate(&state);
            network.allocate(&state);
            let after = network.evaluate(&state);
            for (a, b) in before.iter().zip(&after) {
                assert!((a - b).abs() < 1e-14, "{a} became {b}");
            }
        }
    }

    #[test]
    fn slopes_are_those_of_central_differences() {
        let network = example();
        for state in [[0.7, -0.4], [0.1, 1.5]] {
            let mut here = Activations::default();
            network.activate(&state, &mut here);
            let slopes = network.slopes(&state, &here);
            for k in 0..2 {
                let at = |by: f64| {
                    let mut moved = state;
                    moved[k] += by;
                    network.evaluate(&moved)
                };
                let (ahead, behind) = (at(1e-5), at(-1e-5));
                for j in 0..2 {
                    assert!((slopes[j][k] - (ahead[j] - behind[j]) / 2e-5).abs() < 1e-8);
                }
            }
        }
    }

    #[test]
    fn activations_are_a_partition_of_one_everywhere() {
        let network = example();
        let mut activations = Activations::default();
        for x in [-1e8, -3.0, 0.2, 40.0, 1e8] {
            network.activate(&[x, x], &mut activations);
            let sum: f64 = activations.normalized().iter().sum();
            assert!((sum - 1.0).abs() < 1e-12, "{x}: {sum}");
            assert!((0.0..=1.0).contains(&activations.largest()));
        }
        network.activate(network.centre(1), &mut activations);
        assert!((activations.largest() - 1.0).abs() < 1e-15);
    }

    #[test]
    fn a_bad_state_gives_nan_and_no_panic() {
        let network = example();
        assert!(network.evaluate(&[f64::NAN, 0.0])[0].is_nan());
        assert!(network.evaluate(&[0.0])[0].is_nan());
        assert!(NormalizedGaussianNetwork::new(&[0.0], 1).is_err());
        assert!(NormalizedGaussianNetwork::new(&[f64::NAN], 1).is_err());
    }
}
