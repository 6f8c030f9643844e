//! Fixed points of a mean map under a policy, and their Floquet multipliers.

use nalgebra::{Complex, DMatrix, DVector};

use stridemap_process::{Action, MeanMap, ProcessError, Situation, State};

use crate::error::MapError;

/// A map to first order: `f(x + dx, u + du) ≈ f(x, u) + A dx + B du`.
#[derive(Clone, Debug, PartialEq)]
pub struct Linearization {
    /// `f(x, u)`.
    pub next_state: State,
    /// A, n by n: derivatives by the state.
    pub state: DMatrix<f64>,
    /// B, n by m: derivatives by the action.
    pub action: DMatrix<f64>,
}

/// A fixed point `x = f(x, π(x))` of the mean map in closed loop.
#[derive(Clone, Debug, PartialEq)]
pub struct FixedPoint {
    /// Where it is.
    pub state: State,
    /// The Jacobian of one stride in closed loop.
    pub jacobian: DMatrix<f64>,
    /// Its eigenvalues, the Floquet multipliers, largest magnitude first.
    pub multipliers: Vec<Complex<f64>>,
    /// Newton steps made.
    pub iterations: usize,
}

impl FixedPoint {
    /// The largest magnitude of a multiplier; below one, small deviations die out.
    #[must_use]
    pub fn spectral_radius(&self) -> f64 {
        self.multipliers.first().map_or(0.0, |m| m.norm())
    }
}

/// Derivatives of a mean map by central differences.
///
/// # Arguments
///
/// - `state_steps`, `action_steps` – half the distance of the two evaluations, per component, in its
///   unit; positive. For a learned map take a fraction of the length scale. The action must be a
///   step away from its bounds, where the map is clipped.
///
/// # Errors
///
/// [`ProcessError::Length`] if sizes do not agree; whatever the map answers.
///
/// # Cost
///
/// 2 (n + m) + 1 evaluations of the map; the error is of second order in the steps.
pub fn linearize(
    map: &dyn MeanMap,
    at: &Situation,
    action: &[f64],
    state_steps: &[f64],
    action_steps: &[f64],
) -> Result<Linearization, MapError> {
    check_length("state_steps", state_steps.len(), at.state.len())?;
    check_length("action_steps", action_steps.len(), action.len())?;
    let next_state = map.mean_next_state(at, action)?;
    let by_state = differences(&at.state, state_steps, &mut |x| {
        map.mean_next_state(&Situation { state: State::from_slice(x), ..at.clone() }, action)
    })?;
    let by_action = differences(action, action_steps, &mut |u| map.mean_next_state(at, u))?;
    Ok(Linearization { next_state, state: by_state, action: by_action })
}

/// The fixed point of a mean map under a policy, by Newton's method with central differences.
///
/// # Arguments
///
/// - `policy` – the action at a situation, for instance the mean of a policy; the map sees it as the last
///   action as well.
/// - `guess` – where to start.
/// - `steps` – half the distance of the evaluations, per component, in its unit; also the scale on
///   which the fixed point is found: to 10⁻⁹ of a step.
///
/// # Errors
///
/// [`MapError::NoFixedPoint`] if 50 steps do not converge, [`MapError::NotIsolated`] if a
/// multiplier is one; whatever the map answers.
///
/// # Example
///
/// `x′ = 1 + 0.5 x` has its fixed point at 2, with multiplier 0.5.
///
/// ```
/// # use stridemap_map::*;
/// # use stridemap_process::*;
/// struct Line;
/// impl MeanMap for Line {
///     fn mean_next_state(&self, at: &Situation, _u: &[f64]) -> Result<State, ProcessError> {
///         Ok(State::from_slice(&[1.0 + 0.5 * at.state[0]]))
///     }
/// }
/// let found = fixed_point(&Line, &|_| Action::new(), &[0.0], &[0.1])?;
/// assert!((found.state[0] - 2.0).abs() < 1e-9);
/// assert!((found.multipliers[0].re - 0.5).abs() < 1e-9);
/// # Ok::<(), MapError>(())
/// ```
pub fn fixed_point(
    map: &dyn MeanMap,
    policy: &dyn Fn(&Situation) -> Action,
    guess: &[f64],
    steps: &[f64],
) -> Result<FixedPoint, MapError> {
    const MOST_ITERATIONS: usize = 50;
    const TOLERANCE_STEPS: f64 = 1e-9;
    check_length("steps", steps.len(), guess.len())?;
    let n = guess.len();
    let mut closed_loop = |x: &[f64]| {
        let mut at = Situation::of_state(x);
        at.last_action = policy(&at);
        map.mean_next_state(&at, &at.last_action)
    };
    let mut x = State::from_slice(guess);
    let mut residual = f64::INFINITY;
    for iterations in 0..=MOST_ITERATIONS {
        let next = closed_loop(&x)?;
        check_length("next state", next.len(), n)?;
        check_finite("next state", &next)?;
        residual = (0..n).map(|i| ((next[i] - x[i]) / steps[i]).abs()).fold(0.0, f64::max);
        let jacobian = differences(&x, steps, &mut closed_loop)?;
        if residual < TOLERANCE_STEPS {
            let mut multipliers: Vec<_> = jacobian.complex_eigenvalues().iter().copied().collect();
            multipliers.sort_by(|a, b| b.norm().total_cmp(&a.norm()));
            return Ok(FixedPoint { state: x, jacobian, multipliers, iterations });
        }
        let gap = DVector::from_iterator(n, (0..n).map(|i| next[i] - x[i]));
        let newton = (DMatrix::identity(n, n) - &jacobian).lu().solve(&gap).ok_or(MapError::NotIsolated)?;
        for (xi, d) in x.iter_mut().zip(newton.iter()) {
            *xi += d;
        }
        check_finite("Newton step", &x)?;
    }
    Err(MapError::NoFixedPoint { iterations: MOST_ITERATIONS, residual })
}

/// Central differences of a function, one column per argument.
fn differences(
    at: &[f64],
    steps: &[f64],
    f: &mut dyn FnMut(&[f64]) -> Result<State, ProcessError>,
) -> Result<DMatrix<f64>, MapError> {
    let mut columns = Vec::with_capacity(at.len());
    let mut rows = 0;
    for (j, &h) in steps.iter().enumerate() {
        if !(h > 0.0 && h.is_finite()) {
            return Err(MapError::NotFinite { quantity: "steps", index: j, value: h });
        }
        let mut moved = State::from_slice(at);
        moved[j] = at[j] + h;
        let above = f(&moved)?;
        moved[j] = at[j] - h;
        let below = f(&moved)?;
        check_length("next state", below.len(), above.len())?;
        rows = above.len();
        check_finite("next state", &above)?;
        check_finite("next state", &below)?;
        columns.extend(above.iter().zip(&below).map(|(a, b)| (a - b) / (2.0 * h)));
    }
    Ok(DMatrix::from_vec(rows, at.len(), columns))
}

fn check_length(quantity: &'static str, found: usize, expected: usize) -> Result<(), MapError> {
    if found == expected { Ok(()) } else { Err(ProcessError::Length { what: quantity, expected, found }.into()) }
}

fn check_finite(quantity: &'static str, values: &[f64]) -> Result<(), MapError> {
    match values.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(index) => Err(MapError::NotFinite { quantity, index, value: values[index] }),
    }
}
