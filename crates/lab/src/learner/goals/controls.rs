//! Controls of tasks with goals, which need no map of strides: the raw command, integral action, an affine inverse, one
//! constant per goal.

use nalgebra::{DMatrix, DVector};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use stridemap_gp::{FitOptions, Gp, Mean, Points};
use stridemap_learn::{ActionRole, AffinePiece, Correction, KeptPolicy, SavedPolicy, TrialSummary};
use stridemap_process::StrideEnd;
use stridemap_record::Transition;

use super::{Goals, strides};
use crate::error::LabError;
use crate::learner::{Known, LearnerPart};
use crate::registry::part;
use crate::task::Task;

/// What all of them are alike in.
macro_rules! control {
    ($part:ty, $moves:literal, $propose:path) => {
        impl LearnerPart for $part {
            fn uses_map(&self) -> bool {
                false
            }
            fn needs_caution(&self) -> bool {
                false
            }
            fn follows_goals(&self) -> bool {
                true
            }
            fn moves_constants(&self) -> bool {
                false
            }
            fn dithers(&self) -> bool {
                $moves
            }
            fn check(&self, task: &Task) -> Result<(), LabError> {
                Goals::of(task).map(|_| ())
            }
            fn first_policy(&self, known: &Known<'_>) -> Result<Option<SavedPolicy>, LabError> {
                let goals = Goals::of(known.task)?;
                Ok(if $moves {
                    None
                } else {
                    Some($propose(&goals, &[], &mut crate::seed::stream(0, crate::seed::Role::Improve, 0))?)
                })
            }
            fn propose(
                &self,
                known: &Known<'_>,
                rng: &mut ChaCha8Rng,
                _observer: &mut dyn FnMut(&TrialSummary),
            ) -> Result<SavedPolicy, LabError> {
                $propose(&Goals::of(known.task)?, strides(known), rng)
            }
        }
    };
}

pub struct Raw;
part!(Raw, "raw_command", "goals: control: the raw command");
control!(Raw, false, raw);

fn raw(goals: &Goals<'_>, _: &[Transition], _: &mut ChaCha8Rng) -> Result<SavedPolicy, LabError> {
    Ok(goals.raw(Correction::None)?.to_saved())
}

pub struct Integral;
part!(Integral, "goal_integral", "goals: control: integral action on each component of the command");
control!(Integral, false, integral);

fn of_learning(goals: &Goals<'_>) -> Correction {
    Correction::Integral { gain: goals.learning.integral_gain, limit: goals.learning.integral_limit }
}

fn integral(goals: &Goals<'_>, _: &[Transition], _: &mut ChaCha8Rng) -> Result<SavedPolicy, LabError> {
    Ok(goals.raw(of_learning(goals))?.to_saved())
}

pub struct Inverse;
part!(
    Inverse,
    "affine_inverse",
    "goals: control: the inverse of measures = affine function of the command, and integral action"
);
control!(Inverse, true, inverse);

/// Strides that reached the section.
fn reached(strides: &[Transition]) -> impl Iterator<Item = &Transition> {
    strides.iter().filter(|t| t.end == StrideEnd::Crossing)
}

/// Least squares of the goals' measures by the commands, inverted.
fn inverse(goals: &Goals<'_>, strides: &[Transition], _: &mut ChaCha8Rng) -> Result<SavedPolicy, LabError> {
    /// Ridge per stride and unit squared.
    const RIDGE: f64 = 1e-3;
    let roles = goals.roles();
    let commands: Vec<usize> = (0..roles.len()).filter(|&j| roles[j] == ActionRole::Command).collect();
    let made: Vec<&Transition> = reached(strides).collect();
    let (count, g) = (made.len(), goals.task.goal.len());
    let unit = |c: usize| goals.task.action[commands[c]].unit;
    let x = DMatrix::from_fn(count, commands.len() + 1, |i, c| match c {
        0 => 1.0,
        c => made[i].action[commands[c - 1]] / unit(c - 1),
    });
    let y = DMatrix::from_fn(count, g, |i, k| (goals.task.goal[k].name.of)(&made[i].measures));
    let mut gram = x.transpose() * &x;
    for c in 0..gram.nrows() {
        gram[(c, c)] += RIDGE * count as f64;
    }
    let fallback = || Ok(goals.raw(of_learning(goals))?.to_saved());
    let Some(gram) = gram.cholesky() else { return fallback() };
    let plane = gram.solve(&(x.transpose() * y));
    let slopes = plane.rows(1, commands.len()).transpose();
    let offsets = DVector::from_fn(g, |k, _| plane[(0, k)]);
    let Ok(inverse) = slopes.pseudo_inverse(0.05) else { return fallback() };
    let centre = -(&inverse * offsets);
    let mut action = goals.neutral();
    let mut of_goal = vec![vec![0.0; g]; action.len()];
    for (c, &j) in commands.iter().enumerate() {
        action[j] = centre[c] * unit(c);
        of_goal[j] = (0..g).map(|k| inverse[(c, k)] * unit(c)).collect();
    }
    Ok(goals.law(action, of_goal, of_learning(goals))?.to_saved())
}

pub struct Constants;
part!(
    Constants,
    "goal_constants",
    "goals: control: one constant per goal by Bayesian optimisation of the cost, without state or model of the stride"
);
control!(Constants, true, constants);

/// Constants per component of the goal.
const CELLS: usize = 3;
/// Candidates of which the best is taken.
const CANDIDATES: usize = 200;

/// A Gaussian process of the reward by goal and offset of the command from it; per cell of the goals the offset with the
/// largest mean.
fn constants(goals: &Goals<'_>, strides: &[Transition], rng: &mut ChaCha8Rng) -> Result<SavedPolicy, LabError> {
    let law = goals.raw(Correction::None)?;
    let follows = goals.follows();
    let moved: Vec<(usize, usize)> = follows.iter().enumerate().filter_map(|(j, g)| Some((j, (*g)?))).collect();
    let (mut inputs, mut y) = (Vec::new(), Vec::new());
    for t in reached(strides) {
        inputs.extend_from_slice(&t.goal);
        inputs.extend(moved.iter().map(|&(j, g)| t.action[j] - t.goal[g]));
        y.push(t.reward);
    }
    let dims = goals.task.goal.len() + moved.len();
    if y.len() < 10 || moved.is_empty() {
        return Ok(law.to_saved());
    }
    let options = FitOptions {
        mean: Mean::Constant,
        standardize_inputs: true,
        starts: 2,
        tolerance_nats: 1e-3,
        ..FitOptions::default()
    };
    let points = Points::new(&inputs, dims).map_err(stridemap_map::MapError::from)?;
    let gp = Gp::fit(points, &y, &options, rng).map_err(stridemap_map::MapError::from)?;
    let mut grid: Vec<Vec<f64>> = vec![Vec::new()];
    for goal in &goals.task.goal {
        let [low, high] = goal.range;
        let at = |i: usize| low + (high - low) * (i as f64 + 0.5) / CELLS as f64;
        grid = grid
            .iter()
            .flat_map(|g| (0..CELLS).map(|i| [g.as_slice(), &[at(i)]].concat()).collect::<Vec<_>>())
            .collect();
    }
    let mut pieces = Vec::new();
    for goal in grid {
        let mut best = (f64::NEG_INFINITY, vec![0.0; moved.len()]);
        for candidate in 0..CANDIDATES {
            let unit = |j: usize| goals.task.action[j].unit;
            let drawn = |&(j, _): &(usize, usize)| match candidate {
                0 => 0.0,
                _ => unit(j) * (2.0 * rng.random::<f64>() - 1.0),
            };
            let offset: Vec<f64> = moved.iter().map(drawn).collect();
            let value = gp.predict(&[goal.as_slice(), &offset].concat()).map_err(stridemap_map::MapError::from)?.mean;
            if value > best.0 {
                best = (value, offset);
            }
        }
        let mut piece = AffinePiece { goal: goal.clone(), ..law.pieces[0].clone() };
        for (&(j, g), offset) in moved.iter().zip(&best.1) {
            piece.action[j] = goal[g] + offset;
        }
        pieces.push(piece);
    }
    let mut law = law;
    law.pieces = pieces;
    Ok(law.to_saved())
}
