//! Planning over two strides in a map of goals.

use std::sync::Arc;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde::{Deserialize, Serialize};
use stridemap_map::{GoalMap, GoalScratch};
use stridemap_process::{Action, Goal, ProcessSpec, Situation};

use super::ActionRole;
use super::affine::AffinePiece;
use super::cost::GoalCost;
use crate::error::{LearnError, check_format, check_length, check_number, check_spec};
use crate::policy::{Acting, Policy, Seen};
use crate::search::CmaEs;

/// How plans are searched.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanSettings {
    /// Candidates of a generation of CMA-ES, at least 4.
    pub population: usize,
    /// Generations.
    pub generations: usize,
    /// First standard deviation, in units of the components.
    pub std_units: f64,
    /// Share of the newest residual in the bias that is carried from stride to stride; 0: no bias.
    pub bias_gain: f64,
    /// Largest residual that counts, in the measure's own unit.
    pub bias_limit: f64,
}

impl Default for PlanSettings {
    fn default() -> Self {
        Self { population: 16, generations: 10, std_units: 0.25, bias_gain: 0.2, bias_limit: 0.2 }
    }
}

/// A policy that plans in a map: one command held for two strides, searched by CMA-ES from the plan before.
///
/// ```text
/// J = ½ J(stride 1) + J(stride 2)        b ← (1 − g) b + g clip(measured − foretold, ± limit)
/// ```
///
/// Components of the action with the role of a constant have the values that were chosen with the map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GoalPlanner {
    /// Version of this file.
    pub format: u32,
    /// The process for which it plans.
    pub spec: ProcessSpec,
    /// The map.
    #[serde(with = "shared")]
    pub map: Arc<GoalMap>,
    /// What a stride costs.
    pub cost: GoalCost,
    /// What each component of the action is for.
    pub roles: Vec<ActionRole>,
    /// The values of constants; where a command has no goal to start from, where its search starts.
    pub values: Vec<f64>,
    /// Per component of the action the component of the goal that its command names directly.
    pub follows: Vec<Option<usize>>,
    /// Per component of the goal its measure in the map's list.
    pub measured: Vec<usize>,
    /// How plans are searched.
    pub settings: PlanSettings,
    /// Where the search for commands starts that no component of the goal names.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<AffinePiece>,
}

/// A map that planners share, written whole.
mod shared {
    use std::sync::Arc;

    use serde::{Deserialize, Deserializer, Serialize, Serializer};
    use stridemap_map::GoalMap;

    pub(super) fn serialize<S: Serializer>(map: &Arc<GoalMap>, serializer: S) -> Result<S::Ok, S::Error> {
        map.as_ref().serialize(serializer)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Arc<GoalMap>, D::Error> {
        GoalMap::deserialize(deserializer).map(Arc::new)
    }
}

/// What a planner remembers from stride to stride.
#[derive(Clone, Debug, Default)]
pub(super) struct Memory {
    /// The plan before and its goal.
    last: Option<(Vec<f64>, Goal)>,
    /// Per component of the goal.
    pub(super) bias: Vec<f64>,
    pub(super) scratch: GoalScratch,
}

impl GoalPlanner {
    /// Checks that everything fits together.
    ///
    /// # Errors
    ///
    /// [`LearnError::Length`] or [`LearnError::Parameter`] naming what does not fit.
    pub fn check(&self) -> Result<(), LearnError> {
        check_format(self.format)?;
        check_spec(&self.spec)?;
        let (m, measures) = (self.spec.action.len(), self.map.config().measures.len());
        check_length("roles", self.roles.len(), m)?;
        check_length("values", self.values.len(), m)?;
        check_length("follows", self.follows.len(), m)?;
        check_length("map.config.units", self.map.config().units.len(), m)?;
        check_length("measured", self.measured.len(), self.spec.goal.len())?;
        for &v in &self.values {
            check_number("values", v, true, "finite")?;
        }
        let goal = |g: Option<usize>| g.is_none_or(|g| g < self.spec.goal.len());
        let of = |q| match q {
            super::Quantity::Measure(i) => i < measures,
            super::Quantity::State(i) => i < self.spec.state.len(),
        };
        let known = self.measured.iter().all(|i| *i < measures)
            && self.follows.iter().all(|g| goal(*g))
            && self.cost.squared.iter().all(|t| goal(t.goal) && of(t.of))
            && self.cost.linear.iter().all(|t| t.measure < measures);
        if !known {
            return Err(LearnError::parameter("cost", f64::NAN, "of measures, states and goals that there are"));
        }
        if self.settings.population < 4 {
            return Err(LearnError::parameter("settings.population", self.settings.population, "at least 4"));
        }
        Ok(())
    }

    /// The components of the action that are planned.
    #[must_use]
    pub fn commands(&self) -> Vec<usize> {
        (0..self.roles.len()).filter(|&j| self.roles[j] == ActionRole::Command).collect()
    }

    /// The whole action of a plan, within the bounds.
    pub(super) fn action(&self, commands: &[usize], plan: &[f64]) -> Vec<f64> {
        let mut action = self.values.clone();
        for (j, c) in commands.iter().zip(plan) {
            action[*j] = *c;
        }
        for (u, d) in action.iter_mut().zip(&self.spec.action) {
            *u = u.clamp(d.lower, d.upper);
        }
        action
    }

    /// Where a search starts that has no plan before: at the goal, where a command names it.
    pub(super) fn start(&self, commands: &[usize], goal: &[f64]) -> Vec<f64> {
        let of_law = |j: usize| {
            let Some(law) = &self.start else { return self.values[j] };
            let of_goal = law.of_goal[j].iter().zip(goal).zip(&law.goal);
            law.action[j] + of_goal.map(|((k, g), g0)| k * (g - g0)).sum::<f64>()
        };
        commands.iter().map(|&j| self.follows[j].map_or_else(|| of_law(j), |g| goal[g])).collect()
    }

    /// The cost of a stride from a state that was looked from; and where it ends, where that matters or is asked for.
    pub(super) fn stride(
        &self,
        state: &[f64],
        action: &[f64],
        goal: &[f64],
        wants_next: bool,
        charged: &[bool],
        memory: &mut Memory,
    ) -> (f64, Vec<f64>) {
        let (mut means, variances) = self.map.measures(action, charged, &mut memory.scratch);
        for (i, b) in self.measured.iter().zip(&memory.bias) {
            means[*i] += b;
        }
        let next = if wants_next || self.cost.looks_at_state() {
            self.map.next_state(state, action, &mut memory.scratch)
        } else {
            Vec::new()
        };
        (self.cost.of(&means, &variances, &next, goal), next)
    }

    /// The best command for a state and a goal.
    pub(super) fn plan(&self, at: &Situation, memory: &mut Memory, rng: &mut ChaCha8Rng) -> Vec<f64> {
        let at = &*super::asked(&self.spec, at);
        let commands = self.commands();
        let start = match &memory.last {
            Some((plan, goal)) if *goal == at.goal => plan.clone(),
            _ => self.start(&commands, &at.goal),
        };
        let charged = self.cost.charged(self.map.config().measures.len());
        let std: Vec<f64> = commands.iter().map(|&j| self.settings.std_units * self.map.config().units[j]).collect();
        let mut best = (f64::INFINITY, start.clone());
        if let Ok(mut search) = CmaEs::new(&start, &std, Some(self.settings.population)) {
            for _ in 0..self.settings.generations {
                let mut points = search.ask(rng);
                // The state of the first stride is the same for all of a generation.
                self.map.look(&at.state, &mut memory.scratch);
                let firsts: Vec<(f64, Vec<f64>, Vec<f64>)> = points
                    .iter_mut()
                    .map(|point| {
                        let action = self.action(&commands, point);
                        *point = commands.iter().map(|&j| action[j]).collect();
                        let (cost, next) = self.stride(&at.state, &action, &at.goal, true, &charged, memory);
                        (cost, next, action)
                    })
                    .collect();
                let values: Vec<f64> = firsts
                    .iter()
                    .zip(&points)
                    .map(|((first, next, action), point)| {
                        self.map.look(next, &mut memory.scratch);
                        let (second, _) = self.stride(next, action, &at.goal, false, &charged, memory);
                        let cost = 0.5 * first + second;
                        if cost < best.0 {
                            best = (cost, point.clone());
                        }
                        if cost.is_finite() { -cost } else { -1e12 }
                    })
                    .collect();
                if search.tell(&points, &values).is_err() {
                    break;
                }
            }
        }
        memory.last = Some((best.1.clone(), at.goal.clone()));
        self.action(&commands, &best.1)
    }
}

impl Policy for GoalPlanner {
    fn mean(&self, at: &Situation) -> Action {
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let memory = &mut Memory { bias: vec![0.0; self.measured.len()], ..Memory::default() };
        self.plan(at, memory, &mut rng).into_iter().collect()
    }

    fn std(&self, _at: &Situation) -> Action {
        self.values.iter().map(|_| 0.0).collect()
    }

    fn measures(&self) -> &[String] {
        &self.map.config().measures
    }

    fn acting(&self) -> Option<Box<dyn Acting>> {
        let memory = Memory { bias: vec![0.0; self.measured.len()], ..Memory::default() };
        Some(Box::new(Planning { planner: self.clone(), memory, rng: ChaCha8Rng::seed_from_u64(0) }))
    }
}

/// A planner at work.
struct Planning {
    planner: GoalPlanner,
    memory: Memory,
    rng: ChaCha8Rng,
}

impl Acting for Planning {
    fn act(&mut self, at: &Situation) -> Action {
        self.planner.plan(at, &mut self.memory, &mut self.rng).into_iter().collect()
    }

    fn saw(&mut self, seen: &Seen<'_>) {
        let p = &self.planner;
        if seen.fell {
            self.memory.bias.fill(0.0);
            self.memory.last = None;
            return;
        }
        p.map.look(seen.state, &mut self.memory.scratch);
        let (foretold, _) = p.map.measures(seen.action, &[], &mut self.memory.scratch);
        let (gain, limit) = (p.settings.bias_gain, p.settings.bias_limit);
        for (b, &i) in self.memory.bias.iter_mut().zip(&p.measured) {
            let residual = (seen.measures[i] - foretold[i]).clamp(-limit, limit);
            *b += gain * (residual - *b);
        }
    }
}
