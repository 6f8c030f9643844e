//! `report`: the figures and the page of runs.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use stridemap_record::Run;
use stridemap_record::files::lock;
use stridemap_report::figures::runs_compared;
use stridemap_report::{RERUN_STREAM, view_lines, write_figures, write_mcap, write_report};

use crate::failure::Failure;
use crate::output;

fn read(path: &Path) -> Result<Run, Failure> {
    if !path.join("config.toml").exists() {
        return Err(Failure::request(format!("{}: holds no run (there is no config.toml in it)", path.display())));
    }
    Ok(Run::read(path)?)
}

/// Draws the figures and the page of one run into its directory; returns the page's path.
pub fn draw(path: &Path) -> Result<PathBuf, Failure> {
    let events = || std::fs::metadata(path.join("events.ndjson")).map_or(0, |file| file.len());
    loop {
        let seen = events();
        let run = read(path)?;
        write_figures(&run, &path.join("figures"))?;
        let page = path.join("report.html");
        write_report(std::slice::from_ref(&run), &page)?;
        // Who writes the run draws it at the end; one that ended meanwhile may have drawn it before us.
        if events() == seen || lock(path).is_err() {
            return Ok(page);
        }
    }
}

/// Draws several runs on one page, and the figure over all of them as files beside it, under figures/.
fn side_by_side(runs: &[Run], page: &Path) -> Result<(), Failure> {
    let dir = page.parent().unwrap_or(Path::new("."));
    // Without a measured iteration there is nothing to compare yet; the page says so.
    if let Ok(figure) = runs_compared(runs) {
        figure.write(&dir.join("figures"))?;
    }
    Ok(write_report(runs, page)?)
}

/// Draws the page over the runs of several seeds into a directory of its own; returns the page's path.
pub fn draw_seeds(paths: &[PathBuf], dir: &Path) -> Result<PathBuf, Failure> {
    let runs = paths.iter().map(|path| read(path)).collect::<Result<Vec<_>, _>>()?;
    let page = dir.join("report.html");
    stridemap_record::files::create_dir(dir)?;
    side_by_side(&runs, &page)?;
    Ok(page)
}

/// Draws runs: one into its own directory, several side by side.
pub fn report(paths: &[PathBuf], out: Option<&Path>) -> Result<(), Failure> {
    let page = match (paths, out) {
        ([path], None) => draw(path)?,
        _ => {
            let runs = paths.iter().map(|path| read(path)).collect::<Result<Vec<_>, _>>()?;
            let page = out.map_or_else(|| paths[0].join("comparison.html"), Path::to_path_buf);
            side_by_side(&runs, &page)?;
            page
        }
    };
    output::line(format!("{}", page.display()));
    Ok(())
}

/// Writes a run as MCAP and opens it in Rerun where that is installed.
pub fn view(path: &Path, out: Option<&Path>, no_open: bool) -> Result<(), Failure> {
    let run = read(path)?;
    let file = out.map_or_else(|| path.join("view.mcap"), Path::to_path_buf);
    write_mcap(&run, &file)?;
    output::line(format!("{}", file.display()));
    if no_open {
        return Ok(());
    }
    match stream(&run) {
        Ok(()) => output::note("streamed it into Rerun"),
        Err(why) => output::note(format!(
            "not streamed into Rerun ({why}); open the file in Foxglove, or install Rerun's Python package (rerun-sdk)"
        )),
    }
    Ok(())
}

/// Streams a run into Rerun by a Python that has its package: that way it has time lines of steps and of
/// seconds, which a viewer does not take from an MCAP file of JSON messages.
fn stream(run: &Run) -> Result<(), String> {
    use std::process::{Command, Stdio};
    let python = std::env::var("STRIDEMAP_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let has = Command::new(&python).args(["-c", "import rerun"]).stderr(Stdio::null()).status();
    if !has.is_ok_and(|status| status.success()) {
        return Err(format!("{python} has no package `rerun`"));
    }
    let saved = std::env::var_os("STRIDEMAP_RERUN_FILE");
    let mut child = Command::new(&python)
        .args(["-c", RERUN_STREAM])
        .args(saved)
        .stdin(Stdio::piped())
        .spawn()
        .map_err(|e| format!("{python}: {e}"))?;
    let written = match child.stdin.take() {
        Some(mut pipe) => pipe.write_all(view_lines(run).as_bytes()),
        None => Ok(()),
    };
    let ended = child.wait().map_err(|e| e.to_string())?;
    written.map_err(|e| e.to_string())?;
    if ended.success() { Ok(()) } else { Err("its viewer could not be reached".to_owned()) }
}
