//! `reproduce`: the paper's figures from our own runs.

mod runs;
mod samples;
mod small;
mod stepping;
mod walking;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::Serialize;
use stridemap_record::files;
use stridemap_report::figures::{Shot, TimeLapse, time_lapses};

use crate::args::{Common, FigureName, RobotName};
use crate::commands::learn::median;
use crate::failure::Failure;
use crate::output;
use runs::Runs;

/// What `reproduce --json` prints.
#[derive(Debug, Serialize)]
struct Document {
    directory: PathBuf,
    table: Vec<Row>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    samples: Vec<samples::Row>,
}

/// Draws figures; with `all` the table as well.
pub fn reproduce(figures: &[FigureName], out: Option<&Path>, seeds: u64, common: &Common) -> Result<(), Failure> {
    use FigureName::{Fig7, Fig8, Fig9, Fig10, Fig11, Fig12, Fig13, Fig14, Fig15, Fig16, Fig17, Fig18};
    crate::parallel::seeds(common.seed, seeds)?;
    if common.robot == Some(RobotName::Ros2) {
        return Err(Failure::request(
            "reproduce simulates its robots: leave out --robot ros2, and draw a run on a robot with \
             `stridemap report`",
        ));
    }
    let dir = out.map_or_else(|| PathBuf::from("runs").join("reproduce"), Path::to_path_buf);
    files::check_dir(&dir)?;
    files::create_dir(&dir)?;
    let all = figures.contains(&FigureName::All);
    let wanted = |names: &[FigureName]| -> BTreeSet<FigureName> {
        let names = names.iter().copied();
        names.filter(|n| all || figures.contains(n)).collect()
    };
    let mut rows = Vec::new();
    if !wanted(&[Fig7]).is_empty() {
        output::note("fig7: Gaussian-process regression of a sine");
        stepping::sine(&dir, common.seed)?;
    }
    let learning = wanted(&[Fig8, Fig9]);
    if !learning.is_empty() {
        output::note("fig8, fig9: learning in the map against learning on the full model");
        let (curves, policies) = (learning.contains(&Fig8), learning.contains(&Fig9));
        rows.extend(stepping::learning(&dir, curves, policies, seeds, common)?);
    }
    if !wanted(&[Fig10]).is_empty() {
        output::note("fig10: return map under pushes, nominal gait and learned policy");
        rows.extend(stepping::pushes(&dir, seeds, common)?);
    }
    let samples = if figures.contains(&FigureName::Samples) {
        output::note("samples: walking against the number of samples");
        samples::samples(&dir, seeds, common)?
    } else {
        Vec::new()
    };
    let walking = wanted(&[Fig11, Fig12]);
    let stepping = wanted(&[Fig13, Fig14, Fig15]);
    let small_walking = wanted(&[Fig16, Fig17, Fig18]);
    if !(walking.is_empty() && stepping.is_empty() && small_walking.is_empty()) {
        // From here on Ctrl-C stops after a stride, and the next call goes on from there.
        let runs = Runs::new(&dir, seeds, common);
        if !walking.is_empty() {
            output::note("fig11, fig12: the biped before and after learning to walk");
            rows.extend(walking::figures(&dir, &walking, &runs)?);
        }
        if !stepping.is_empty() {
            output::note("fig13 to fig15: the small humanoid steps");
            rows.extend(small::stepping(&dir, &stepping, &runs)?);
        }
        if !small_walking.is_empty() {
            output::note("fig16 to fig18: the small humanoid before and while learning to walk");
            rows.extend(small::walking(&dir, &small_walking, &runs)?);
        }
    }
    let table = markdown(&rows);
    if all {
        files::write_whole(&dir.join("table.md"), table.as_bytes())?;
        files::write_json(&dir.join("table.json"), &rows)?;
    }
    if common.json {
        return output::json(&Document { directory: dir, table: rows, samples });
    }
    if !rows.is_empty() {
        output::line(table.trim_end());
    }
    samples::show(&samples);
    output::line(format!("figures (SVG, PNG, CSV) are in {}", dir.display()));
    Ok(())
}

/// One row of the table: paper beside ours.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    what: String,
    paper: String,
    ours: String,
    command: String,
}

fn row(what: &str, paper: &str, ours: String, command: &str) -> Row {
    Row { what: what.into(), paper: paper.into(), ours, command: command.into() }
}

/// Writes the strips' figures that are wanted, with camera and scale of all of them.
fn write_strips(
    dir: &Path,
    wanted: &BTreeSet<FigureName>,
    lapses: &[TimeLapse],
    names: &[FigureName],
    shot: Shot,
) -> Result<(), Failure> {
    let drawn = time_lapses(lapses, shot)?;
    for (figure, name) in drawn.iter().zip(names) {
        if wanted.contains(name) {
            figure.write(dir)?;
        }
    }
    Ok(())
}

/// Median and range of one number per seed.
fn spread(values: &[f64], unit: &str) -> String {
    match values {
        [] => "-".into(),
        [only] => format!("{only:.3} {unit} (one seed)"),
        _ => {
            let (low, high) =
                values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v)));
            format!("{:.3} {unit} (median; {low:.3} to {high:.3}, n = {})", median(values), values.len())
        }
    }
}

fn markdown(rows: &[Row]) -> String {
    let mut text = String::from("| what | paper | ours | command |\n|---|---|---|---|\n");
    for r in rows {
        text += &format!("| {} | {} | {} | `stridemap {}` |\n", r.what, r.paper, r.ours, r.command);
    }
    text
}
