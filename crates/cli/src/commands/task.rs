//! `check` and `init`: before anything is learned.

use std::path::Path;

use serde::Serialize;
use stridemap_lab::{CheckReport, builtin, check_on_film as look};

use super::in_network;
use crate::args::Common;
use crate::failure::Failure;
use crate::output;
use stridemap_record::{Recording, files};

/// Looks at a task and says whether it can work.
pub fn check(name: &str, film: Option<&Path>, common: &Common) -> Result<(), Failure> {
    // What a task leaves to its robot is asked where the gait steps.
    let loaded = builtin::load(name, &common.sets)?.on(common.robot.map(Into::into), common.seed)?;
    let (file, mut task) = (loaded.file, loaded.task);
    in_network(&mut task, common)?;
    let mut recording = Recording::default();
    let report = look(&task, common.seed, Some(&mut recording))?;
    let film = super::picture::film(film, file.as_deref(), name, &report, &recording)?;
    if common.json {
        output::json(&Checked { report: &report, film: film.as_ref().map(|path| path.display().to_string()) })?;
    } else {
        for joint in &report.joints {
            let sign = if joint.inverted { "-" } else { " " };
            output::line(format!(
                "  {:>5} {:<11} {sign}{:<20} {:>7.1} to {:>6.1} deg, rest {:>6.1}  {:?}",
                format!("{:?}", joint.side).to_lowercase(),
                joint.joint.name(),
                joint.model_joint,
                joint.range_deg[0],
                joint.range_deg[1],
                joint.rest_deg,
                joint.actuator
            ));
        }
        for item in &report.items {
            let mark = if item.ok { "ok  " } else { "FAIL" };
            output::line(format!("{mark}  {:<13} {}", item.what, item.found));
        }
        for g in &report.gains {
            output::line(format!("      d next {} / d {} = {:+.3} +- {:.3}", g.state, g.action, g.gain, g.std_error));
        }
        if let Some(film) = film {
            output::line(format!("a film of the nominal gait: {}", film.display()));
        }
    }
    if let Some(refused) = report.refused {
        return Err(Failure::request(refused));
    }
    if report.ok {
        if !common.json {
            output::line(format!("{name} can work; next: stridemap learn {name}"));
        }
        Ok(())
    } else {
        Err(Failure::working(format!("{name} cannot work yet: see what FAILs above")))
    }
}

/// What `check --json` prints.
#[derive(Serialize)]
struct Checked<'a> {
    #[serde(flatten)]
    report: &'a CheckReport,
    film: Option<String>,
}

/// A task file to start from.
const TEMPLATE: &str = include_str!("../../templates/my-robot.toml");

/// Writes a commented task file.
pub fn init(file: Option<&Path>) -> Result<(), Failure> {
    let path = file.unwrap_or(Path::new("my-robot.toml"));
    if path.exists() {
        return Err(Failure::request(format!("{} exists; choose another name or remove it", path.display())));
    }
    files::write_whole(path, TEMPLATE.as_bytes())?;
    output::line(format!("wrote {0}\n  edit it, then: stridemap check {0}, and stridemap learn {0}", path.display()));
    Ok(())
}
