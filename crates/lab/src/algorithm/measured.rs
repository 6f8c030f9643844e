//! Policies measured to report: the nominal gait, each iteration's, the final one.

use stridemap_learn::SavedPolicy;
use stridemap_record::{Pace, Performance, Phase, StridePhase, StrideRole, Transition, Walk};

use super::{Algorithm, Recorder};
use crate::error::LabError;
use crate::plant::Batch;
use crate::poses::Filming;
use crate::seed::{Role, stream};
use crate::walk::Walker;

/// Robot time from a fresh start up to which a time lapse is recorded.
const LAPSE_S: f64 = 60.0;

/// About the duration of a stride of the nominal gait, for where a film begins.
const WARM_UP_STRIDE_S: f64 = 0.6;

impl Algorithm<'_> {
    /// Has the next batch recorded, where the task wants pictures: a time lapse, and a film.
    pub(super) fn film(&mut self, lapse: bool, film: bool) -> Filming {
        let seconds = self.task.record.pose_seconds;
        // A start that steps on the spot first is filmed from the end of it.
        let warm_up_s = WARM_UP_STRIDE_S * self.task.collect.warm_up_strides as f64;
        let begin_s = self.plant.start_up_s() + warm_up_s;
        let takes = [(film, Pace::Film, [begin_s, begin_s + seconds]), (lapse, Pace::Lapse, [0.0, LAPSE_S])];
        let wanted = takes.iter().filter(|take| take.0 && seconds > 0.0);
        let wanted: Vec<_> = wanted.map(|&(_, pace, span)| (pace, span)).collect();
        Filming::begin(&mut self.plant, &wanted)
    }

    /// Measures a policy to report: deterministic, from a fresh start.
    pub(super) fn measure(
        &mut self,
        policy: &SavedPolicy,
        what: &str,
        strides: usize,
        stream_index: u64,
        recorder: &mut dyn Recorder,
    ) -> Result<Performance, LabError> {
        if !self.task.goal.is_empty() {
            return self.measure_on_goals(policy, what, strides, stream_index, recorder);
        }
        let discard = self.task.record.discard;
        let batch = Batch {
            iteration: self.progress.policies.len(),
            phase: StridePhase::Record,
            role: StrideRole::Record,
            strides: strides + discard,
        };
        // A film of the first policy learned as well: the paper shows it stepping.
        let film = !what.starts_with("iteration") || what == "iteration-1";
        let filming = self.film(true, film);
        let times =
            if what.starts_with("iteration") { self.task.record.iteration_walk() } else { self.task.record.walk() };
        let result = match times {
            Some(t) => self.walk_on_robot(policy, batch, (what, t.walk_s), stream_index, recorder),
            None => self
                .strides_on_robot(Some(policy), batch, Some(what), (Role::Record, stream_index), recorder)
                .map(|(transitions, _)| transitions),
        };
        let takes = filming.end(&mut self.plant);
        let transitions = result?;
        takes.keep(what, &transitions, recorder)?;
        self.progress.record_strides += transitions.len();
        Ok(Performance {
            walk: times.map(|times| Walk::of(&transitions, times)),
            ..Performance::of(&transitions, discard)
        })
    }

    /// Walks a policy's mean from stepping on the spot, for some time or to the fall.
    pub(super) fn walk_on_robot(
        &mut self,
        policy: &SavedPolicy,
        batch: Batch,
        (what, seconds): (&str, f64),
        stream_index: u64,
        recorder: &mut dyn Recorder,
    ) -> Result<Vec<Transition>, LabError> {
        let batch = Batch {
            strides: usize::MAX, // time ends it
            ..batch
        };
        let mut rng = stream(self.seed, Role::Record, stream_index);
        let mut walker = Walker::new(policy, seconds);
        let made = self.make(&mut walker, batch, Some(what), &mut rng, recorder)?;
        Ok(made.0)
    }

    pub(super) fn measure_nominal(&mut self, recorder: &mut dyn Recorder) -> Result<(), LabError> {
        let policy = self.task.nominal_policy()?;
        let performance = self.measure(&policy, "nominal", self.task.record.strides, 0, recorder)?;
        self.progress.nominal = Some(performance);
        recorder.checkpoint(Phase::Nominal, &self.progress)
    }

    pub(super) fn record_iteration(&mut self, recorder: &mut dyn Recorder) -> Result<(), LabError> {
        let n = self.progress.policies.len();
        let policy = self.progress.policies[n - 1].clone();
        let what = format!("iteration-{n}");
        let strides = self.task.record.iteration_strides;
        let performance = self.measure(&policy, &what, strides, n as u64, recorder)?;
        self.progress.iterations[n - 1].record = Some(performance);
        recorder.checkpoint(Phase::Record, &self.progress)
    }

    /// Measures the best policy as the final one. If it does not beat the nominal gait, the next is the best.
    pub(super) fn measure_final(&mut self, recorder: &mut dyn Recorder) -> Result<(), LabError> {
        let policy = self.progress.final_policy(self.task)?;
        let strides = self.task.record.strides;
        let tried = self.progress.iterations.iter();
        let rejected = tried.filter(|i| i.rejected.is_some()).count();
        let stream_index = u64::from(u32::MAX) - rejected as u64;
        let performance = self.measure(&policy, "final", strides, stream_index, recorder)?;
        self.progress.accept(performance);
        recorder.checkpoint(Phase::Final, &self.progress)
    }
}
