//! A run of our own as a record of strides, and its policy counted on its plant.

use rayon::prelude::*;
use serde::Serialize;
use stridemap_lab::run::FinishedRun;
use stridemap_lab::seed::{Role, stream};
use stridemap_lab::{Batch, Task, Walker, drive};
use stridemap_learn::SavedPolicy;
use stridemap_process::StrideEnd;
use stridemap_record::{Fall, FallCriterion, Run, StridePhase, StrideRole, Transition};
use stridemap_robot::Side;
use stridemap_stability::{Bout, FallRule, Record, StabilityError};

use super::beta_interval;
use crate::failure::Failure;

/// Components that say where the robot is and not how it walks.
const NOT_THE_GAIT: [&str; 1] = ["heading_deg"];
/// Components of the state that are looked at unless others are named.
const DEFAULT_STATES: usize = 3;

/// Strides of a run as a record: unbroken stretches, falls where they ended in one.
fn record_of(strides: &[&Transition], names: &[String], kept: &[usize]) -> Record {
    let pick = |x: &[f64]| -> Vec<f64> { kept.iter().map(|i| x[*i]).collect() };
    let mut record = Record { state: kept.iter().map(|i| names[*i].clone()).collect(), ..Record::default() };
    for stretch in strides.chunk_by(|a, b| a.episode == b.episode && b.k == a.k + 1) {
        let mut bout = Bout::default();
        for t in stretch {
            bout.states.push(pick(&t.state));
            bout.sides.extend(t.stance.map(|side| u8::from(side == Side::Left)));
        }
        if bout.sides.len() != bout.states.len() {
            bout.sides.clear();
        }
        if let Some(last) = stretch.last() {
            match last.end {
                StrideEnd::Crossing => {
                    bout.states.push(pick(&last.next_state));
                    if !bout.sides.is_empty() {
                        bout.sides.push(1 - bout.sides[bout.sides.len() - 1]);
                    }
                }
                StrideEnd::Fell | StrideEnd::NoCrossing => {
                    let at_section = |f: Fall| f.criterion == FallCriterion::PsiRoll;
                    bout.fell = true;
                    bout.fallen_state = last.fall.is_some_and(at_section).then(|| pick(&last.next_state));
                }
                StrideEnd::Aborted => {}
            }
        }
        record.bouts.push(bout);
    }
    let durations = strides.iter().filter(|t| t.end == StrideEnd::Crossing).map(|t| t.measures.duration_s);
    let (n, sum) = durations.fold((0, 0.0), |(n, sum), d| (n + 1, sum + d));
    record.stride_s = (n > 0 && sum > 0.0).then(|| sum / f64::from(n));
    record
}

/// Which components of a run's state: those named, or the first three that say how it walks.
fn kept(names: &[String], state: &[String]) -> Result<Vec<usize>, Failure> {
    if state.is_empty() {
        let gait = |i: &usize| !NOT_THE_GAIT.contains(&names[*i].as_str());
        return Ok((0..names.len()).filter(gait).take(DEFAULT_STATES).collect());
    }
    let find = |name: &String| {
        let found = names.iter().position(|n| n == name.trim());
        let unknown = || StabilityError::Unknown { name: name.clone(), known: names.join(", ") };
        found.ok_or_else(|| Failure::request(unknown().to_string()))
    };
    state.iter().map(find).collect()
}

/// The strides of one policy of a run, after those that are not averaged.
pub fn of_run(run: &Run, what: &str, state: &[String]) -> Result<Record, Failure> {
    let discard = run.record_discard().unwrap_or(10);
    let strides: Vec<&Transition> =
        run.record.iter().filter(|(of, t)| of == what && t.k >= discard).map(|(_, t)| t).collect();
    if strides.is_empty() {
        let mut known: Vec<&str> = run.record.iter().map(|(of, _)| of.as_str()).collect();
        known.dedup();
        let known = known.join(", ");
        let dir = run.dir.display();
        return Err(Failure::request(format!("{dir}: record.csv has no strides of {what:?}; it has those of {known}")));
    }
    of_strides(&strides, &run.columns.state, state)
}

/// A record of strides with these components, of which some may be named.
pub fn of_strides(strides: &[&Transition], names: &[String], state: &[String]) -> Result<Record, Failure> {
    Ok(record_of(strides, names, &kept(names, state)?))
}

/// What the task calls a fall, if that is about a component that is looked at.
pub fn rule_of(run: &FinishedRun, record: &Record) -> Option<FallRule> {
    let component = "psi_roll_deg".to_owned();
    let boundary = run.task.failure.least_psi_roll_deg(&run.progress.in_place());
    (record.state.contains(&component) && boundary.is_finite()).then_some(FallRule { component, below: true, boundary })
}

/// Walks that were counted.
#[derive(Clone, Debug, Serialize)]
pub struct BruteForce {
    /// Walks of 60 s, from the end of the transient.
    pub walks: usize,
    /// Those that ended in a fall.
    pub falls: usize,
    /// Strides in all.
    pub strides: usize,
    /// Share that fell, and its 95 % interval (Jeffreys).
    pub probability_60_s: [f64; 3],
    /// Strides to a fall: strides over falls, and the interval; null without a fall.
    pub strides_to_fall: [Option<f64>; 3],
}

/// One walk: strides after the transient, and whether it fell. A fall in the transient is none of the gait's.
fn walk(task: &Task, policy: &SavedPolicy, seed: u64, discard: usize) -> Result<Option<(usize, bool)>, Failure> {
    const WALK_S: f64 = 60.0;
    const TRANSIENT_S: f64 = 20.0;
    let mut plant = task.plant()?;
    let mut rng = stream(seed, Role::Run, 0);
    let mut walker = Walker::new(policy, WALK_S + TRANSIENT_S);
    let batch = Batch { iteration: 0, phase: StridePhase::Record, role: StrideRole::Record, strides: usize::MAX };
    let strides = drive(&mut plant, &mut walker, batch, &mut rng, &mut |_, _| {}, &mut |_| Ok(()))?;
    let mut after = strides.iter().filter(|t| t.k >= discard);
    let Some(first) = after.next() else { return Ok(None) };
    let begins_s = first.time_s - first.measures.duration_s;
    let within: Vec<&Transition> =
        std::iter::once(first).chain(after).take_while(|t| t.time_s <= begins_s + WALK_S).collect();
    let fell = within.iter().any(|t| matches!(t.end, StrideEnd::Fell | StrideEnd::NoCrossing));
    Ok(Some((within.len(), fell)))
}

/// Counts falls of a run's policy on its plant, in so many walks of 60 s.
pub fn brute_force(run: &FinishedRun, walks: usize, seed: u64, threads: Option<usize>) -> Result<BruteForce, Failure> {
    let policy = run.policy()?;
    let discard = run.task.record.discard;
    let progress = crate::progress::SeedProgress::new(walks, "walks");
    let one = |number: u64| {
        let walked = walk(&run.task, &policy, seed.wrapping_mul(1_000_003).wrapping_add(number), discard);
        progress.done(&format!("walk {number}"));
        walked
    };
    let all: Vec<_> = crate::parallel::within(threads, || (1..=walks as u64).into_par_iter().map(one).collect())?;
    let mut told: Vec<(usize, bool)> = Vec::new();
    for walked in all {
        told.extend(walked?);
    }
    let (n, falls) = (told.len(), told.iter().filter(|w| w.1).count());
    let strides: usize = told.iter().map(|w| w.0).sum();
    let [low, high] = beta_interval(falls, n);
    let [slow, fast] = beta_interval(falls, strides);
    let share = |a: usize, b: usize| a as f64 / b.max(1) as f64;
    Ok(BruteForce {
        walks: n,
        falls,
        strides,
        probability_60_s: [share(falls, n), low, high],
        strides_to_fall: [
            (falls > 0).then(|| share(strides, falls)),
            Some(fast.recip()).filter(|x| x.is_finite()),
            (falls > 0).then(|| slow.recip()),
        ],
    })
}
