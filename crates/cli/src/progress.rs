//! What the person who waits is shown, on stderr: a live line in a terminal, a line per phase and
//! iteration in a pipe.

use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use stridemap_lab::run::Watcher;
use stridemap_lab::{Phase, Progress, StridePhase, Task, Transition};
use stridemap_learn::TrialSummary;
use stridemap_returnmap::StrideEnd;

use crate::output;

/// Least time between two live lines.
const LIVE_EVERY: Duration = Duration::from_millis(100);

/// Whether a robot behind a link is at work.
static ROBOT_AT_WORK: AtomicBool = AtomicBool::new(false);

/// A flag that Ctrl-C and termination set, the same for the whole process. The first sets it, so that the run
/// stops after the current stride; the second ends the process.
pub fn stop_flag() -> Arc<AtomicBool> {
    static FLAG: OnceLock<Arc<AtomicBool>> = OnceLock::new();
    let flag = FLAG.get_or_init(|| {
        let flag = Arc::new(AtomicBool::new(false));
        let seen = Arc::clone(&flag);
        // Without a handler Ctrl-C just ends the process; the run can be resumed then as well.
        let _ = ctrlc::set_handler(move || {
            if seen.swap(true, Ordering::Relaxed) {
                std::process::exit(130);
            }
            output::note(if ROBOT_AT_WORK.load(Ordering::Relaxed) {
                "emergency stop: the robot gives way until `stridemap stop --rearm` (again to end at once)"
            } else {
                "stopping after this stride (again to end at once)"
            });
        });
        flag
    });
    Arc::clone(flag)
}

/// The same flag where a robot behind a link is at work: there Ctrl-C is its emergency stop.
pub fn robot_stop_flag() -> Arc<AtomicBool> {
    ROBOT_AT_WORK.store(true, Ordering::Relaxed);
    stop_flag()
}

/// Expected strides of a whole run, for the time that is left.
fn expected_strides(task: &Task) -> usize {
    let counts = &task.collect.strides;
    let iterations = task.algorithm.iterations;
    let collected: usize = (0..iterations)
        .map(|i| counts.get(i).or(counts.last()).copied().unwrap_or(0))
        .sum();
    let evaluated = iterations * task.algorithm.evaluation_strides;
    let recorded = 2 * (task.record.strides + task.record.discard)
        + iterations * (task.record.iteration_strides + task.record.discard);
    collected + evaluated + recorded
}

/// Shows one run.
pub struct RunProgress {
    live: bool,
    expected: usize,
    made: usize,
    started: Instant,
    last_live: Option<Instant>,
    falls: usize,
}

impl RunProgress {
    /// A watcher of a run of this task.
    pub fn new(task: &Task) -> Self {
        Self {
            live: std::io::stderr().is_terminal(),
            expected: expected_strides(task),
            made: 0,
            started: Instant::now(),
            last_live: None,
            falls: 0,
        }
    }

    fn eta(&self) -> String {
        let rate = self.made as f64 / self.started.elapsed().as_secs_f64().max(1e-9);
        let left = self.expected.saturating_sub(self.made) as f64 / rate.max(1e-9);
        format!("{rate:.0} strides/s, about {left:.0} s left")
    }
}

impl Watcher for RunProgress {
    fn stride(&mut self, t: &Transition, what: Option<&str>) {
        self.made += 1;
        if t.end != StrideEnd::Crossing && t.phase != StridePhase::Record {
            self.falls += 1;
        }
        let due = self
            .last_live
            .is_none_or(|last| last.elapsed() >= LIVE_EVERY);
        if self.live && due {
            self.last_live = Some(Instant::now());
            let what = what.unwrap_or(t.phase.name());
            output::status(format!(
                "{what}: stride {} of {}, psi_roll {:+.2} deg, reward {:+.4}, falls {}; {}",
                self.made,
                self.expected,
                t.measures.psi_roll_deg,
                t.reward,
                self.falls,
                self.eta()
            ));
        }
    }

    fn trial(&mut self, iteration: usize, trial: &TrialSummary) {
        let due = self
            .last_live
            .is_none_or(|last| last.elapsed() >= LIVE_EVERY);
        if self.live && due {
            self.last_live = Some(Instant::now());
            output::status(format!(
                "iteration {iteration}: imagined trial {}, mean reward {:+.4}",
                trial.trial, trial.mean_reward
            ));
        }
    }

    fn phase(&mut self, phase: Phase, progress: &Progress) {
        if self.live {
            output::clear_status();
        }
        let n = progress.iterations.len();
        match phase {
            Phase::Nominal => {
                if let Some(p) = progress.nominal {
                    output::note(format!(
                        "nominal gait: reward {:+.4}, psi_roll {:.2} deg, {} falls ({})",
                        p.mean_reward,
                        p.mean_psi_roll_deg,
                        p.falls,
                        self.eta()
                    ));
                }
            }
            Phase::Record => {
                let record = progress.iterations.last().and_then(|i| i.record);
                if let Some(p) = record {
                    output::note(format!(
                        "iteration {n}: {} strides so far, {} falls; policy: reward {:+.4}, psi_roll \
                         {:.2} deg ({})",
                        progress.transitions.len(),
                        self.falls,
                        p.mean_reward,
                        p.mean_psi_roll_deg,
                        self.eta()
                    ));
                }
            }
            Phase::Collect | Phase::Improve | Phase::Evaluate | Phase::Final => {}
        }
    }
}

/// Counts finished seeds.
pub struct SeedProgress {
    total: usize,
    done: AtomicUsize,
    started: Instant,
}

impl SeedProgress {
    /// A counter for this many seeds.
    pub fn new(total: usize) -> Self {
        Self {
            total,
            done: AtomicUsize::new(0),
            started: Instant::now(),
        }
    }

    /// One more seed is done.
    pub fn done(&self, text: &str) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        let elapsed = self.started.elapsed().as_secs_f64();
        let left = elapsed / done as f64 * (self.total - done.min(self.total)) as f64;
        output::note(format!(
            "[{done}/{}] {text} (about {left:.0} s left)",
            self.total
        ));
    }
}
