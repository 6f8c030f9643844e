//! Pictures beside a task file: the film of `check`, the gaits of `tune`.

use std::path::{Path, PathBuf};

use stridemap_lab::{CheckReport, GaitVerdict, Try};
use stridemap_record::Recording;
use stridemap_report::figures::{TriedGait, tried_gaits};
use stridemap_report::{film_html, write_aside};

use crate::failure::Failure;
use crate::output;

/// `NAME.WHAT` beside the task file `NAME.toml`.
fn beside(file: &Path, what: &str) -> PathBuf {
    file.with_extension(what)
}

/// The page with the film of a check: where it was asked for, or beside the task's file. That it cannot be written there unasked
/// is a remark, no failure.
pub fn film(
    asked: Option<&Path>,
    file: Option<&Path>,
    name: &str,
    report: &CheckReport,
    recording: &Recording,
) -> Result<Option<PathBuf>, Failure> {
    let Some(path) = asked.map(Path::to_path_buf).or_else(|| file.map(|file| beside(file, "check.html"))) else {
        return Ok(None);
    };
    if recording.frames.is_empty() {
        return Ok(None);
    }
    let looked_at: Vec<(bool, String, String)> =
        report.items.iter().map(|item| (item.ok, item.what.clone(), item.found.clone())).collect();
    let written = film_html(&format!("{name}: the nominal gait"), &looked_at, recording)
        .and_then(|page| write_aside(&path, page.as_bytes()));
    match (written, asked) {
        (Ok(()), _) => Ok(Some(path)),
        (Err(error), Some(_)) => Err(error.into()),
        (Err(error), None) => {
            output::note(format!("no film: {error}; --film FILE writes it elsewhere"));
            Ok(None)
        }
    }
}

/// The picture of every gait that a search tried.
pub fn tried(file: &Path, tries: &[Try], taken: Option<usize>) -> Result<PathBuf, Failure> {
    let drawn: Vec<TriedGait> = tries
        .iter()
        .enumerate()
        .map(|(i, t)| TriedGait {
            number: i + 1,
            verdict: match t.verdict {
                GaitVerdict::Steps => "steps".to_owned(),
                GaitVerdict::Shuffles => "shuffles".to_owned(),
                GaitVerdict::Falls => format!("falls at {:.1} s", t.survived_s),
            },
            pitch_deg: t.setting.pitch_deg,
            sections: t.trace.sections.clone(),
            swings: t.trace.swings.iter().map(|&(time_s, foot, height_m)| (time_s, foot, 1e3 * height_m)).collect(),
            taken: taken == Some(i),
            always: t.from == "ladder",
        })
        .collect();
    let path = beside(file, "tune.svg");
    write_aside(&path, tried_gaits(&drawn)?.svg.as_bytes())?;
    Ok(path)
}
