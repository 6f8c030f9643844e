//! Affine laws about goals: a policy for robots without the time to plan, and the shape of simple controls.

use serde::{Deserialize, Serialize};
use stridemap_process::{Action, ProcessSpec, Situation};

use crate::error::{LearnError, check_format, check_length, check_number, check_spec};
use crate::policy::{Acting, Policy, Seen};

/// A law about one goal: `u = u₀ + K_x (x − x₀) + K_g (g − b − g₀)`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AffinePiece {
    /// g₀.
    pub goal: Vec<f64>,
    /// x₀.
    pub state: Vec<f64>,
    /// u₀.
    pub action: Vec<f64>,
    /// K_x, one row a component of the action; no rows: nothing depends on the state.
    pub of_state: Vec<Vec<f64>>,
    /// K_g, one row a component of the action.
    pub of_goal: Vec<Vec<f64>>,
    /// What it expects to be measured for each component of the goal: at (x₀, u₀), and slopes by state and action. None
    /// where it expects what it is asked for.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub expects: Vec<f64>,
    /// Slopes by the state.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub expects_by_state: Vec<Vec<f64>>,
    /// Slopes by the action.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub expects_by_action: Vec<Vec<f64>>,
}

/// How a law learns from what was measured, from stride to stride.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Correction {
    /// Not at all.
    #[default]
    None,
    /// `b ← clip(b + gain (measured − goal), ± limit)`: integral action.
    Integral {
        /// Per stride.
        gain: f64,
        /// In the unit of the measure.
        limit: f64,
    },
    /// `b ← (1 − gain) b + gain clip(measured − expected, ± limit)`.
    Bias {
        /// Per stride.
        gain: f64,
        /// In the unit of the measure.
        limit: f64,
    },
}

/// Affine laws about goals; that of the nearest goal acts.
///
/// # Example
///
/// The raw command with integral action: too slow by 0.1 m/s, it asks for more.
///
/// ```
/// # use stridemap_learn::{Policy, SavedPolicy, Seen};
/// # use stridemap_process::{Goal, Situation};
/// let policy: SavedPolicy = serde_json::from_str(r#"{
///     "kind": "goal_affine", "format": 1,
///     "spec": { "state": [{ "name": "x" }], "action": [{ "name": "command_m_s", "lower": -1, "upper": 1 }],
///               "goal": [{ "name": "forward_speed_m_s", "lower": 0, "upper": 0.7 }] },
///     "measures": ["forward_speed_m_s"], "correction": { "integral": { "gain": 0.5, "limit": 0.5 } },
///     "pieces": [{ "goal": [0], "state": [0], "action": [0], "of_state": [], "of_goal": [[1]] }]
/// }"#)?;
/// let at = Situation { goal: Goal::from_slice(&[0.5]), ..Situation::of_state(&[0.0]) };
/// let mut acting = policy.acting().unwrap();
/// assert_eq!(acting.act(&at)[0], 0.5);
/// acting.saw(&Seen { state: &[0.0], action: &[0.5], goal: &[0.5], measures: &[0.4], fell: false });
/// assert!((acting.act(&at)[0] - 0.55).abs() < 1e-12);
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GoalAffine {
    /// Version of this file.
    pub format: u32,
    /// The process for which it was made.
    pub spec: ProcessSpec,
    /// The measure of each component of the goal.
    pub measures: Vec<String>,
    /// How it learns from what was measured.
    pub correction: Correction,
    /// The laws.
    pub pieces: Vec<AffinePiece>,
}

/// `row · v`.
fn dot(row: &[f64], v: &[f64]) -> f64 {
    row.iter().zip(v).map(|(a, b)| a * b).sum()
}

fn less(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

impl GoalAffine {
    /// Checks that everything fits together.
    ///
    /// # Errors
    ///
    /// [`LearnError::Length`] or [`LearnError::Parameter`] naming what does not fit.
    pub fn check(&self) -> Result<(), LearnError> {
        check_format(self.format)?;
        check_spec(&self.spec)?;
        let (n, m, g) = (self.spec.state.len(), self.spec.action.len(), self.spec.goal.len());
        check_length("measures", self.measures.len(), g)?;
        if self.pieces.is_empty() {
            return Err(LearnError::parameter("pieces", 0.0, "at least one"));
        }
        for p in &self.pieces {
            check_length("pieces.goal", p.goal.len(), g)?;
            check_length("pieces.state", p.state.len(), n)?;
            check_length("pieces.action", p.action.len(), m)?;
            check_length("pieces.of_goal", p.of_goal.len(), m)?;
            let tables = [(&p.of_state, n), (&p.of_goal, g), (&p.expects_by_state, n), (&p.expects_by_action, m)];
            for (table, width) in tables {
                for row in table {
                    check_length("rows of pieces", row.len(), width)?;
                    for &v in row {
                        check_number("pieces", v, true, "finite")?;
                    }
                }
            }
            if !p.of_state.is_empty() {
                check_length("pieces.of_state", p.of_state.len(), m)?;
            }
            if !p.expects.is_empty() {
                check_length("pieces.expects", p.expects.len(), g)?;
                check_length("pieces.expects_by_state", p.expects_by_state.len(), g)?;
                check_length("pieces.expects_by_action", p.expects_by_action.len(), g)?;
            }
        }
        Ok(())
    }

    /// The law that acts on a goal.
    fn piece(&self, goal: &[f64]) -> &AffinePiece {
        let far = |p: &AffinePiece| -> f64 {
            let width = |i: usize| (self.spec.goal[i].upper - self.spec.goal[i].lower).max(1e-9);
            p.goal.iter().zip(goal).enumerate().map(|(i, (a, b))| ((a - b) / width(i)).powi(2)).sum()
        };
        let nearest = self.pieces.iter().min_by(|a, b| far(a).total_cmp(&far(b)));
        nearest.unwrap_or(&self.pieces[0])
    }

    fn action(&self, at: &Situation, bias: &[f64]) -> Action {
        let at = &*super::asked(&self.spec, at);
        let piece = self.piece(&at.goal);
        let asked: Vec<f64> = at.goal.iter().zip(bias).zip(&piece.goal).map(|((g, b), g0)| g - b - g0).collect();
        let moved = less(&at.state, &piece.state);
        let of = |j: usize| {
            let of_state = piece.of_state.get(j).map_or(0.0, |row| dot(row, &moved));
            let u = piece.action[j] + of_state + dot(&piece.of_goal[j], &asked);
            u.clamp(self.spec.action[j].lower, self.spec.action[j].upper)
        };
        (0..piece.action.len()).map(of).collect()
    }
}

impl Policy for GoalAffine {
    fn mean(&self, at: &Situation) -> Action {
        self.action(at, &vec![0.0; self.measures.len()])
    }

    fn std(&self, _at: &Situation) -> Action {
        self.spec.action.iter().map(|_| 0.0).collect()
    }

    fn measures(&self) -> &[String] {
        &self.measures
    }

    fn acting(&self) -> Option<Box<dyn Acting>> {
        Some(Box::new(Correcting { bias: vec![0.0; self.measures.len()], law: self.clone() }))
    }
}

/// A law at work.
struct Correcting {
    law: GoalAffine,
    bias: Vec<f64>,
}

impl Acting for Correcting {
    fn act(&mut self, at: &Situation) -> Action {
        self.law.action(at, &self.bias)
    }

    fn saw(&mut self, seen: &Seen<'_>) {
        if seen.fell {
            self.bias.fill(0.0);
            return;
        }
        let piece = self.law.piece(seen.goal);
        for (i, b) in self.bias.iter_mut().enumerate() {
            match self.law.correction {
                Correction::None => {}
                Correction::Integral { gain, limit } => {
                    *b = (*b + gain * (seen.measures[i] - seen.goal[i])).clamp(-limit, limit);
                }
                Correction::Bias { gain, limit } => {
                    let expected = piece.expects.get(i).map_or(seen.goal[i] - *b, |y| {
                        y + dot(&piece.expects_by_state[i], &less(seen.state, &piece.state))
                            + dot(&piece.expects_by_action[i], &less(seen.action, &piece.action))
                    });
                    *b += gain * ((seen.measures[i] - expected).clamp(-limit, limit) - *b);
                }
            }
        }
    }
}
