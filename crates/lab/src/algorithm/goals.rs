//! Tasks with goals: strides explored about them, and policies measured on them (docs/goals.md).

use std::sync::{Arc, Mutex, PoisonError};

use stridemap_learn::{KeptPolicy, SavedPolicy};
use stridemap_process::{Goal, StrideEnd};
use stridemap_record::{Performance, RandomGoals, Straightness, StridePhase, StrideRole, Sweep, SweepAxis, Transition};
use stridemap_robot::{Robot, RobotState};
use stridemap_section::Crossing;

use super::Algorithm;
use crate::error::LabError;
use crate::goal::drawn;
use crate::learner::Known;
use crate::measure::wrapped_rad;
use crate::plant::{Batch, PlantCounters, TickObserver};
use crate::recorder::Recorder;
use crate::seed::{Role, stream};
use crate::strides::{ActionSource, Source};

/// Strides for which a goal is kept while a policy is measured.
const MEASURED_HOLD: usize = 5;
/// Levels of a sweep; then the same negated.
const LEVELS: [f64; 8] = [0.1, 0.2, 0.3, 0.4, 0.5, 0.4, 0.2, 0.0];
/// For how long each is asked for.
const LEVEL_S: f64 = 5.0;
/// The measures that a sweep drives.
const AXES: [&str; 3] = ["forward_speed_m_s", "lateral_speed_m_s", "yaw_rate_rad_s"];
/// How far a straight walk goes, at which speed, and in how many strides at most.
const STRAIGHT_M: f64 = 30.0;
const STRAIGHT_M_S: f64 = 0.5;
const STRAIGHT_STRIDES: usize = 300;

/// Where the base was at each control tick: time, place, heading, as a simulator knows it.
#[derive(Clone, Debug, Default)]
struct Path(Arc<Mutex<Vec<[f64; 4]>>>);

impl TickObserver for Path {
    fn tick(&mut self, robot: &dyn Robot, state: &RobotState, _: Option<&Crossing>, _: Option<[f64; 3]>) {
        let truth = robot.true_state().unwrap_or(state);
        let ([x, y, _], heading) = (truth.base.position_m, truth.base.heading_rad());
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push([state.time_s, x, y, heading]);
    }
}

impl Path {
    /// The ticks of each stride, the one before its first among them.
    fn of_strides(&self, strides: &[Transition]) -> Vec<Vec<[f64; 4]>> {
        const CLOSE_S: f64 = 1e-9;
        let ticks = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let mut at = 0;
        let mut all = Vec::with_capacity(strides.len());
        for t in strides {
            let began_s = t.time_s - t.measures.duration_s;
            let within = |tick: &[f64; 4]| tick[0] >= began_s - CLOSE_S && tick[0] <= t.time_s + CLOSE_S;
            // Past what belongs to no stride: starts, and what came before a fall.
            while at < ticks.len() && !within(&ticks[at]) {
                at += 1;
            }
            let own: Vec<[f64; 4]> = ticks[at..].iter().take_while(|tick| within(tick)).copied().collect();
            at += own.len().saturating_sub(1);
            all.push(own);
        }
        all
    }
}

/// Speeds along and across the heading and yaw rate, from tick to tick.
fn speeds(ticks: &[[f64; 4]]) -> Vec<[f64; 3]> {
    let between = |pair: &[[f64; 4]]| {
        let ([t0, x0, y0, h0], [t1, x1, y1, h1]) = (pair[0], pair[1]);
        let (dt, turn) = ((t1 - t0).max(1e-9), wrapped_rad(h1 - h0));
        let (sin, cos) = (h0 + 0.5 * turn).sin_cos();
        let (dx, dy) = ((x1 - x0) / dt, (y1 - y0) / dt);
        [cos * dx + sin * dy, cos * dy - sin * dx, turn / dt]
    };
    ticks.windows(2).map(between).collect()
}

impl Algorithm<'_> {
    /// A batch for a task with goals ends where the budget does.
    pub(super) fn within_budget(&self, batch: Batch) -> Batch {
        match self.task.learner.kind.follows_goals() {
            true => Batch { strides: batch.strides.min(self.strides_left()), ..batch },
            false => batch,
        }
    }

    /// Strides about goals: in the first batch about the raw command, or with a policy that acts from the first stride;
    /// later with the newest policy and noise about it.
    pub(super) fn explore_about_goals(
        &mut self,
        policy: Option<&SavedPolicy>,
        batch: Batch,
        stream_index: u64,
        recorder: &mut dyn Recorder,
    ) -> Result<(Vec<Transition>, PlantCounters), LabError> {
        let kind = self.task.learner.kind;
        let known = Known::of(self.task, self.seed, &self.progress, None)?;
        let neutral: Vec<f64> = known.limits.iter().map(|l| l.neutral).collect();
        let first = match policy {
            Some(policy) => Some(policy.clone()),
            None => kind.first_policy(&known)?,
        };
        let (acts, neutral) = match first {
            Some(policy) => (policy, None),
            None => (self.task.raw_command()?.to_saved(), Some(neutral)),
        };
        let mut dither = self.task.dither(neutral.as_deref(), kind.moves_constants());
        if !kind.dithers() {
            dither.std.fill(0.0);
        }
        let mut rng = stream(self.seed, Role::Collect, stream_index);
        let source = ActionSource::About(&acts, dither);
        self.make(&mut Source::new(&source), batch, None, &mut rng, recorder)
    }

    /// Strides of a policy's mean under given goals, only to report.
    fn follow(
        &mut self,
        policy: &SavedPolicy,
        goals: Vec<Goal>,
        what: &str,
        stream_index: u64,
        recorder: &mut dyn Recorder,
    ) -> Result<Vec<Transition>, LabError> {
        let batch = Batch {
            iteration: self.progress.policies.len(),
            phase: StridePhase::Record,
            role: StrideRole::Record,
            strides: goals.len(),
        };
        self.plant.ask_for(Some(goals));
        let made = self.strides_on_robot(Some(policy), batch, Some(what), (Role::Record, stream_index), recorder);
        self.plant.ask_for(None);
        let made = made?.0;
        self.progress.record_strides += made.len();
        Ok(made)
    }

    /// Measures a policy of a task with goals to report.
    pub(super) fn measure_on_goals(
        &mut self,
        policy: &SavedPolicy,
        what: &str,
        strides: usize,
        stream_index: u64,
        recorder: &mut dyn Recorder,
    ) -> Result<Performance, LabError> {
        // The same goals for every policy of a seed.
        let mut rng = stream(self.seed, Role::Goals, 0);
        let goals = drawn(&self.task.goal, Some(MEASURED_HOLD), strides, &mut rng);
        let iteration = what.starts_with("iteration");
        let filming = self.film(true, !iteration || what == "iteration-1");
        let made = self.follow(policy, goals, what, stream_index, recorder);
        let takes = filming.end(&mut self.plant);
        let made = made?;
        takes.keep(what, &made, recorder)?;
        let names: Vec<String> = self.task.goal.iter().map(|g| g.name.name.to_owned()).collect();
        let mass_kg = self.plant.robot().description().mass_kg;
        let mut performance =
            Performance { random_goals: Some(RandomGoals::of(&made, &names, mass_kg)), ..Performance::of(&made, 0) };
        if !iteration && self.task.record.sweep {
            let stride_s = made.iter().map(|t| t.measures.duration_s).sum::<f64>() / made.len().max(1) as f64;
            performance.sweep = Some(self.sweep(policy, what, stride_s, stream_index, recorder)?);
            performance.straightness = Some(self.straight(policy, what, stream_index, recorder)?);
        }
        Ok(performance)
    }

    /// The goal that asks for a value of one measure, and for zero, or what is nearest to it, of the others.
    fn asked(&self, measure: &str, value: f64) -> Goal {
        let of = |g: &crate::goal::GoalConfig| {
            if g.name.name == measure { value } else { 0.0_f64.clamp(g.range[0], g.range[1]) }
        };
        self.task.goal.iter().map(of).collect()
    }

    fn sweep(
        &mut self,
        policy: &SavedPolicy,
        what: &str,
        stride_s: f64,
        stream_index: u64,
        recorder: &mut dyn Recorder,
    ) -> Result<Sweep, LabError> {
        let per_level = (LEVEL_S / stride_s.max(0.1)).round().max(1.0) as usize;
        let (mut axes, mut falls) = ([None; 3], 0);
        for (axis, measure) in AXES.iter().enumerate() {
            let Some(component) = self.task.goal.iter().position(|g| g.name.name == *measure) else { continue };
            let goal = &self.task.goal[component];
            let [low, high] = goal.range;
            let both = LEVELS.iter().copied().chain(LEVELS.iter().map(|l| -l));
            // A gait that takes no commands is asked for what its task asks for, and no more.
            let levels: Vec<f64> = both.filter(|l| goal.command.is_some() || (low..=high).contains(l)).collect();
            let goals: Vec<Goal> =
                levels.iter().flat_map(|level| std::iter::repeat_n(self.asked(measure, *level), per_level)).collect();
            let path = Path::default();
            self.plant.observe(Some(Box::new(path.clone())));
            let label = format!("{what}-sweep-{}", ["vx", "vy", "wz"][axis]);
            let made = self.follow(policy, goals, &label, stream_index, recorder);
            self.plant.observe(None);
            let made = made?;
            let (mut strides, mut ticks) = (Vec::new(), Vec::new());
            for (t, own) in made.iter().zip(path.of_strides(&made)) {
                if t.end == StrideEnd::Crossing {
                    let goal = t.goal[component];
                    strides.push(t.measures.true_motion.values()[axis] - goal);
                    ticks.extend(speeds(&own).iter().map(|v| v[axis] - goal));
                } else {
                    falls += 1;
                }
            }
            axes[axis] = Some(SweepAxis::of(&strides, &ticks));
        }
        let [vx, vy, wz] = axes;
        Ok(Sweep { vx, vy, wz, falls })
    }

    fn straight(
        &mut self,
        policy: &SavedPolicy,
        what: &str,
        stream_index: u64,
        recorder: &mut dyn Recorder,
    ) -> Result<Straightness, LabError> {
        let forward = self.task.goal.iter().find(|g| g.name.name == AXES[0]);
        let asked_m_s = forward.map_or(0.0, |g| STRAIGHT_M_S.clamp(g.range[0], g.range[1]));
        let stride_s = self.plant.last_measures().duration_s.max(0.1);
        let strides = ((STRAIGHT_M / (asked_m_s * stride_s).max(0.05)) as usize).clamp(1, STRAIGHT_STRIDES);
        let path = Path::default();
        self.plant.observe(Some(Box::new(path.clone())));
        let goals = vec![self.asked(AXES[0], asked_m_s); strides];
        let made = self.follow(policy, goals, &format!("{what}-straight"), stream_index, recorder);
        self.plant.observe(None);
        let made = made?;
        let first: Vec<Transition> = made.iter().filter(|t| t.episode == made[0].episode).cloned().collect();
        let ticks: Vec<[f64; 4]> = path.of_strides(&first).concat();
        let falls = made.iter().filter(|t| t.end != StrideEnd::Crossing).count();
        let (Some(begin), Some(end)) = (ticks.first(), ticks.last()) else {
            return Ok(Straightness { asked_m_s, falls, ..Straightness::default() });
        };
        let turned: f64 = ticks.windows(2).map(|w| wrapped_rad(w[1][3] - w[0][3])).sum();
        let (sin, cos) = begin[3].sin_cos();
        let (dx, dy) = (end[1] - begin[1], end[2] - begin[2]);
        let (walked_m, off_m) = (cos * dx + sin * dy, cos * dy - sin * dx);
        let per = walked_m.abs().max(0.1);
        Ok(Straightness {
            asked_m_s,
            walked_m,
            off_m_per_m: off_m / per,
            turned_deg_per_m: turned.to_degrees() / per,
            falls,
        })
    }
}
