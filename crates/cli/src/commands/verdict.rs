//! `verdict` and `compare-runs`: gates for a deployment.

use std::path::Path;
use std::process::ExitCode;

use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};
use stridemap_lab::{
    AtlasSetting, Interval, LabError, Task, VerdictConfig, Walked, difference, disturbed, fall_difference, judged,
    judged_falls, judged_push, judged_tracking, judged_worse, largest_multiplier, mean_of, probed, tracks, walk_once,
    what,
};
use stridemap_learn::SavedPolicy;
use stridemap_record::files::{self, lock, read_json};
use stridemap_record::{Judged, PushAtlas, Ruling, Run, RunVerdict};

use super::apply::task_and_policy;
use super::atlas;
use crate::args::{Common, CompareRunsArgs, VerdictArgs, Walks};
use crate::failure::Failure;
use crate::{output, parallel};

/// A policy on its simulated robot, and what was seen of it.
struct Seen {
    task: Task,
    policy: SavedPolicy,
    walks: Vec<Walked>,
    multiplier: Result<Interval, String>,
    probed_strides: usize,
}

/// Walks a run's policy, and probes it.
fn look(path: &Path, walks: &Walks, common: &Common) -> Result<Seen, Failure> {
    let (task, policy, _) = task_and_policy(path, false, common)?;
    if task.link.is_some() {
        return Err(LabError::NotHere.into());
    }
    let moved = disturbed(&task);
    let told = |at: &usize, walked: &Result<Walked, LabError>| match walked {
        Ok(walked) if walked.fell => format!("walk {at} fell"),
        Ok(_) => format!("walk {at} upright"),
        Err(error) => error.to_string(),
    };
    let all: Vec<usize> = (0..walks.walks).collect();
    let seed = common.seed;
    let walked = parallel::each_of(&all, common.threads, "walks", told, |&at| walk_once(&moved, &policy, seed, at))?;
    let record = probed(&moved, &policy, walks.probe, seed)?;
    let exact = !task.robot.estimated && task.robot.hardware.is_none() && task.robot.sensors.is_none();
    let multiplier = parallel::within(common.threads, || largest_multiplier(&record, exact, seed))?;
    Ok(Seen { task, policy, walks: walked, multiplier, probed_strides: record.strides() })
}

/// The push atlas of a run's policy: the run's own if it was made of the very same, else made now and kept there.
fn push_atlas(path: &Path, seen: &Seen, common: &Common) -> Result<PushAtlas, Failure> {
    let setting = AtlasSetting::default();
    let made_of = atlas::made_of(&seen.task, &seen.policy, &setting, common.seed)?;
    let kept = path.join("push-atlas.json");
    if kept.exists() && read_json::<PushAtlas>(&kept)?.made_of == made_of {
        let kept = Run::read(path)?.atlases.into_iter().find(|atlas| atlas.made_of == made_of);
        if let Some(kept) = kept {
            return Ok(kept);
        }
    }
    let own = is_own(common);
    let _writing = own.then(|| lock(path)).transpose()?;
    atlas::make_into(&seen.task, &seen.policy, &setting, "learned", own.then_some(path), common)
}

/// Whether the robot is the run's own: only limits are other.
fn is_own(common: &Common) -> bool {
    common.sets.iter().all(|set| set.starts_with("verdict.")) && common.robot.is_none()
}

/// Says whether the policy of a run may be deployed.
pub fn verdict(args: &VerdictArgs) -> Result<ExitCode, Failure> {
    let (path, common) = (&args.run, &args.common);
    let seen = look(path, &args.walks, common)?;
    let limits: VerdictConfig = seen.task.verdict.unwrap_or_default();
    let seed = common.seed;
    let mut all = vec![judged_falls(&seen.walks, limits.falls(), seed)];
    if let Some(of) = tracks(&seen.task) {
        all.push(judged_tracking(&seen.walks, (limits.tracking(), &of), seed));
    }
    let because = "posterior of a record with a little noise on the actions";
    let of = (seen.probed_strides, seed);
    all.push(judged(what::MULTIPLIER, seen.multiplier.clone(), (limits.multiplier(), true), because, of));
    if limits.push_m_s() > 0.0 {
        all.push(judged_push(&push_atlas(path, &seen, common)?, limits.push_m_s()));
    }
    let verdict = RunVerdict::of(vec![path.display().to_string()], all);
    if is_own(common) {
        let _writing = lock(path)?;
        files::write_json(&path.join("verdict.json"), &verdict)?;
    }
    tell(&verdict, "verdict", args.junit.as_deref(), args.markdown.as_deref(), common)
}

/// Margins within which a difference does not matter: of a probability, a multiplier, a push in m/s, a speed in m/s.
const MARGINS: [f64; 4] = [0.05, 0.1, 0.02, 0.02];
/// Share of A's tracking error by which B's may be larger.
const TRACKING_MARGIN: f64 = 0.1;

/// Says whether the policy of run B is worse than that of run A.
pub fn compare_runs(args: &CompareRunsArgs) -> Result<ExitCode, Failure> {
    let common = &args.common;
    let [a, b] = [look(&args.a, &args.walks, common)?, look(&args.b, &args.walks, common)?];
    let pairs: Vec<(&Walked, &Walked)> = a.walks.iter().zip(&b.walks).collect();
    let strides = pairs.iter().map(|(a, b)| a.strides + b.strides).sum();
    let of = (strides, common.seed);
    let fell: Vec<(bool, bool)> = pairs.iter().map(|(a, b)| (a.fell, b.fell)).collect();
    let counted = |of: fn(&(bool, bool)) -> bool| fell.iter().filter(|p| of(p)).count();
    let because = format!(
        "A fell in {}, B in {} of {} pairs of walks from the same starts",
        counted(|p| p.0),
        counted(|p| p.1),
        fell.len()
    );
    let mut all = vec![judged_worse(what::FALLS, Ok(fall_difference(&fell)), MARGINS[0], &because, of)];
    let paired = |of: fn(&Walked) -> Option<f64>, sign: f64| {
        let both: Vec<f64> = pairs.iter().filter_map(|(a, b)| Some(sign * (of(b)? - of(a)?))).collect();
        (mean_of(&both), format!("paired over {} walks from the same starts", both.len()))
    };
    let tracking: Vec<f64> = a.walks.iter().filter_map(|w| w.tracking).collect();
    if let Ok(mark) = mean_of(&tracking)
        && tracks(&a.task) == tracks(&b.task)
    {
        let (worse_by, because) = paired(|w| w.tracking, 1.0);
        all.push(judged_worse(what::TRACKING, worse_by, TRACKING_MARGIN * mark.value, &because, of));
    }
    if a.task.record.walk_s.is_some() && b.task.record.walk_s.is_some() {
        let (worse_by, because) = paired(|w| w.speed_m_s, -1.0);
        all.push(judged_worse(what::SPEED, worse_by, MARGINS[3], &because, of));
    }
    let worse_by = a.multiplier.clone().and_then(|a| Ok(difference(a, b.multiplier.clone()?)));
    let of = (a.probed_strides + b.probed_strides, common.seed);
    all.push(judged_worse(what::MULTIPLIER, worse_by, MARGINS[1], "not paired: posteriors of two records", of));
    all.extend(compared_pushes([&args.a, &args.b])?);
    let runs = [&args.a, &args.b].map(|path| path.display().to_string());
    let verdict = RunVerdict::of(runs.to_vec(), all);
    tell(&verdict, "compare-runs", args.junit.as_deref(), args.markdown.as_deref(), common)
}

/// The push atlases that both runs have, cell by cell.
fn compared_pushes(paths: [&std::path::PathBuf; 2]) -> Result<Option<Judged>, Failure> {
    let mut atlases = Vec::new();
    for path in paths {
        atlases.extend(Run::read(path)?.atlases.into_iter().find(|atlas| atlas.policy == "learned"));
    }
    let [a, b] = atlases.as_slice() else { return Ok(None) };
    let place = |c: &stridemap_record::AtlasCell| [c.duration_s, c.phase, c.direction_deg].map(f64::to_bits);
    let both = a
        .cells
        .iter()
        .filter_map(|a| Some(a.survived_m_s - b.cells.iter().find(|b| place(b) == place(a))?.survived_m_s));
    let both: Vec<f64> = both.collect();
    let because = format!("largest push survived, mean over {} cells of both atlases, paired", both.len());
    let of = (a.strides + b.strides, a.seed);
    Ok(Some(judged_worse(what::PUSH, mean_of(&both), MARGINS[2], &because, of)))
}

/// Prints a verdict, writes its files, and says it by the exit code.
fn tell(
    verdict: &RunVerdict,
    command: &str,
    junit: Option<&Path>,
    markdown: Option<&Path>,
    common: &Common,
) -> Result<ExitCode, Failure> {
    if let Some(file) = junit {
        files::write_whole(file, junit_xml(verdict, command)?.as_bytes())?;
    }
    if let Some(file) = markdown {
        files::write_whole(file, verdict.markdown().as_bytes())?;
    }
    if common.json {
        output::json(verdict)?;
    } else {
        output::line(format!("{}: {}", verdict.runs.join(" against "), verdict.ruling.words()));
        for judged in &verdict.judged {
            output::line(format!("  {:<11}  {}", judged.ruling.words(), judged.line()));
        }
    }
    Ok(match verdict.ruling {
        Ruling::Pass => ExitCode::SUCCESS,
        Ruling::Fail => ExitCode::from(1),
        Ruling::CannotTell => ExitCode::from(3),
    })
}

/// A verdict as CI servers read it: a failure is a failure, a doubt is an error.
fn junit_xml(verdict: &RunVerdict, command: &str) -> Result<String, Failure> {
    let mut report = Report::new(format!("stridemap {command}"));
    let mut suite = TestSuite::new(verdict.runs.join(" against "));
    for judged in &verdict.judged {
        let status = match judged.ruling {
            Ruling::Pass => TestCaseStatus::success(),
            Ruling::Fail => TestCaseStatus::non_success(NonSuccessKind::Failure),
            Ruling::CannotTell => TestCaseStatus::non_success(NonSuccessKind::Error),
        };
        let mut case = TestCase::new(judged.name.clone(), status);
        let line = judged.line();
        if judged.ruling != Ruling::Pass {
            case.status.set_message(line.clone());
        }
        case.set_system_out(line);
        suite.add_test_case(case);
    }
    report.add_test_suite(suite);
    report.to_string().map_err(|error| Failure::working(format!("the JUnit report cannot be written: {error}")))
}
