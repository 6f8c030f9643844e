//! The person beside a robot: what is asked before it moves, what it will do, what was answered.

use std::io::{BufRead, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use rand_chacha::ChaCha8Rng;
use stridemap_lab::seed::{Role, stream};
use stridemap_lab::{Plant, StrideObserver, Task, TickObserver};
use stridemap_link::{NEW_START, Operator, SharedJournal};
use stridemap_mujoco::MujocoConfig;
use stridemap_process::{Action, ActionLimits, Actor, Made, Next, ProcessError, Situation, StrideEnd, roll_out};
use stridemap_record::{FELL_IN_START, Fall, FallCriterion, append_event};
use stridemap_robot::{Robot, RobotState};
use stridemap_section::Crossing;

use crate::output;

/// What a command is about to make a robot do.
#[derive(Clone, Debug)]
pub enum Purpose {
    /// A whole run of the task.
    Learn,
    /// One batch of it.
    Collect,
    /// A policy, this often or for this long; `falls`: what is known of its falls.
    Apply { what: String, falls: String },
}

impl Purpose {
    /// A policy of a run, which fell so often when it was last measured.
    pub fn apply(what: impl Into<String>, falls_in: Option<(usize, usize)>) -> Self {
        Self::Apply {
            what: what.into(),
            falls: match falls_in {
                Some((falls, strides)) => {
                    format!("its policy fell {falls} times in {strides} strides when last measured")
                }
                None => "how often it falls is not known".into(),
            },
        }
    }
}

/// The last fall or stall, if nobody has looked at it.
pub type LastFall = Arc<Mutex<Option<Fall>>>;

/// The person at the terminal.
pub struct Person {
    plan: String,
    yes: bool,
    run: Option<PathBuf>,
    last_fall: LastFall,
    stop: Arc<AtomicBool>,
}

impl Person {
    /// Whoever answers for a task on a robot; answers are kept in the run's events, if there is a run.
    pub fn new(plan: String, yes: bool, run: Option<&Path>, last_fall: &LastFall, stop: Arc<AtomicBool>) -> Self {
        Self { plan, yes, run: run.map(Path::to_path_buf), last_fall: Arc::clone(last_fall), stop }
    }

    /// Waits for an answer; none, or Ctrl-C, is a no.
    fn ask(&self, why: &str) -> bool {
        output::note(format!("{why}: {}", self.plan));
        let mut stderr = std::io::stderr();
        let _ = write!(stderr, "is the robot set up, upright and clear to move? [y/N] ");
        let _ = stderr.flush();
        let (told, hears) = channel();
        std::thread::spawn(move || {
            let mut line = String::new();
            let read = std::io::stdin().lock().read_line(&mut line);
            let _ = told.send(read.is_ok() && matches!(line.trim(), "y" | "Y" | "yes"));
        });
        loop {
            match hears.recv_timeout(Duration::from_millis(50)) {
                Ok(answer) => return answer,
                Err(RecvTimeoutError::Timeout) if !self.stop.load(Ordering::Relaxed) => {}
                Err(_) => return false,
            }
        }
    }
}

impl Operator for Person {
    fn set_up(&mut self, why: &str) -> bool {
        let fall = self.last_fall.lock().ok().and_then(|mut fall| fall.take());
        let fell = fall.filter(|_| why == NEW_START).map(|fall| {
            let did = match fall.criterion {
                FallCriterion::NoSection => "stalled",
                _ => "fell",
            };
            format!("the robot {did}: {fall}")
        });
        let why = fell.as_deref().unwrap_or(why);
        // Between batches nothing has happened that a person must look at.
        if why == NEW_START {
            return true;
        }
        let answer = self.yes || self.ask(why);
        if let Some(run) = &self.run {
            let answered = match (answer, self.yes) {
                (true, true) => "yes (--yes)",
                (true, false) => "yes",
                (false, _) => "no",
            };
            let kept = append_event(
                run,
                "asked",
                serde_json::json!({ "asked": why, "plan": self.plan, "answered": answered }),
            );
            if let Err(error) = kept {
                output::note(format!("the answer is not in the run's events: {error}"));
            }
        }
        answer
    }

    fn can_mend(&self) -> bool {
        !self.yes
    }
}

/// Writes actions and sections into a robot's log, and keeps the last fall for the person.
pub struct Watcher {
    /// The log.
    pub journal: Option<SharedJournal>,
    /// The last fall.
    pub last_fall: LastFall,
    /// The run of a robot behind a link, which keeps its falls in starts as they happen.
    pub run: Option<PathBuf>,
    /// Whether a stride has begun.
    pub in_stride: bool,
}

impl StrideObserver for Watcher {
    fn action(&mut self, action: &[f64]) {
        self.in_stride = true;
        // A log that cannot be written is told by the machine that writes it as well.
        if let Some(Ok(mut journal)) = self.journal.as_ref().map(|j| j.lock()) {
            let _ = journal.action(action);
        }
    }

    fn section(&mut self, crossing: &Crossing) {
        let p = &crossing.pendulum;
        let numbers = [crossing.time_s, p.roll_rad.to_degrees(), p.pitch_rad.to_degrees(), p.stance.lateral_sign()];
        if let Some(Ok(mut journal)) = self.journal.as_ref().map(|j| j.lock()) {
            let _ = journal.section(&numbers);
        }
    }

    fn ended(&mut self, _: StrideEnd, fall: Option<&Fall>) {
        let in_start = !std::mem::take(&mut self.in_stride);
        if let (Some(run), Some(fall), true) = (&self.run, fall, in_start)
            && let Err(error) = append_event(run, FELL_IN_START, serde_json::json!(fall))
        {
            output::note(format!("the fall is not in the run's events: {error}"));
        }
        if let (Some(fall), Ok(mut last)) = (fall, self.last_fall.lock()) {
            *last = Some(*fall);
        }
    }
}

/// The fastest joint that was seen.
struct Fastest(Arc<Mutex<f64>>);

impl TickObserver for Fastest {
    fn tick(
        &mut self,
        _robot: &dyn Robot,
        state: &RobotState,
        _crossing: Option<&Crossing>,
        _push_n: Option<[f64; 3]>,
    ) {
        let rates = state.joints.iter().map(|j| j.velocity_rad_s.abs());
        let fastest = rates.fold(0.0, f64::max);
        if let Ok(mut most) = self.0.lock() {
            *most = most.max(fastest);
        }
    }
}

/// Walks one action, watched once it has started.
struct Fast {
    action: Action,
    most: Arc<Mutex<f64>>,
}

impl Actor<Plant, ProcessError> for Fast {
    fn begin(&mut self, plant: &mut Plant, _: &Situation) -> Result<Next, ProcessError> {
        plant.observe(Some(Box::new(Fastest(Arc::clone(&self.most)))));
        Ok(Next::Go)
    }
    fn act(&mut self, _: &mut Plant, _: &Situation, _: &mut ChaCha8Rng) -> Result<Action, ProcessError> {
        Ok(self.action.clone())
    }
    fn saw(&mut self, _: &mut Plant, made: Made<'_>) -> Result<Next, ProcessError> {
        Ok(if made.stride.end == StrideEnd::Crossing { Next::Go } else { Next::Stop })
    }
}

/// The largest joint rate of the task's gait on its model, simulated here: with the nominal action and at both
/// bounds of every action. `None` if the model cannot walk.
fn largest_joint_rate_rad_s(task: &Task) -> Option<f64> {
    /// Strides with each action.
    const STRIDES: usize = 8;
    let twin = Task {
        link: None,
        robot: MujocoConfig { hardware: None, estimated: false, ..task.robot.clone() },
        ..task.clone()
    };
    let limits = twin.action_limits().ok()?;
    let most = Arc::new(Mutex::new(0.0));
    let mut plant = twin.plant().ok()?;
    let mut rng = stream(0, Role::Run, 0);
    for bound in [|l: &ActionLimits| l.neutral, |l: &ActionLimits| l.lower, |l: &ActionLimits| l.upper] {
        plant.observe(None);
        let mut fast = Fast { action: limits.iter().map(bound).collect(), most: Arc::clone(&most) };
        roll_out(&mut plant, STRIDES, &mut fast, &mut rng).ok()?;
    }
    let most = most.lock().ok().map(|most| *most);
    most.filter(|rate| *rate > 0.0)
}

/// What a command will do to a robot, in a sentence: strides, largest joint rate, expected falls.
pub fn plan(task: &Task, purpose: &Purpose) -> String {
    let counts = &task.collect.strides;
    let batch = |i: usize| counts.get(i).or(counts.last()).copied().unwrap_or(0);
    let iterations = task.algorithm.iterations;
    let (what, falls) = match purpose {
        Purpose::Learn => {
            let evaluated = iterations * task.algorithm.evaluation_strides;
            let training = (0..iterations).map(batch).sum::<usize>() + evaluated;
            let measures = 2 + iterations;
            let measured = match task.record.walk_s {
                Some(seconds) => format!("walk {measures} times for {seconds:.0} s to measure"),
                None => format!(
                    "make {} strides to measure",
                    2 * (task.record.strides + task.record.discard)
                        + iterations * (task.record.iteration_strides + task.record.discard)
                ),
            };
            (
                format!("make about {training} strides to learn from and {measured}"),
                format!("at most {} falls are expected while learning", task.success.falls_at_most),
            )
        }
        Purpose::Collect => (
            format!("make a batch of strides ({} in the first)", batch(0)),
            format!("at most {} falls are expected", task.success.falls_at_most),
        ),
        Purpose::Apply { what, falls } => (what.clone(), falls.clone()),
    };
    let bounds: Vec<String> =
        task.action.iter().map(|a| format!("{} in [{}, {}]", a.modulates, a.bounds[0], a.bounds[1])).collect();
    let guard = task.robot.velocity_limit_rad_s;
    let rate = largest_joint_rate_rad_s(task).map_or_else(
        || format!("joints turn at up to {guard:.1} rad/s"),
        |rate| format!("joints turn at up to {rate:.1} rad/s in simulation (the guard holds them to {guard:.1})"),
    );
    format!("{} will {what}, with {}; {rate}; {falls}", task.name, bounds.join(", "))
}
