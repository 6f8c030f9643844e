//! The robot as a stride process: robot + gait + section + task, run from section to section.
//!
//! ```text
//! action ──▶ action law ──▶ gait modulations
//!                               │
//!            robot state ──▶ gait.targets ──▶ robot.step ──▶ robot state ──▶ section ──▶ next state
//!                               ▲________________________________│   every control period
//! ```

mod parts;
mod pushes;

pub use parts::{Batch, PlantAction, PlantCounters, PlantTask, StrideObserver, TickObserver};
pub use pushes::{Push, PushBegins};

use std::collections::VecDeque;

use rand_chacha::ChaCha8Rng;
use stridemap_gait::Gait;
use stridemap_process::{
    ActionLaw, Goal, Made, ProcessError, ProcessSpec, Situation, State, Stride, StrideEnd, StrideProcess,
};
use stridemap_record::{Fall, InPlace, StrideMeasures, Transition};
use stridemap_robot::{JointTargets, Robot, RobotError, Side};
use stridemap_section::{Crossing, Pendulum, SectionDetector};

use crate::error::LabError;
use crate::goal::Goals;
use crate::measure::{StrideMeter, wrapped_rad};
use crate::motion::MotionMeter;
use crate::plant::pushes::Pushes;
use crate::reward::reward;
use crate::state::AtSection;
use crate::truth::TrueWay;

/// The robot as a [`StrideProcess`].
pub struct Plant {
    robot: Box<dyn Robot>,
    gait: Box<dyn Gait>,
    targets: JointTargets,
    task: PlantTask,
    spec: ProcessSpec,
    detector: SectionDetector,
    law: ActionLaw,
    goals: Goals,
    meter: StrideMeter,
    motion: MotionMeter,
    counters: PlantCounters,
    at_section: bool,
    first_com_height_m: f64,
    in_place: InPlace,
    last_measures: StrideMeasures,
    last_fall: Option<Fall>,
    pushes: Pushes,
    observer: Option<Box<dyn TickObserver>>,
    abort_reason: Option<RobotError>,
    true_psi_roll_deg: Option<f64>,
    true_way: TrueWay,
    log: Option<Box<dyn StrideObserver>>,
    recalled: VecDeque<Transition>,
    falls: Vec<(Option<usize>, Fall)>,
    falls_at_most: Option<usize>,
    /// Stream and word of the generator before the last reset.
    began_at: (u64, u64),
}

/// How running to the next section went.
enum Outcome {
    Crossing(Crossing),
    Fell(Fall),
}

/// Nominal starts that may fail before the robot is given up.
const START_ATTEMPTS: usize = 3;

impl Plant {
    /// A plant that has not been reset.
    ///
    /// # Errors
    ///
    /// [`LabError`] if the section's configuration or an action's limits are outside their domain.
    pub fn new(
        robot: Box<dyn Robot>,
        gait: Box<dyn Gait>,
        spec: ProcessSpec,
        task: PlantTask,
    ) -> Result<Self, LabError> {
        let detector = SectionDetector::new(task.section)?;
        let law = ActionLaw::new(task.action.iter().map(|a| a.limits).collect())?;
        let meter = StrideMeter::new(robot.description(), gait.rest());
        let goals = Goals::new(task.goals.clone());
        Ok(Self {
            robot,
            gait,
            targets: JointTargets::default(),
            task,
            spec,
            detector,
            law,
            goals,
            meter,
            motion: MotionMeter::default(),
            counters: PlantCounters::default(),
            at_section: false,
            first_com_height_m: 0.0,
            in_place: InPlace::default(),
            last_measures: StrideMeasures::default(),
            last_fall: None,
            pushes: Pushes::default(),
            observer: None,
            abort_reason: None,
            true_psi_roll_deg: None,
            true_way: TrueWay::default(),
            log: None,
            recalled: VecDeque::new(),
            falls: Vec::new(),
            falls_at_most: None,
            began_at: (0, 0),
        })
    }

    /// Strides of a batch that was broken off (the controller was killed, the link was lost), in their order: the next
    /// batch of that iteration and phase takes them up. For robots that cannot repeat what they did.
    pub fn recall(&mut self, strides: Vec<Transition>) {
        self.recalled = strides.into();
    }

    /// The next stride of a batch that was made before, if there is one.
    pub(crate) fn next_recalled(&mut self, batch: &Batch) -> Option<Transition> {
        let of_batch = |t: &mut Transition| (t.iteration, t.phase) == (batch.iteration, batch.phase);
        let stride = self.recalled.pop_front_if(of_batch)?;
        self.counters.strides += 1;
        self.count_end(stride.end, stride.fall.as_ref(), true);
        Some(stride)
    }

    /// Strides made so far.
    #[must_use]
    pub const fn counters(&self) -> PlantCounters {
        self.counters
    }

    /// What was measured of the last stride.
    #[must_use]
    pub const fn last_measures(&self) -> &StrideMeasures {
        &self.last_measures
    }

    /// Why the last stride was a fall or a stall, if it was.
    #[must_use]
    pub const fn last_fall(&self) -> Option<Fall> {
        self.last_fall
    }

    /// How the robot stepped in place at its last start.
    #[must_use]
    pub const fn in_place(&self) -> InPlace {
        self.in_place
    }

    /// Every fall and stall since the plant was built, and the stride in which it was, from 1; `None`
    /// in a start.
    #[must_use]
    pub fn falls(&self) -> &[(Option<usize>, Fall)] {
        &self.falls
    }

    /// Sets how many more falls a batch may have before it ends; `None`: any number.
    pub(crate) fn allow_falls(&mut self, at_most: Option<usize>) {
        self.falls_at_most = at_most.map(|more| self.falls.len() + more);
    }

    /// Whether there were more falls than are allowed.
    pub(crate) fn has_fallen_too_often(&self) -> bool {
        self.falls_at_most.is_some_and(|most| self.falls.len() > most)
    }

    /// Why the last stride was aborted, if it was.
    #[must_use]
    pub const fn abort_reason(&self) -> Option<&RobotError> {
        self.abort_reason.as_ref()
    }

    /// `ψ_roll` at the last section as a simulator knows it, where the robot only estimates it.
    #[must_use]
    pub const fn true_psi_roll_deg(&self) -> Option<f64> {
        self.true_psi_roll_deg
    }

    /// Way of the centre of mass in the last stride along the episode's first heading as a simulator
    /// knows it, where the robot only estimates it.
    #[must_use]
    pub fn true_forward_m(&self) -> Option<f64> {
        self.true_way.forward_m(self.robot.true_state()?)
    }

    /// The record of a stride that was just made.
    ///
    /// # Arguments
    ///
    /// - `first_episode` – what episode 0 of its roll-out is called.
    /// - `stance` – the leg that the robot stood on when it began.
    #[must_use]
    pub fn transition(&self, batch: Batch, first_episode: usize, stance: Option<Side>, made: Made<'_>) -> Transition {
        let (at, stride) = (made.at, made.stride);
        Transition {
            iteration: batch.iteration,
            phase: batch.phase,
            role: batch.role,
            episode: first_episode + made.episode,
            k: made.k,
            time_s: self.robot_time_s(),
            stance,
            state: at.state.clone(),
            last_action: at.last_action.clone(),
            action: stride.action().clone(),
            goal: at.goal.clone(),
            next_state: stride.next.state.clone(),
            reward: stride.reward,
            end: stride.end,
            fall: self.last_fall,
            measures: self.last_measures,
            true_psi_roll_deg: self.true_psi_roll_deg,
            true_forward_m: self.true_forward_m(),
        }
    }

    /// Stream and word of the random generator before the last reset: with them the episode can be run again alone.
    #[must_use]
    pub const fn began_at(&self) -> (u64, u64) {
        self.began_at
    }

    /// The leg that the robot stands on.
    #[must_use]
    pub fn stance(&self) -> Option<Side> {
        self.detector.stance()
    }

    /// Asks for these goals, one a stride and the last for ever after; `None`: for goals drawn at random.
    pub fn ask_for(&mut self, goals: Option<Vec<Goal>>) {
        self.goals.list(goals);
    }

    /// The robot inside.
    #[must_use]
    pub fn robot(&self) -> &dyn Robot {
        self.robot.as_ref()
    }

    /// Seconds after a reset until the gait is at full amplitude.
    #[must_use]
    pub fn start_up_s(&self) -> f64 {
        self.gait.start_up_s()
    }

    /// Sets or removes a log of actions and sections.
    pub fn log(&mut self, log: Option<Box<dyn StrideObserver>>) {
        self.log = log;
    }

    /// Sets or removes an observer of every control tick.
    pub fn observe(&mut self, observer: Option<Box<dyn TickObserver>>) {
        self.observer = observer;
    }

    fn robot_time_s(&self) -> f64 {
        self.robot.state().time_s
    }

    /// One control period. Returns the section found in it.
    fn tick(&mut self) -> Result<Option<Crossing>, RobotError> {
        let dt_s = self.robot.description().control_period_s;
        let stance_before = self.detector.stance();
        (self.gait).targets(self.robot.state(), dt_s, &mut self.targets);
        self.robot.step(&self.targets)?;
        let gait = &self.gait;
        let phase_rad = |leg| gait.phase_rad(leg);
        let crossing = self.detector.update(self.robot.state(), phase_rad);
        let pendulum = self.detector.pendulum();
        self.meter.tick(self.robot.state(), pendulum.as_ref(), dt_s);
        self.motion.tick(self.robot.state(), self.robot.true_state(), dt_s);
        if crossing.is_some() {
            self.motion.section(pendulum.map(|p| p.stance));
        }
        if let (Some(found), Some(log)) = (&crossing, &mut self.log) {
            log.section(found);
        }
        if let (Some(found), Some(truth)) = (&crossing, self.robot.true_state()) {
            let base = self.task.section.pendulum_base;
            let there = stridemap_section::pendulum(truth, found.pendulum.stance, base);
            self.true_psi_roll_deg = there.map(|p| p.roll_rad.to_degrees());
        }
        if let Some(observer) = &mut self.observer {
            let robot = self.robot.as_ref();
            observer.tick(robot, robot.state(), crossing.as_ref(), self.pushes.force_n());
        }
        self.update_push(stance_before)?;
        Ok(crossing)
    }

    /// Runs until the next section, a fall or a stall.
    fn run_to_section(&mut self) -> Result<Outcome, RobotError> {
        let start_s = self.robot_time_s();
        let failure = self.task.failure;
        loop {
            let crossing = self.tick()?;
            if let Some(fall) = failure.of_body(self.robot.state(), self.first_com_height_m) {
                return Ok(Outcome::Fell(fall));
            }
            if let Some(crossing) = crossing {
                let roll_deg = crossing.pendulum.roll_rad.to_degrees();
                return Ok(match failure.of_section(roll_deg, &self.in_place) {
                    Some(fall) => Outcome::Fell(fall),
                    None => Outcome::Crossing(crossing),
                });
            }
            if let Some(stall) = failure.of_wait(self.robot_time_s() - start_s) {
                return Ok(Outcome::Fell(stall));
            }
        }
    }

    /// What was measured of the stride that ends here.
    fn measured(&self, at_end: Option<&Pendulum>) -> StrideMeasures {
        let phase_rad = at_end.and_then(|p| self.gait.phase_rad(p.stance.other()));
        let (motion, true_motion) = self.motion.motion();
        StrideMeasures {
            motion,
            true_motion,
            gait_phase_deg: phase_rad.map_or(0.0, |phi| wrapped_rad(phi).to_degrees()),
            ..self.meter.measures(self.robot.state(), at_end)
        }
    }

    fn state_of(&self, at: &AtSection<'_>) -> State {
        let components = self.task.state.iter();
        components.map(|component| (component.of)(at)).collect()
    }

    fn at_section<'a>(&'a self, measures: &'a StrideMeasures, pendulum: Option<&'a Pendulum>) -> AtSection<'a> {
        let (goals, goal) = (self.goals.config(), self.goals.now());
        AtSection { measures, robot: self.robot.state(), pendulum, recent: self.motion.recent(), goals, goal }
    }

    fn count_end(&mut self, end: StrideEnd, fall: Option<&Fall>, in_stride: bool) {
        match end {
            StrideEnd::Fell => self.counters.falls += 1,
            StrideEnd::NoCrossing => self.counters.stalls += 1,
            StrideEnd::Crossing | StrideEnd::Aborted => {}
        }
        let stride = in_stride.then_some(self.counters.strides);
        self.falls.extend(fall.map(|fall| (stride, *fall)));
    }

    fn tell_end(&mut self, end: StrideEnd, fall: Option<&Fall>, in_stride: bool) {
        self.count_end(end, fall, in_stride);
        if let Some(log) = &mut self.log {
            log.ended(end, fall);
        }
    }

    /// One nominal start: reset, start-up, warm-up strides. A fall or a stall if it did not get so far.
    fn start(&mut self, rng: &mut ChaCha8Rng) -> Result<Result<State, Fall>, RobotError> {
        self.gait.reset();
        self.detector.reset();
        self.law.reset();
        self.pushes = Pushes::default();
        let start = self.robot.reset(self.gait.rest(), rng)?;
        self.first_com_height_m = start.com.position_m[2];
        self.meter.begin_episode(self.robot.state());
        self.motion.reset();
        self.in_place = InPlace::default();
        let mut sections = Vec::new();
        let mut strides_since_start_up = 0;
        loop {
            match self.run_to_section()? {
                Outcome::Crossing(crossing) => {
                    self.counters.warm_up += 1;
                    if self.robot_time_s() < self.gait.start_up_s() {
                        continue;
                    }
                    let p = &crossing.pendulum;
                    sections.push((p.roll_rad.to_degrees(), p.pitch_rate_rad_s.to_degrees()));
                    if strides_since_start_up < self.task.warm_up_strides {
                        strides_since_start_up += 1;
                        continue;
                    }
                    self.in_place = InPlace::of(&sections);
                    self.meter.begin_episode(self.robot.state());
                    self.true_way.begin_episode(self.robot.true_state());
                    let measures = self.measured(Some(&crossing.pendulum));
                    let at = self.at_section(&measures, Some(&crossing.pendulum));
                    return Ok(Ok(self.state_of(&at)));
                }
                Outcome::Fell(fall) => {
                    self.tell_end(fall.criterion.end(), Some(&fall), false);
                    return Ok(Err(fall));
                }
            }
        }
    }
}

fn world(error: impl std::error::Error + Send + Sync + 'static) -> ProcessError {
    ProcessError::World(Box::new(error))
}

impl StrideProcess for Plant {
    fn spec(&self) -> &ProcessSpec {
        &self.spec
    }

    fn reset(&mut self, rng: &mut ChaCha8Rng) -> Result<Situation, ProcessError> {
        self.at_section = false;
        self.began_at = (rng.get_stream(), u64::try_from(rng.get_word_pos()).unwrap_or(u64::MAX));
        self.goals.begin(rng);
        let mut attempts = 0;
        loop {
            attempts += 1;
            match self.start(rng).map_err(world)? {
                Ok(state) => {
                    self.at_section = true;
                    let (last_action, goal) = (self.law.last().clone(), self.goals.now().clone());
                    return Ok(Situation { state, last_action, goal });
                }
                Err(fall) if attempts == START_ATTEMPTS => {
                    return Err(world(LabError::NominalGaitFails {
                        attempts,
                        time_s: self.robot_time_s(),
                        fall,
                        how: String::new(),
                    }));
                }
                Err(_) => {}
            }
        }
    }

    fn stride(&mut self, action: &[f64], _rng: &mut ChaCha8Rng) -> Result<Stride, ProcessError> {
        if !self.at_section {
            return Err(ProcessError::NotReset);
        }
        if let Some(log) = &mut self.log {
            log.action(action);
        }
        let action = self.law.apply(action)?;
        for (component, value) in self.task.action.iter().zip(&action) {
            self.gait.modulate(component.modulation, *value).map_err(world)?;
        }
        self.begin_stride_of_pushes().map_err(world)?;
        self.meter.begin_stride(self.robot.state());
        self.motion.begin_stride();
        self.true_way.begin_stride(self.robot.true_state());
        self.counters.strides += 1;
        let mut fall = None;
        let (end, pendulum) = match self.run_to_section() {
            Ok(Outcome::Crossing(crossing)) => (StrideEnd::Crossing, Some(crossing.pendulum)),
            Ok(Outcome::Fell(cause)) => {
                fall = Some(cause);
                (cause.criterion.end(), self.detector.pendulum())
            }
            Err(error) => {
                self.abort_reason = Some(error);
                (StrideEnd::Aborted, self.detector.pendulum())
            }
        };
        self.at_section = end == StrideEnd::Crossing;
        self.tell_end(end, fall.as_ref(), true);
        self.last_fall = fall;
        let measures = self.measured(pendulum.as_ref());
        self.last_measures = measures;
        let at = self.at_section(&measures, pendulum.as_ref());
        let state = self.state_of(&at);
        let reward = match end {
            StrideEnd::Crossing => reward(&self.task.reward, &at),
            StrideEnd::Fell | StrideEnd::NoCrossing => self.task.failure.reward,
            StrideEnd::Aborted => 0.0,
        };
        self.goals.advance();
        let next = Situation { state, last_action: action, goal: self.goals.now().clone() };
        Ok(Stride { next, reward, end })
    }
}
