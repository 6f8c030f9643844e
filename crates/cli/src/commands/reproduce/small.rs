//! Figs. 13 to 18: the small humanoid steps and walks.

use std::collections::BTreeSet;
use std::path::Path;

use stridemap_record::{Recording, Run, Summary};
use stridemap_report::ReportError;
use stridemap_report::figures::{Shot, Strip, TimeLapse, View, fig13, fig14};

use super::runs::{Runs, RunsOfTask};
use super::{Row, row, spread, write_strips};
use crate::args::FigureName;
use crate::failure::Failure;

/// Two steps of the small humanoid.
const STEPS: Shot = Shot { view: View::Front, interval_s: 0.16, moments: 8 };
/// Half a minute, about as long as its walking is measured.
const WALK: Shot = Shot { view: View::Side, interval_s: 4.0, moments: 8 };
/// Film that is left out before the strip of steps begins, so that the start has died away.
const SETTLED_S: f64 = 6.0;

fn one(runs: Vec<RunsOfTask>) -> Result<RunsOfTask, Failure> {
    let mut runs = runs.into_iter();
    runs.next().ok_or_else(|| Failure::working("a run for the task"))
}

/// Draws Figs. 13 to 15, and returns the rows of the table.
pub fn stepping(dir: &Path, wanted: &BTreeSet<FigureName>, runs: &Runs<'_>) -> Result<Vec<Row>, Failure> {
    let RunsOfTask { first, summaries } = one(runs.of(&["small-stepping"])?)?;
    let mut rows = Vec::new();
    if wanted.contains(&FigureName::Fig13) {
        fig13(&first)?.write(dir)?;
    }
    if wanted.contains(&FigureName::Fig14) {
        fig14(&first)?.write(dir)?;
        let command = runs.command("small-stepping");
        let mean = |of: &dyn Fn(&Summary) -> Option<f64>| {
            let values: Vec<f64> = summaries.iter().filter_map(of).map(f64::abs).collect();
            spread(&values, "deg")
        };
        rows.push(row(
            "Fig. 14: mean of psi_roll over 30 steps, magnitude, target 0 deg, after 20 strides",
            "0.12 deg",
            mean(&|s| s.iterations.first()?.mean_psi_roll_deg),
            &command,
        ));
        rows.push(row(
            "Fig. 14: the same, final policy (72 strides)",
            "-",
            mean(&|s| s.final_policy?.performance.mean_psi_roll_deg),
            &command,
        ));
        rows.push(row(
            "Fig. 14: the same, final policy, true instead of estimated",
            "-",
            mean(&|s| s.final_policy?.performance.true_mean_psi_roll_deg),
            &command,
        ));
    }
    if wanted.contains(&FigureName::Fig15) {
        let lapse = TimeLapse {
            stem: "fig15".into(),
            title: "Acquired stepping of the small humanoid".into(),
            lead: "Fig. 15 of the paper: stepping of the small humanoid after one iteration.".into(),
            strips: vec![Strip {
                name: "After one iteration (small-stepping)".into(),
                speed_m_s: None,
                note: "two steps, from a section on".into(),
                recording: settled(&first, "iteration-1")?,
            }],
        };
        write_strips(dir, wanted, &[lapse], &[FigureName::Fig15], STEPS)?;
    }
    Ok(rows)
}

fn missing(run: &Run, what: &str) -> Failure {
    ReportError::Empty { figure: run.dir.display().to_string(), what: what.into() }.into()
}

/// A film from the first section after the start has died away.
fn settled(run: &Run, what: &str) -> Result<Recording, Failure> {
    let film = run.recordings.iter().find(|r| r.0 == what);
    let (_, film) = film.ok_or_else(|| missing(run, "no film of the first iteration's policy"))?;
    let start_s = film.frames.first().map_or(0.0, |f| f.time_s);
    let from = film.frames.iter().position(|f| f.crossing && f.time_s >= start_s + SETTLED_S);
    let from = from.ok_or_else(|| missing(run, "no section in the film of the policy"))?;
    Ok(Recording { frames: film.frames[from..].to_vec(), ..film.clone() })
}

/// Draws Figs. 16 to 18 with one camera, and returns the rows of the table.
pub fn walking(dir: &Path, wanted: &BTreeSet<FigureName>, runs: &Runs<'_>) -> Result<Vec<Row>, Failure> {
    let RunsOfTask { first, summaries } = one(runs.of(&["small-walking"])?)?;
    let strides = |iterations: usize| -> usize {
        let summary = first.summary.iter().flat_map(|s| &s.iterations);
        summary.take(iterations).map(|i| i.strides).sum()
    };
    let policy = |n: usize| -> Result<Strip, Failure> {
        Ok(Strip::of_run(
            &first,
            &format!("iteration-{n}"),
            &format!("After iteration {n} (small-walking)"),
            &format!("learned from {} strides", strides(n)),
        )?)
    };
    let lapses = [
        TimeLapse {
            stem: "fig16".into(),
            title: "The small humanoid before learning to walk".into(),
            lead: "Fig. 16 of the paper: initially the humanoid robot explores around the starting position.".into(),
            strips: vec![
                Strip::of_run(&first, "nominal", "Nominal gait (small-walking)", "before anything is learned")?,
                Strip::of_run(
                    &first,
                    "exploration",
                    "Exploring (small-walking)",
                    "the first strides of those from which it learns",
                )?,
            ],
        },
        TimeLapse {
            stem: "fig17".into(),
            title: "The small humanoid after the first iteration".into(),
            lead: "Fig. 17 of the paper: improved walking after the first iteration, there at 0.027 m/s. Camera and scale \
                   of Fig. 16."
                .into(),
            strips: vec![policy(1)?],
        },
        TimeLapse {
            stem: "fig18".into(),
            title: "The small humanoid after the second iteration".into(),
            lead: "Fig. 18 of the paper: improved walking after the second iteration, there at 0.045 m/s. Camera and scale \
                   of Fig. 16."
                .into(),
            strips: vec![policy(2)?],
        },
    ];
    let names = [FigureName::Fig16, FigureName::Fig17, FigureName::Fig18];
    write_strips(dir, wanted, &lapses, &names, WALK)?;
    let speed = |n: usize| {
        let speeds = summaries.iter().filter_map(|s| s.iterations.get(n - 1)?.speed_m_s);
        spread(&speeds.collect::<Vec<_>>(), "m/s")
    };
    let command = runs.command("small-walking");
    let mut rows = Vec::new();
    if wanted.contains(&FigureName::Fig17) {
        rows.push(row(
            "Fig. 17: speed of the small humanoid after the first iteration",
            "0.027 m/s",
            speed(1),
            &command,
        ));
    }
    if wanted.contains(&FigureName::Fig18) {
        rows.push(row("Fig. 18: speed after the second iteration", "0.045 m/s", speed(2), &command));
    }
    Ok(rows)
}
