//! Figs. 11 and 12: the biped before and after learning to walk.

use std::collections::BTreeSet;
use std::path::Path;

use stridemap_report::figures::{Shot, Strip, TimeLapse, View};

use super::runs::{Runs, RunsOfTask};
use super::{Row, row, spread, write_strips};
use crate::args::FigureName;
use crate::failure::Failure;

/// Twelve seconds: from the start through the first strides to the policy's own speed.
const SHOT: Shot = Shot { view: View::Side, interval_s: 2.0, moments: 7 };

/// Draws them with one camera, and returns the rows of the table.
pub fn figures(dir: &Path, wanted: &BTreeSet<FigureName>, runs: &Runs<'_>) -> Result<Vec<Row>, Failure> {
    let tasks = ["walking-paper", "walking-single", "walking"];
    let [paper, single, walking]: [RunsOfTask; 3] =
        runs.of(&tasks)?.try_into().map_err(|_| Failure::working("a run for each task"))?;
    let before = TimeLapse {
        stem: "fig11".into(),
        title: "Before learning to walk".into(),
        lead: "Fig. 11 of the paper: initially the simulated robot explores around the starting position.".into(),
        strips: vec![
            Strip::of_run(
                &paper.first,
                "exploration",
                "Exploring (walking-paper)",
                "actions drawn at random about zero, the first strides of those from which it learns",
            )?,
            Strip::of_run(&walking.first, "nominal", "Nominal gait (walking)", "before anything is learned")?,
        ],
    };
    let after = TimeLapse {
        stem: "fig12".into(),
        title: "After learning to walk".into(),
        lead: "Fig. 12 of the paper: improved walking, there at 0.14 m/s after one iteration. Speeds over up to 60 s \
               from stepping on the spot; camera and scale of Fig. 11."
            .into(),
        strips: vec![
            Strip::of_run(
                &paper.first,
                "iteration-1",
                "After one iteration, the paper's settings (walking-paper)",
                "Tables 1 and 2 literally, learned from 100 strides",
            )?,
            Strip::of_run(
                &single.first,
                "final",
                "Final policy, one modulation (walking-single)",
                "A_walk as in the paper, our best, at most 300 strides",
            )?,
            Strip::of_run(&walking.first, "final", "Final policy, six modulations (walking)", "at most 300 strides")?,
        ],
    };
    let names = [FigureName::Fig11, FigureName::Fig12];
    write_strips(dir, wanted, &[before, after], &names, SHOT)?;
    let mut rows = Vec::new();
    if wanted.contains(&FigureName::Fig12) {
        let of = |what: &str, runs_of: &RunsOfTask, task: &str, iteration: Option<usize>| {
            let speeds = runs_of.summaries.iter().filter_map(|s| match iteration {
                Some(i) => s.iterations.get(i)?.speed_m_s,
                None => s.final_policy?.speed_m_s,
            });
            row(
                &format!("Fig. 12: walking speed, {what}"),
                "0.14 m/s",
                spread(&speeds.collect::<Vec<_>>(), "m/s"),
                &runs.command(task),
            )
        };
        rows.push(of("Tables 1 and 2 literally, one iteration", &paper, tasks[0], Some(0)));
        rows.push(of("A_walk alone", &single, tasks[1], None));
        rows.push(of("six modulations", &walking, tasks[2], None));
    }
    Ok(rows)
}
