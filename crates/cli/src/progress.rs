//! What the person who waits is shown, on stderr: in a terminal a live line, and a line that stays for each
//! iteration; in a pipe a line every ten seconds.

use std::io::IsTerminal;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use stridemap_lab::run::Watcher;
use stridemap_lab::{Progress, Task};
use stridemap_learn::TrialSummary;
use stridemap_process::StrideEnd;
use stridemap_record::{Performance, Phase, StridePhase, Transition, Verdict};

use crate::output;

/// Least time between two live lines.
const LIVE_EVERY: Duration = Duration::from_millis(100);
/// Time between two lines where nobody sits at a terminal.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// Strides that a phase which only measures makes: of one measured policy.
fn measured_strides(task: &Task, iteration: bool) -> usize {
    /// About the duration of a stride, for tasks that measure for a time.
    const STRIDE_S: f64 = 0.55;
    match task.record.walk_s {
        Some(seconds) => (seconds / STRIDE_S).round() as usize,
        None if iteration => task.record.iteration_strides + task.record.discard,
        None => task.record.strides + task.record.discard,
    }
}

/// Expected strides of a whole run after `done` iterations with `learned` strides in the budget: for the
/// time that is left. Where policies are proven the number of iterations is not known before the end.
fn expected_strides(task: &Task, done: usize, learned: usize) -> usize {
    let counts = &task.collect.strides;
    let collected = |i: usize| counts.get(i).or(counts.last()).copied().unwrap_or(0);
    // A proof takes the place of evaluation strides.
    let per_iteration = match &task.caution {
        Some(caution) => caution.proof.proof_strides,
        None => task.algorithm.evaluation_strides,
    };
    let most = task.algorithm.iterations;
    let (mut iterations, mut strides) = (done, learned);
    let budget = task.algorithm.strides_at_most.unwrap_or(usize::MAX);
    // One by one while the task lists their strides; all that follow are alike.
    while iterations < most.min(counts.len()) && strides < budget {
        strides = (strides + collected(iterations) + per_iteration).min(budget);
        iterations += 1;
    }
    let each = collected(iterations) + per_iteration;
    let left = budget.saturating_sub(strides);
    let more = if each == 0 { most } else { left.div_ceil(each) };
    let more = more.min(most.saturating_sub(iterations));
    iterations += more;
    strides = strides.saturating_add(more.saturating_mul(each)).min(budget.max(strides));
    strides + iterations * measured_strides(task, true) + 2 * measured_strides(task, false)
}

/// Says something every ten seconds, however long a stride or a fit takes, until it is dropped.
struct Ticker(#[expect(dead_code, reason = "its end stops the thread")] Sender<()>);

impl Ticker {
    /// Begins to say `line`, where it has something to say.
    fn start(line: impl Fn() -> Option<String> + Send + 'static) -> Self {
        let (stop, stopped) = channel();
        std::thread::spawn(move || {
            while stopped.recv_timeout(LINE_EVERY) == Err(RecvTimeoutError::Timeout) {
                if let Some(line) = line() {
                    output::note(line);
                }
            }
        });
        Self(stop)
    }
}

/// What a run is doing, and how far it is.
struct State {
    /// In words; empty before the first stride.
    doing: String,
    made: usize,
    expected: usize,
    started: Instant,
}

impl State {
    /// The estimate first: a narrow terminal cuts the end.
    fn line(&self) -> String {
        format!("{}; {}", self.estimate(), self.doing)
    }

    fn estimate(&self) -> String {
        let rate = self.made as f64 / self.started.elapsed().as_secs_f64().max(1e-9);
        if self.made == 0 {
            return "estimating".into();
        }
        let left = self.expected.saturating_sub(self.made) as f64 / rate;
        let digits = if rate < 10.0 { 1 } else { 0 };
        format!("{} left, {rate:.digits$} strides/s", duration(left))
    }
}

/// Shows one run: in a terminal a live line per stride and trial, a line that stays per iteration; in a pipe a
/// line every ten seconds.
pub struct RunProgress {
    live: bool,
    task: Task,
    state: Arc<Mutex<State>>,
    learned: usize,
    iterations: usize,
    last_live: Option<Instant>,
    falls: usize,
    /// During what the last fall was that was told.
    fell: String,
    _ticker: Option<Ticker>,
}

impl RunProgress {
    /// A watcher of a run that goes on.
    pub fn after(task: &Task, progress: &Progress) -> Self {
        let mut watcher = Self::new(task);
        watcher.counts(progress);
        watcher
    }

    /// Takes over what a run has counted.
    fn counts(&mut self, progress: &Progress) {
        self.learned = progress.transitions.len();
        self.falls = progress.iterations.iter().map(|i| i.falls + i.stalls).sum();
    }

    /// A watcher of a run of this task.
    pub fn new(task: &Task) -> Self {
        let state = Arc::new(Mutex::new(State {
            doing: String::new(),
            made: 0,
            expected: expected_strides(task, 0, 0),
            started: Instant::now(),
        }));
        let live = std::io::stderr().is_terminal();
        let ticker = (!live).then(|| {
            let state = Arc::clone(&state);
            Ticker::start(move || {
                let state = state.lock().unwrap_or_else(PoisonError::into_inner);
                (!state.doing.is_empty()).then(|| state.line())
            })
        });
        Self {
            live,
            task: task.clone(),
            state,
            learned: 0,
            iterations: 0,
            last_live: None,
            falls: 0,
            fell: String::new(),
            _ticker: ticker,
        }
    }

    /// Notes what is being done, `made` strides more than before, and shows it if it is time.
    fn show(&mut self, made: usize, doing: String) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.made += made;
        state.expected = expected_strides(&self.task, self.iterations, self.learned);
        state.doing = doing;
        let line = state.line();
        drop(state);
        if self.due() {
            output::status(line);
        }
    }

    fn estimate(&self) -> String {
        let state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.estimate()
    }

    /// Whether it is time for another live line.
    fn due(&mut self) -> bool {
        let last = self.last_live;
        let due = self.live && last.is_none_or(|last| last.elapsed() >= LIVE_EVERY);
        if due {
            self.last_live = Some(Instant::now());
        }
        due
    }

    /// What a stride did, in a few words.
    fn did(&self, t: &Transition) -> String {
        match (t.end, &t.fall) {
            (StrideEnd::Fell | StrideEnd::NoCrossing, Some(fall)) => {
                return format!("fell: {fall}");
            }
            (StrideEnd::Fell | StrideEnd::NoCrossing, None) => return "fell".into(),
            (StrideEnd::Aborted, _) => return "stopped by its equipment".into(),
            (StrideEnd::Crossing, _) => {}
        }
        let m = &t.measures;
        if self.task.record.walk_s.is_some() {
            format!(
                "{:.2} m/s, turn {:+.1} deg, psi_roll {:+.2} deg",
                m.forward_m / m.duration_s.max(f64::MIN_POSITIVE),
                m.turn_deg,
                m.psi_roll_deg
            )
        } else {
            format!("psi_roll {:+.2} deg, reward {:+.4}", m.psi_roll_deg, t.reward)
        }
    }

    /// A line that stays.
    fn keep(&self, text: impl AsRef<str>) {
        if self.live {
            output::clear_status();
            output::note(text);
        }
    }

    /// A measured policy in a few words: of a walk its speed, else its reward.
    pub fn measured(p: &Performance) -> String {
        let falls = match p.falls {
            0 => "no falls".to_owned(),
            1 => "1 fall".to_owned(),
            n => format!("{n} falls"),
        };
        match p.walk {
            Some(walk) => format!("{:.3} m/s, upright {:.0} s, {falls}", walk.speed_m_s, walk.upright_s),
            None => format!("reward {:+.4}, {}, {falls}", p.mean_reward, p.psi_roll()),
        }
    }
}

/// Seconds as one reads them on a clock.
pub fn duration(seconds: f64) -> String {
    let whole = seconds.round() as u64;
    match whole {
        0..60 => format!("{whole} s"),
        60..3600 => format!("{} min {:02} s", whole / 60, whole % 60),
        _ => format!("{} h {:02} min", whole / 3600, whole / 60 % 60),
    }
}

impl Watcher for RunProgress {
    fn note(&mut self, text: &str) {
        output::note(text);
    }

    fn stride(&mut self, t: &Transition, what: Option<&str>) {
        let learning = t.phase != StridePhase::Record;
        if learning {
            self.learned += 1;
            self.falls += usize::from(t.fall.is_some());
        }
        let doing = match (t.phase, what) {
            (StridePhase::Collect, _) => format!("iteration {}, collecting", t.iteration),
            (StridePhase::Evaluate, _) => format!("iteration {}, trying the policy", t.iteration),
            (StridePhase::Record, what) => format!("measuring {}", what.unwrap_or("the policy")),
        };
        let count = if learning { self.learned } else { t.k + 1 };
        let did = self.did(t);
        let line = format!("{doing}: stride {count}, {did}");
        self.show(1, format!("falls {}; {line}", self.falls));
        // A fall on the robot is told in a pipe as well, and at once; of a measured policy the first.
        if t.fall.is_some() && (learning || self.fell != doing) {
            if self.live {
                output::clear_status();
            }
            let outside = !self.task.counts_falls_in(t.phase);
            output::note(line + if outside { " (no part of the fall budget)" } else { "" });
            self.fell = doing;
        }
    }

    fn trial(&mut self, iteration: usize, trial: &TrialSummary) {
        let mean = if self.task.rewards_speed() {
            format!("mean {:.3} m/s", trial.mean_reward)
        } else {
            format!("mean reward {:+.4}", trial.mean_reward)
        };
        let n = trial.trial;
        self.show(0, format!("iteration {iteration}, learning in the map: trial {n}, {mean}"));
    }

    fn phase(&mut self, phase: Phase, progress: &Progress) {
        let n = progress.iterations.len();
        let last = progress.iterations.last();
        self.counts(progress);
        match phase {
            Phase::Nominal => {
                if let Some(p) = &progress.nominal {
                    self.keep(format!("nominal gait: {}", Self::measured(p)));
                }
            }
            Phase::Record => {
                self.iterations = n;
                let (Some(last), Some(p)) = (last, last.and_then(|i| i.record.as_ref())) else {
                    return;
                };
                let proof = last.proof.as_ref().map_or_else(String::new, |p| format!(", {}", verdict(p.verdict)));
                self.keep(format!(
                    "iteration {n}: {} strides and {} falls so far; policy{proof}: {} ({})",
                    self.learned,
                    self.falls,
                    Self::measured(p),
                    self.estimate()
                ));
            }
            Phase::Final => {
                if let Some(p) = &progress.final_performance {
                    self.keep(format!("final policy: {}", Self::measured(p)));
                }
            }
            Phase::Collect | Phase::Improve | Phase::Evaluate => {}
        }
    }
}

/// What became of a policy, in a word or two.
fn verdict(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Proven => "proven",
        Verdict::Slower => "no faster than the best",
        Verdict::Warned => "turned back by the guard",
        Verdict::Fell => "which fell",
        Verdict::Unfinished => "not finished",
    }
}

/// Counts finished seeds: a line for each in a terminal, one every ten seconds in a pipe.
pub struct SeedProgress {
    live: bool,
    total: usize,
    noun: &'static str,
    done: Arc<AtomicUsize>,
    started: Instant,
    _ticker: Option<Ticker>,
}

impl SeedProgress {
    /// A counter for so many seeds, or what `noun` says.
    pub fn new(total: usize, noun: &'static str) -> Self {
        let (done, started) = (Arc::new(AtomicUsize::new(0)), Instant::now());
        let live = std::io::stderr().is_terminal();
        let ticker = (!live).then(|| {
            let done = Arc::clone(&done);
            Ticker::start(move || Some(count_line(done.load(Ordering::Relaxed), total, noun, started)))
        });
        Self { live, total, noun, done, started, _ticker: ticker }
    }

    /// One more seed is done.
    pub fn done(&self, text: &str) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        if self.live {
            output::note(format!("{}; {text}", count_line(done, self.total, self.noun, self.started)));
        }
    }
}

/// How many are done, how fast, and how long the rest may take.
fn count_line(done: usize, total: usize, noun: &str, started: Instant) -> String {
    if done == 0 {
        return format!("[0/{total}] estimating");
    }
    let each_s = started.elapsed().as_secs_f64() / done as f64;
    let left = each_s * (total - done.min(total)) as f64;
    format!("[{done}/{total}] {} left, {:.1} {noun}/min", duration(left), 60.0 / each_s.max(1e-9))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn expected_strides_follow_the_budget() {
        // stepping: 20 + 12, then 16 + 12; 30 + 10 for each iteration, 100 + 10 before and after.
        let task = stridemap_lab::builtin::load("stepping", &[]).unwrap().task;
        assert_eq!(expected_strides(&task, 0, 0), 60 + 2 * 40 + 2 * 110);
        // One iteration is done, with 32 strides: the rest is the same.
        assert_eq!(expected_strides(&task, 1, 32), 60 + 2 * 40 + 2 * 110);
        // walking: 100 and proofs of 60 up to 300 strides; 60 s, about 109 strides, for each policy.
        let task = stridemap_lab::builtin::load("walking", &[]).unwrap().task;
        assert_eq!(expected_strides(&task, 0, 0), 300 + 4 * 109 + 2 * 109);
        // 10,000 iterations of 16 and 12 strides but for the first, which has 20: without counting them.
        let mut task = stridemap_lab::builtin::load("stepping", &[]).unwrap().task;
        task.algorithm.iterations = 10_000;
        assert_eq!(expected_strides(&task, 0, 0), 4 + 10_000 * (28 + 40) + 2 * 110);
    }

    #[test]
    fn a_line_begins_with_its_estimate() {
        let state = State {
            doing: "iteration 1, collecting: stride 12".into(),
            made: 30,
            expected: 280,
            started: Instant::now().checked_sub(Duration::from_secs(15)).unwrap(),
        };
        let line = state.line();
        assert!(line.starts_with("2 min 05 s left, 2.0 strides/s; iteration 1"), "{line}");
        assert!(output::fitted(&line, 20).starts_with("2 min 05 s left,"));
    }

    #[test]
    fn durations_read_as_on_a_clock() {
        assert_eq!(duration(7.4), "7 s");
        assert_eq!(duration(125.0), "2 min 05 s");
        assert_eq!(duration(7260.0), "2 h 01 min");
    }
}
