//! The nominal gait, walked once before anything is learned: what thresholds and prices must fit.
//!
//! It is walked with thresholds that only a robot which is down passes. So a gait that falls is told
//! from a threshold behind which the robot stands without falling.

use std::sync::{Arc, Mutex};

use stridemap_process::{Action, Next, ProcessError, Situation, StrideEnd};
use stridemap_record::{Fall, FallCriterion, InPlace, Pace, Recording, StridePhase, StrideRole, Transition};
use stridemap_robot::{Robot, RobotDescription, RobotState};
use stridemap_section::Crossing;

use crate::error::{Invalid, LabError};
use crate::fall::FailureConfig;
use crate::plant::Batch;
use crate::plant::TickObserver;
use crate::poses::PoseRecorder;
use crate::seed::{Role, stream};
use crate::stepping::{GaitTrace, GaitVerdict, StepMeter, Stepping};
use crate::strides::{Act, ActionSource, Exploration, ExploreRange, Source, drive};
use crate::task::Task;

/// How long the nominal gait must step.
pub(crate) const NOMINAL_S: f64 = 20.0;

/// Who passes these is down, whatever the robot.
pub(crate) const DOWN: FailureConfig = FailureConfig {
    reward: 0.0,
    psi_roll_below_deg: None,
    psi_roll_relative: false,
    com_height_below: 0.5,
    base_below_m: None,
    tilt_above_deg: 60.0,
    no_section_s: 10.0,
};

/// What was seen of the nominal gait.
#[derive(Clone, Debug, Default)]
pub struct NominalGait {
    /// Strides that reached the next section.
    pub strides: usize,
    /// ... from the left leg and from the right.
    pub stances: [usize; 2],
    /// Their mean reward.
    pub mean_reward: f64,
    /// When it fell or stalled, and why, if it did.
    pub fell: Option<(f64, Fall)>,
    /// The first threshold of the task that it passed without falling, with its furthest value.
    pub beyond: Option<Fall>,
    /// Least height of its centre of mass, as a share of the first.
    pub least_height: f64,
    /// Longest time without a section, its start included.
    pub longest_wait_s: f64,
    /// How it stepped.
    pub stepping: Stepping,
    /// The same over time.
    pub trace: GaitTrace,
}

impl NominalGait {
    /// Whether it steps, shuffles or falls.
    #[must_use]
    pub fn verdict(&self) -> GaitVerdict {
        self.stepping.verdict(self.fell.is_some())
    }
}

/// Watches how near a robot comes to the thresholds of a task in one start.
#[derive(Clone, Debug, Default)]
struct Extremes {
    first_height_m: f64,
    last_s: f64,
    section_s: f64,
    least_height: f64,
    most_tilt_deg: f64,
    longest_wait_s: f64,
    least_psi_roll_deg: f64,
    /// The first passage of a threshold, for a robot that is down later.
    first: Option<(f64, Fall)>,
    steps: StepMeter,
}

struct Watch(FailureConfig, Arc<Mutex<Extremes>>, Option<PoseRecorder>);

impl TickObserver for Watch {
    fn tick(&mut self, robot: &dyn Robot, state: &RobotState, crossing: Option<&Crossing>, push_n: Option<[f64; 3]>) {
        if let Some(film) = &mut self.2 {
            film.tick(robot, state, crossing, push_n);
        }
        let Ok(mut seen) = self.1.lock() else { return };
        seen.steps.tick(robot, state, crossing);
        let height_m = state.com.position_m[2];
        if seen.first_height_m <= 0.0 || state.time_s < seen.last_s {
            *seen = Extremes {
                first_height_m: height_m,
                least_height: f64::INFINITY,
                least_psi_roll_deg: f64::INFINITY,
                steps: std::mem::take(&mut seen.steps),
                ..Extremes::default()
            };
        }
        seen.last_s = state.time_s;
        seen.least_height = seen.least_height.min(height_m / seen.first_height_m);
        seen.most_tilt_deg = seen.most_tilt_deg.max(state.base.tilt_rad().to_degrees());
        let waited_s = state.time_s - seen.section_s;
        seen.longest_wait_s = seen.longest_wait_s.max(waited_s);
        let mut passed = self.0.of_body(state, seen.first_height_m);
        if let Some(crossing) = crossing {
            seen.section_s = state.time_s;
            let psi_roll_deg = crossing.pendulum.roll_rad.to_degrees();
            seen.least_psi_roll_deg = seen.least_psi_roll_deg.min(psi_roll_deg);
            passed = passed.or(self.0.of_section(psi_roll_deg, &InPlace::default()));
        }
        passed = passed.or(self.0.of_wait(waited_s));
        seen.first = seen.first.or(passed.map(|fall| (state.time_s, fall)));
    }
}

impl Extremes {
    /// The first threshold that was passed, with the furthest value.
    fn beyond(&self, failure: &FailureConfig, least_psi_roll_deg: f64, in_place: &InPlace) -> Option<Fall> {
        let of = |criterion, value, threshold, passed: bool| passed.then_some(Fall { criterion, value, threshold });
        let (height, tilt) = (failure.com_height_below, failure.tilt_above_deg);
        failure
            .of_section(least_psi_roll_deg, in_place)
            .or_else(|| of(FallCriterion::Height, self.least_height, height, self.least_height < height))
            .or_else(|| of(FallCriterion::Tilt, self.most_tilt_deg, tilt, self.most_tilt_deg > tilt))
            .or_else(|| failure.of_wait(self.longest_wait_s))
    }
}

/// Walks the neutral action until a time has passed or the robot is down.
struct Steps<'a>(Source<'a>);

impl Act for Steps<'_> {
    fn act(&mut self, at: &Situation, rng: &mut rand_chacha::ChaCha8Rng) -> Action {
        self.0.act(at, rng)
    }

    fn saw(&mut self, t: &Transition) -> Next {
        if t.end != StrideEnd::Crossing || t.time_s >= NOMINAL_S { Next::Stop } else { Next::Go }
    }
}

/// Walks the nominal gait of a simulated robot for 20 s, or until it is down.
///
/// # Errors
///
/// [`LabError::NominalGaitFails`] if it does not come to its first stride; [`LabError`] of the room at
/// fault.
pub fn nominal_gait(task: &Task, seed: u64) -> Result<NominalGait, LabError> {
    nominal_gait_on_film(task, seed, None)
}

/// The same, and on film, whatever becomes of it.
pub(crate) fn nominal_gait_on_film(
    task: &Task,
    seed: u64,
    film: Option<&mut Recording>,
) -> Result<NominalGait, LabError> {
    let own = task.failure;
    let down = FailureConfig {
        com_height_below: own.com_height_below.min(DOWN.com_height_below),
        tilt_above_deg: own.tilt_above_deg.max(DOWN.tilt_above_deg),
        no_section_s: own.no_section_s.max(DOWN.no_section_s),
        ..DOWN
    };
    let mut plant = Task { failure: down, ..task.clone() }.plant()?;
    let steps = StepMeter::from(plant.start_up_s());
    let seen = Arc::new(Mutex::new(Extremes { steps, ..Extremes::default() }));
    let filmed = film.is_some().then(|| PoseRecorder::new(plant.robot(), Pace::Film.period_s(), 0.0, NOMINAL_S));
    let (filming, growing) = filmed.unzip();
    plant.observe(Some(Box::new(Watch(own, Arc::clone(&seen), filming))));
    let limits = task.action_limits()?;
    let ranges = limits.iter().map(|l| ExploreRange { center: [l.neutral; 2], std: 0.0 }).collect();
    let raw = task.nominal_policy()?;
    let source = match task.goal.is_empty() {
        true => ActionSource::Explore(Exploration { ranges, hold: 1 }),
        false => ActionSource::Mean(&raw),
    };
    let batch = Batch { iteration: 0, phase: StridePhase::Record, role: StrideRole::Record, strides: 1000 };
    let made = drive(
        &mut plant,
        &mut Steps(Source::new(&source)),
        batch,
        &mut stream(seed, Role::Check, 1),
        &mut |_, _| {},
        &mut |_| Ok(()),
    );
    plant.observe(None);
    if let (Some(film), Some(growing)) = (film, growing)
        && let Ok(mut recording) = growing.lock()
    {
        *film = std::mem::take(&mut *recording);
    }
    let seen = seen.lock().map_or_else(|_| Extremes::default(), |seen| seen.clone());
    let made = made.map_err(|error| started(error, &seen, plant.robot().description()))?;
    let stepped: Vec<&Transition> = made.iter().filter(|t| t.end == StrideEnd::Crossing).collect();
    let mut gait = NominalGait {
        strides: stepped.len(),
        least_height: seen.least_height,
        longest_wait_s: seen.longest_wait_s,
        mean_reward: stepped.iter().map(|t| t.reward).sum::<f64>() / stepped.len().max(1) as f64,
        ..NominalGait::default()
    };
    for stance in stepped.iter().filter_map(|t| t.stance) {
        gait.stances[stance.index()] += 1;
    }
    let last = made.last().and_then(|t| Some((t.time_s, t.fall?)));
    gait.fell = last.map(|last| seen.first.unwrap_or(last));
    // A relative threshold is looked at once it is known what it is relative to.
    let after_start = stepped.iter().map(|t| t.measures.psi_roll_deg);
    let least_psi_roll_deg =
        if own.psi_roll_relative { after_start.fold(f64::INFINITY, f64::min) } else { seen.least_psi_roll_deg };
    gait.trace = seen.steps.trace();
    gait.stepping = seen.steps.stepping(plant.robot().description(), gait.fell.is_some());
    if gait.fell.is_none() {
        gait.beyond = seen.beyond(&own, least_psi_roll_deg, &plant.in_place());
    }
    Ok(gait)
}

/// A start that failed, told by the task's own thresholds.
fn started(error: LabError, seen: &Extremes, robot: &RobotDescription) -> LabError {
    let LabError::Process(ProcessError::World(world)) = error else {
        return error;
    };
    match world.downcast::<LabError>() {
        Ok(mut error) => {
            if let LabError::NominalGaitFails { time_s, fall, how, .. } = error.as_mut() {
                (*time_s, *fall) = seen.first.unwrap_or((*time_s, *fall));
                *how = seen.steps.stepping(robot, true).falling.map_or_else(String::new, |how| format!(", {how}"));
            }
            *error
        }
        Err(world) => LabError::Process(ProcessError::World(world)),
    }
}

impl FailureConfig {
    /// Refuses a price of a fall that is not clearly lower than what a stride of the nominal gait earns:
    /// a learner would be paid for falling. It must cost a quarter more than such a stride.
    ///
    /// (That walking on for ever is worth more than one fall is too much to ask: −0.1 a stride at a
    /// discount of 0.95 comes to −2, and a learner that sees an end of it does not choose to fall.)
    ///
    /// # Errors
    ///
    /// [`Invalid`] with key, value and what was measured.
    ///
    /// # Example
    ///
    /// ```
    /// let failure = stridemap_lab::builtin::load("stepping", &[])?.task.failure; // a fall earns -1
    /// assert!(failure.refuse_price(-0.1).is_ok());
    /// let refused = failure.refuse_price(-1.5).unwrap_err().to_string();
    /// assert!(refused.starts_with("failure.reward: is -1"), "{refused}");
    /// # Ok::<(), stridemap_lab::LabError>(())
    /// ```
    pub fn refuse_price(&self, nominal_mean_reward: f64) -> Result<(), Invalid> {
        const CLEARLY: f64 = 1.25;
        let most = nominal_mean_reward.min(CLEARLY * nominal_mean_reward);
        if self.reward < most {
            return Ok(());
        }
        Err(Invalid {
            key: "failure.reward".into(),
            requirement: format!(
                "is {}, and a stride of the nominal gait earns {nominal_mean_reward:.3}: a fall pays; it \
                 must be lower than {most:.3}, or the weights of the reward smaller",
                self.reward
            ),
        })
    }
}

impl NominalGait {
    /// Refuses thresholds beyond which the gait steps without falling, and a fall that pays.
    ///
    /// # Errors
    ///
    /// [`Invalid`] with key, value and what was measured.
    pub fn refuse(&self, failure: &FailureConfig) -> Result<(), Invalid> {
        if let Some(beyond) = &self.beyond {
            let key = beyond.criterion.key();
            let (value, reached) = match beyond.criterion {
                FallCriterion::PsiRoll => (
                    failure.psi_roll_below_deg.unwrap_or_default(),
                    format!("psi_roll down to {:.2} deg", beyond.value),
                ),
                FallCriterion::Height => {
                    (failure.com_height_below, format!("a height down to {:.3} of the first", beyond.value))
                }
                FallCriterion::Tilt => (failure.tilt_above_deg, format!("a tilt up to {:.1} deg", beyond.value)),
                FallCriterion::NoSection => {
                    (failure.no_section_s, format!("up to {:.2} s without a section", beyond.value))
                }
            };
            let relative = if beyond.criterion == FallCriterion::PsiRoll && failure.psi_roll_relative {
                format!(" below the robot's own in place, that is {:.2},", beyond.threshold)
            } else {
                String::new()
            };
            return Err(Invalid {
                key: key.into(),
                requirement: format!(
                    "is {value},{relative} and the nominal gait steps for {NOMINAL_S} s with {reached} \
                     without falling: healthy strides would count as falls; set it beyond that"
                ),
            });
        }
        if self.strides == 0 {
            return Ok(());
        }
        failure.refuse_price(self.mean_reward)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin;

    fn refused(sets: &[&str]) -> String {
        let sets: Vec<String> = sets.iter().map(ToString::to_string).collect();
        let task = builtin::load("stepping", &sets).unwrap().task;
        let gait = nominal_gait(&task, 1).unwrap();
        assert!(gait.fell.is_none() && gait.strides > 20, "{gait:?}");
        gait.refuse(&task.failure).map_or_else(|e| e.to_string(), |()| String::new())
    }

    /// The nominal gait of the biped settles at 3.0 deg and earns -0.10 a stride.
    #[test]
    fn thresholds_that_a_healthy_gait_stands_beyond_and_falls_that_pay_are_refused() {
        assert_eq!(refused(&[]), "");
        let psi = refused(&["failure.psi_roll_below_deg=3.5"]);
        assert!(
            psi.starts_with("failure.psi_roll_below_deg: is 3.5, and the nominal gait")
                && psi.contains("psi_roll down to"),
            "{psi}"
        );
        let height = refused(&["failure.com_height_below=0.999"]);
        assert!(height.starts_with("failure.com_height_below: is 0.999"), "{height}");
        let tilt = refused(&["failure.tilt_above_deg=1"]);
        assert!(tilt.starts_with("failure.tilt_above_deg: is 1,"), "{tilt}");
        let wait = refused(&["failure.no_section_s=0.3"]);
        assert!(wait.starts_with("failure.no_section_s: is 0.3"), "{wait}");
        let relative =
            refused(&["failure.psi_roll_relative=true", "failure.psi_roll_below_deg=1", "collect.warm_up_strides=4"]);
        assert!(relative.contains("below the robot's own in place, that is"), "{relative}");
        let price = refused(&["failure.reward=-0.05"]);
        assert!(price.starts_with("failure.reward: is -0.05, and a stride of the nominal gait earns -0.1"), "{price}");
    }
}
