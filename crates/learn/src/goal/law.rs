//! Affine laws from the slopes of a map of goals, and with them the choice of the robot's constants.

use nalgebra::{DMatrix, DVector};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use stridemap_process::Goal;

use super::ActionRole;
use super::affine::AffinePiece;
use super::cost::Quantity;
use super::planning::{GoalPlanner, Memory};

/// Steps of Gauss and Newton towards where a goal is settled.
const SETTLING: usize = 6;
/// Added to the curvature by each command, per unit squared: no step goes where the map has no slope.
const DAMPING: f64 = 0.02;

/// Rows of a slope matrix for each squared term of the cost.
struct Slopes {
    /// Of the quantities by state and by command.
    by_state: DMatrix<f64>,
    by_command: DMatrix<f64>,
    next_by_state: DMatrix<f64>,
    next_by_command: DMatrix<f64>,
    /// Of the linear terms' sum by the command, and by the state.
    linear_by_command: DVector<f64>,
    linear_by_state: DVector<f64>,
}

impl GoalPlanner {
    fn slopes(&self, state: &[f64], action: &[f64], commands: &[usize], memory: &mut Memory) -> Slopes {
        let s = self.map.slopes(state, action, &mut memory.scratch);
        let (n, m, terms) = (state.len(), commands.len(), self.cost.squared.len());
        let row = |term: usize| match self.cost.squared[term].of {
            Quantity::Measure(i) => (&s.measures_by_state, &s.measures_by_action, i),
            Quantity::State(i) => (&s.next_by_state, &s.next_by_action, i),
        };
        let linear = |by: &DMatrix<f64>, column: usize| -> f64 {
            self.cost.linear.iter().map(|t| t.weight * by[(t.measure, column)]).sum()
        };
        Slopes {
            by_state: DMatrix::from_fn(terms, n, |t, i| row(t).0[(row(t).2, i)]),
            by_command: DMatrix::from_fn(terms, m, |t, j| row(t).1[(row(t).2, commands[j])]),
            next_by_command: DMatrix::from_fn(n, m, |i, j| s.next_by_action[(i, commands[j])]),
            linear_by_command: DVector::from_fn(m, |j, _| linear(&s.measures_by_action, commands[j])),
            linear_by_state: DVector::from_fn(n, |i, _| linear(&s.measures_by_state, i)),
            next_by_state: s.next_by_state,
        }
    }

    /// How far each squared term is from its target, and where the stride ends.
    fn errors(&self, state: &[f64], action: &[f64], goal: &[f64], memory: &mut Memory) -> (DVector<f64>, Vec<f64>) {
        self.map.look(state, &mut memory.scratch);
        let (means, _) = self.map.measures(action, &[], &mut memory.scratch);
        let next = self.map.next_state(state, action, &mut memory.scratch);
        let error = |t: usize| {
            let term = &self.cost.squared[t];
            let value = match term.of {
                Quantity::Measure(i) => means[i],
                Quantity::State(i) => next[i],
            };
            value - term.goal.map_or(0.0, |g| goal[g])
        };
        (DVector::from_fn(self.cost.squared.len(), |t, _| error(t)), next)
    }
}

/// The affine law about a goal, in closed form from the map's slopes where the robot has settled on it.
///
/// With `y = V_x x + V_c c` for what the cost squares, `x' = A x + B c` and one command held for two strides, the minimum
/// of `½ J(1) + J(2)` is where
///
/// ```text
/// H c = −[½ V_cᵀ W V_x + (V_c + V_x B)ᵀ W V_x A] x + [½ V_cᵀ + (V_c + V_x B)ᵀ] W g,
/// H = ½ V_cᵀ W V_c + (V_c + V_x B)ᵀ W (V_c + V_x B)
/// ```
///
/// # Arguments
///
/// - `state` – where the settling starts.
#[must_use]
pub fn law_about(planner: &GoalPlanner, goal: &[f64], state: &[f64]) -> AffinePiece {
    let mut memory = Memory::default();
    let commands = planner.commands();
    let (n, m) = (state.len(), commands.len());
    let units: Vec<f64> = commands.iter().map(|&j| planner.map.config().units[j]).collect();
    let weights = DVector::from_iterator(planner.cost.squared.len(), planner.cost.squared.iter().map(|t| t.weight));
    let w = DMatrix::from_diagonal(&weights);
    let mut c = planner.start(&commands, goal);
    let mut x = state.to_vec();
    let (mut of_state, mut of_goal) = (DMatrix::zeros(m, n), DMatrix::zeros(m, goal.len()));
    for step in 0..=SETTLING {
        let action = planner.action(&commands, &c);
        c = commands.iter().map(|&j| action[j]).collect();
        let s = planner.slopes(&x, &action, &commands, &mut memory);
        let later = &s.by_command + &s.by_state * &s.next_by_command;
        let mut h = 0.5 * s.by_command.transpose() * &w * &s.by_command + later.transpose() * &w * &later;
        for (j, unit) in units.iter().enumerate() {
            h[(j, j)] += DAMPING / (unit * unit);
        }
        let Some(h) = h.cholesky() else { break };
        let asked = 0.5 * s.by_command.transpose() * &w + later.transpose() * &w;
        of_state = -h.solve(
            &(0.5 * s.by_command.transpose() * &w * &s.by_state
                + later.transpose() * &w * &s.by_state * &s.next_by_state),
        );
        let of_term = h.solve(&asked);
        of_goal = DMatrix::zeros(m, goal.len());
        for (t, term) in planner.cost.squared.iter().enumerate() {
            if let Some(g) = term.goal {
                let column = of_goal.column(g) + of_term.column(t);
                of_goal.set_column(g, &column);
            }
        }
        if step == SETTLING {
            break;
        }
        let (first, next) = planner.errors(&x, &action, goal, &mut memory);
        let (second, _) = planner.errors(&next, &action, goal, &mut memory);
        // Squares have a slope of 2 e; the linear terms of both strides beside them.
        let linear = 0.75 * &s.linear_by_command + 0.5 * s.next_by_command.transpose() * &s.linear_by_state;
        let slope = 0.5 * s.by_command.transpose() * &w * first + later.transpose() * &w * second + linear;
        let moved = h.solve(&slope);
        for j in 0..m {
            c[j] -= moved[j].clamp(-units[j], units[j]);
        }
        x = next;
    }
    piece(planner, goal, x, &commands, &c, (of_state, of_goal), &mut memory)
}

/// The law written out for every component of the action, with what it expects to be measured.
fn piece(
    planner: &GoalPlanner,
    goal: &[f64],
    state: Vec<f64>,
    commands: &[usize],
    c: &[f64],
    (of_state, of_goal): (DMatrix<f64>, DMatrix<f64>),
    memory: &mut Memory,
) -> AffinePiece {
    let action = planner.action(commands, c);
    let s = planner.map.slopes(&state, &action, &mut memory.scratch);
    planner.map.look(&state, &mut memory.scratch);
    let (means, _) = planner.map.measures(&action, &[], &mut memory.scratch);
    let rows = |matrix: &DMatrix<f64>| {
        let mut rows = vec![vec![0.0; matrix.ncols()]; action.len()];
        for (row, j) in matrix.row_iter().zip(commands) {
            rows[*j] = row.iter().copied().collect();
        }
        rows
    };
    let measured = |by: &DMatrix<f64>| planner.measured.iter().map(|&i| by.row(i).iter().copied().collect()).collect();
    AffinePiece {
        goal: goal.to_vec(),
        of_state: rows(&of_state),
        of_goal: rows(&of_goal),
        expects: planner.measured.iter().map(|&i| means[i]).collect(),
        expects_by_state: measured(&s.measures_by_state),
        expects_by_action: measured(&s.measures_by_action),
        action,
        state,
    }
}

/// Chooses the robot's constants: of `candidates` drawn within their bounds, the present ones among them, those whose
/// settled cost is least.
///
/// The settled cost is the mean over recorded states and goals of the cost of the second stride under the affine law of
/// those constants, with what the map does not know charged as in a plan.
#[must_use]
pub fn choose_constants(
    planner: &GoalPlanner,
    pairs: &[(Vec<f64>, Goal)],
    candidates: usize,
    rng: &mut ChaCha8Rng,
) -> Vec<f64> {
    let constants: Vec<usize> =
        (0..planner.roles.len()).filter(|&j| planner.roles[j] == ActionRole::Constant).collect();
    if constants.is_empty() || pairs.is_empty() {
        return planner.values.clone();
    }
    let n = pairs.len() as f64;
    let states = pairs[0].0.len();
    let mean_state: Vec<f64> = (0..states).map(|i| pairs.iter().map(|p| p.0[i]).sum::<f64>() / n).collect();
    let goals = pairs[0].1.len();
    let mean_goal: Vec<f64> = (0..goals).map(|i| pairs.iter().map(|p| p.1[i]).sum::<f64>() / n).collect();
    let commands = planner.commands();
    let charged = planner.cost.charged(planner.map.config().measures.len());
    let mut memory = Memory::default();
    let mut tried = planner.clone();
    let mut best = (f64::INFINITY, planner.values.clone());
    for candidate in 0..=candidates {
        if candidate > 0 {
            for &j in &constants {
                let d = &planner.spec.action[j];
                tried.values[j] = d.lower + (d.upper - d.lower) * rng.random::<f64>();
            }
        }
        let law = law_about(&tried, &mean_goal, &mean_state);
        let act = |state: &[f64], goal: &[f64]| {
            let c: Vec<f64> = commands
                .iter()
                .map(|&j| {
                    let of_state = law.of_state[j].iter().zip(state).zip(&law.state).map(|((k, x), x0)| k * (x - x0));
                    let of_goal = law.of_goal[j].iter().zip(goal).zip(&law.goal).map(|((k, g), g0)| k * (g - g0));
                    law.action[j] + of_state.sum::<f64>() + of_goal.sum::<f64>()
                })
                .collect();
            tried.action(&commands, &c)
        };
        let mut total = 0.0;
        for (state, goal) in pairs {
            let action = act(state, goal);
            tried.map.look(state, &mut memory.scratch);
            let next = tried.map.next_state(state, &action, &mut memory.scratch);
            let action = act(&next, goal);
            tried.map.look(&next, &mut memory.scratch);
            total += tried.stride(&next, &action, goal, false, &charged, &mut memory).0;
        }
        if total < best.0 {
            best = (total, tried.values.clone());
        }
    }
    best.1
}
