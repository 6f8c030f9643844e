//! Applying a policy without learning: `evaluate`, `run`, `push`.

use std::path::Path;
use std::sync::{Arc, Mutex};

use serde::Serialize;
use stridemap_lab::builtin::LoadedTask;
use stridemap_lab::run::FinishedRun;
use stridemap_lab::seed::{Role, stream};
use stridemap_lab::{
    ActionSource, Batch, LabError, Plant, PoseRecorder, PushConfig, Task, analyse as analyse_run, builtin,
    make_strides, push as push_plant, verbs,
};
use stridemap_learn::SavedPolicy;
use stridemap_process::{StrideEnd, StrideProcess};
use stridemap_record::{
    Columns, Fall, FallCriterion, Measured, Performance, Recording, StridePhase, StrideRole, Transition,
    files::{self, lock},
};

use super::beside::Purpose;
use super::drift::{Changed, Drift, DriftShown};
use super::linked::{beside_run, plant};
use super::{on_robot, say_differences};
use crate::args::{Change, Common};
use crate::failure::Failure;
use crate::output;

/// Falls, and the strides in which they were counted.
pub type FallsIn = (usize, usize);

/// A run's task, with overrides, its policy or the nominal gait, and how often that fell when last measured.
pub fn task_and_policy(
    path: &Path,
    nominal: bool,
    common: &Common,
) -> Result<(Task, SavedPolicy, Option<FallsIn>), Failure> {
    let run = FinishedRun::open(path, &common.sets)?;
    say_differences(path);
    let loaded = LoadedTask { task: run.task.clone(), resolved: String::new(), file: None };
    let task = on_robot(loaded, common)?.task;
    let measured = if nominal { run.progress.nominal } else { run.progress.final_performance };
    let falls = measured.map(|p| (p.falls, p.strides));
    let policy = if nominal { task.nominal_policy()? } else { run.policy()? };
    policy.check_fits(&task.process_spec()?).map_err(LabError::from)?;
    Ok((task, policy, falls))
}

#[derive(Serialize)]
struct Evaluated {
    #[serde(flatten)]
    measured: Measured,
    policy: &'static str,
    causes: Vec<Fall>,
}

/// The causes of a plant's falls and stalls.
fn causes(plant: &Plant) -> Vec<Fall> {
    plant.falls().iter().map(|(_, fall)| *fall).collect()
}

/// Says why the robot fell: each cause once, with how often it was and its first value.
fn show_causes(causes: &[Fall]) {
    for criterion in FallCriterion::ALL {
        let of = || causes.iter().filter(|fall| fall.criterion == criterion);
        if let Some(first) = of().next() {
            let more = match of().count() {
                1 => String::new(),
                n => format!(" (the first of {n} like it)"),
            };
            output::line(format!("  fell: {first}{more}"));
        }
    }
}

/// Measures a policy on the robot.
pub fn evaluate(path: &Path, strides: usize, nominal: bool, common: &Common) -> Result<(), Failure> {
    let (task, policy, falls) = task_and_policy(path, nominal, common)?;
    let doing = Purpose::apply(format!("make {strides} strides to measure a policy"), falls);
    let beside = beside_run(&task, Some(path))?;
    let mut plant = plant(&task, common, &doing, beside.as_deref())?;
    let performance = verbs::evaluate(&task, &mut plant, &policy, strides, common.seed)?;
    let shown = Evaluated {
        measured: Measured::from(performance),
        policy: if nominal { "nominal" } else { "learned" },
        causes: causes(&plant),
    };
    if common.json {
        return output::json(&shown);
    }
    let p = &shown.measured.performance;
    if let Some(walk) = p.walk {
        output::line(format!(
            "{} policy: {:.3} m/s, upright for {:.1} s, {:+.2} m to the left, heading {:+.0} deg",
            shown.policy, walk.speed_m_s, walk.upright_s, walk.drift_m, walk.heading_change_deg
        ));
    }
    let reward = match p.walk {
        Some(_) => String::new(),
        None => format!("reward {:+.4}, ", p.mean_reward),
    };
    output::line(format!(
        "{} policy: {reward}{}, {} falls, {} stalls in {} strides",
        shown.policy,
        p.psi_roll(),
        p.falls,
        p.stalls,
        p.strides
    ));
    show_causes(&shown.causes);
    Ok(())
}

#[derive(Serialize)]
struct Walked {
    seconds: f64,
    upright_s: f64,
    strides: usize,
    falls: usize,
    stalls: usize,
    causes: Vec<Fall>,
    mean_reward: f64,
    mean_psi_roll_deg: Option<f64>,
    stride_duration_s: f64,
    forward_m: f64,
    left_m: f64,
    speed_m_s: f64,
    drift: Option<DriftShown>,
}

/// Applies a policy for some time, until the first fall.
pub fn run(
    path: Option<&Path>,
    nominal: Option<&str>,
    (seconds, change): (f64, &Change),
    out: Option<&Path>,
    common: &Common,
) -> Result<(), Failure> {
    let mut changed = Changed::of(path, nominal, change, common)?;
    let mut drift = Drift::of(path);
    let (task, policy, falls) = match (path, nominal) {
        (Some(path), _) => task_and_policy(path, false, common)?,
        (None, Some(name)) => {
            let task = on_robot(builtin::load(name, &common.sets)?, common)?.task;
            let policy = task.nominal_policy()?;
            (task, policy, None)
        }
        (None, None) => return Err(Failure::request("run needs a RUN or --nominal TASK")),
    };
    let doing = Purpose::apply(format!("step or walk for {seconds} s"), falls);
    let beside = beside_run(&task, path)?;
    let mut plant = plant(&task, common, &doing, beside.as_deref())?;
    let mut rng = stream(common.seed, Role::Run, 0);
    let table = Columns::new(plant.spec());
    let mut rows = vec![table.header()];
    let mut transitions: Vec<Transition> = Vec::new();
    let batch = Batch { iteration: 0, phase: StridePhase::Record, role: StrideRole::Record, strides: usize::MAX };
    let failed = std::cell::Cell::new(None);
    // The batch has no end of its own: time or a fall ends it, by way of an error that is none.
    let result = make_strides(
        &mut plant,
        &ActionSource::Mean(&policy),
        Batch { strides: batch.strides.min(1_000_000), ..batch },
        &mut rng,
        &mut |plant, stride| {
            if let Some(changed) = &mut changed {
                changed.before(plant, stride);
                failed.set(changed.failed());
            }
        },
        &mut |t| {
            if let Some(error) = failed.take() {
                return Err(error);
            }
            drift.saw(t)?;
            rows.push(table.row(t));
            transitions.push(t.clone());
            if t.end != StrideEnd::Crossing || t.time_s >= seconds {
                return Err(LabError::Interrupted { path: "run".into() });
            }
            Ok(())
        },
    );
    match result {
        Ok(_) | Err(LabError::Interrupted { .. }) => {}
        Err(error) => return Err(error.into()),
    }
    if let Some(out) = out {
        files::write_whole(out, (rows.join("\n") + "\n").as_bytes())?;
    }
    let performance = Performance::of(&transitions, 0);
    let walked_s: f64 = transitions.iter().map(|t| t.measures.duration_s).sum();
    let forward_m: f64 = transitions.iter().map(|t| t.measures.forward_m).sum();
    let shown = Walked {
        seconds,
        upright_s: transitions.last().map_or(0.0, |t| t.time_s),
        strides: performance.strides,
        falls: performance.falls,
        stalls: performance.stalls,
        causes: causes(&plant),
        mean_reward: performance.mean_reward,
        mean_psi_roll_deg: performance.mean_psi_roll_deg,
        stride_duration_s: walked_s / performance.strides.max(1) as f64,
        forward_m,
        left_m: transitions.iter().map(|t| t.measures.left_m).sum(),
        speed_m_s: if walked_s > 0.0 { forward_m / walked_s } else { 0.0 },
        drift: drift.shown(),
    };
    if common.json {
        return output::json(&shown);
    }
    let gain = match task.record.walk_s {
        Some(_) => format!("{:.3} m/s", shown.speed_m_s),
        None => format!("reward {:+.4}", shown.mean_reward),
    };
    output::line(format!(
        "upright for {:.1} of {seconds} s: {gain}, {} strides of {:.3} s, {}, {} falls, {} \
         stalls; {:+.2} m forward, {:+.2} m to the left",
        shown.upright_s,
        shown.strides,
        shown.stride_duration_s,
        performance.psi_roll(),
        shown.falls,
        shown.stalls,
        shown.forward_m,
        shown.left_m,
    ));
    show_causes(&shown.causes);
    if let Some(drift) = &shown.drift {
        super::drift::show(drift);
    }
    Ok(())
}

/// Says what a walking run's data and map are worth: held-out residuals, and the flip.
pub fn analyse_map(path: &Path, common: &Common) -> Result<(), Failure> {
    let run = FinishedRun::open(path, &common.sets)?;
    say_differences(path);
    if run.progress.proofs().is_empty() {
        return Err(Failure::request(
            "analyse --map needs a run that proves its policies, as those of `learn walking` do",
        ));
    }
    let found = analyse_run(&run.task, &run.progress, run.provenance.seed)?;
    if common.json {
        return output::json(&found);
    }
    output::line("pitch rate at the next section, held-out strides: residual in deg/s (by the median)");
    for r in &found.pitch_rate_residual_deg_s {
        output::line(format!(
            "  {:.3} ({:.3})  {} strides, the map sees {}, u(k){}",
            r.residual_deg_s,
            r.robust_residual_deg_s,
            r.strides,
            r.state.join(", "),
            if r.last_action { ", u(k-1)" } else { "" }
        ));
    }
    let multiplier = |m: Option<f64>| m.map_or("fell".into(), |m| format!("{m:+.2}"));
    for flip in &found.flips {
        let action: Vec<String> = flip.action.iter().map(|u| format!("{u:.2}")).collect();
        output::line(format!(
            "flip multiplier at [{}]: map {}, robot {}",
            action.join(", "),
            multiplier(flip.map),
            multiplier(flip.robot)
        ));
    }
    Ok(())
}

/// Films the robot while it is pushed, for the replay: as long as the run's other recordings, from when
/// the pushes begin.
fn film(plant: &mut Plant, task: &Task) -> Option<Arc<Mutex<Recording>>> {
    /// Time between frames, as in the run's own recordings.
    const FRAME_PERIOD_S: f64 = 0.02;
    /// The first ten strides are not pushed; the film begins with the last of them.
    const SETTLE_S: f64 = 5.0;
    if task.record.pose_seconds <= 0.0 {
        return None;
    }
    let begin_s = plant.start_up_s() + SETTLE_S;
    let end_s = begin_s + task.record.pose_seconds;
    let (observer, recording) = PoseRecorder::new(plant.robot(), FRAME_PERIOD_S, begin_s, end_s);
    plant.observe(Some(Box::new(observer)));
    Some(recording)
}

/// Pushes the robot, as hard as `of` its mass in kg says, and fits its return map.
pub fn push(
    path: &Path,
    of: &dyn Fn(f64) -> PushConfig,
    (body, nominal): (Option<&str>, bool),
    out: Option<&Path>,
    common: &Common,
) -> Result<(), Failure> {
    let config = of(1.0); // of any mass: what the user typed is looked at before a robot is built
    if config.strides == 0 {
        return Err(Failure::request("--strides must be at least 1"));
    }
    let (task, policy, falls) = task_and_policy(path, nominal, common)?;
    // Pushes of another robot than the run's own are not part of the run.
    let own = common.sets.is_empty() && common.robot.is_none();
    let into_run = (out.is_none() && own).then_some(path);
    let _writing = into_run.map(lock).transpose()?;
    let doing = Purpose::apply(format!("be pushed in {} strides", config.strides), falls);
    let beside = beside_run(&task, Some(path))?;
    let mut plant = plant(&task, common, &doing, beside.as_deref())?;
    if let Some(body) = body {
        plant.push_on(body).map_err(LabError::from)?;
    }
    let config = of(plant.robot().description().mass_kg);
    let film = film(&mut plant, &task);
    let outcome = push_plant(&mut plant, &policy, config, common.seed, &mut |_| Ok(()))?;
    plant.observe(None);
    let film = film.and_then(|f| Arc::into_inner(f)?.into_inner().ok());
    if let Some(dir) = out.or(into_run) {
        files::create_dir(dir)?;
        let stem = if nominal { "push-nominal" } else { "push" };
        files::write_whole(&dir.join(format!("{stem}.csv")), outcome.table().as_bytes())?;
        files::write_json(&dir.join(format!("{stem}.json")), &outcome)?;
        if let Some(film) = film.filter(|f| !f.frames.is_empty()) {
            files::create_dir(&dir.join("poses"))?;
            files::write_json_line(&dir.join(format!("poses/{stem}.json")), &film)?;
        }
        output::note(format!(
            "wrote {stem}.csv and {stem}.json into {0}; `stridemap report {0}` shows them",
            dir.display()
        ));
    }
    if common.json {
        return output::json(&outcome);
    }
    let number = |x: Option<f64>| x.map_or("undefined".into(), |x| format!("{x:.3}"));
    output::line(format!(
        "pushes of up to {:.3} N for {} s: impulse {:.3} N s, velocity change {:.3} m/s\n\
         return map psi_roll(k) -> psi_roll(k+2) under them: slope {} (+- {}), fixed point {} deg, {} falls, \
         {} pairs",
        outcome.force_n,
        outcome.duration_s,
        outcome.impulse_n_s,
        outcome.velocity_change_m_s,
        number(outcome.slope),
        number(outcome.slope_std_error),
        number(outcome.fixed_point_deg),
        outcome.falls,
        outcome.pairs
    ));
    show_causes(&outcome.causes);
    Ok(())
}
