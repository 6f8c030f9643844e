//! `replay`: one recorded episode of a run, run again alone.

use std::path::{Path, PathBuf};

use serde::Serialize;
use stridemap_lab::run::FinishedRun;
use stridemap_lab::{Episode, episodes, replay as replay_episode};
use stridemap_record::{
    Columns,
    files::{self, lock},
};

use crate::failure::Failure;
use crate::output;

#[derive(Serialize)]
struct Replayed<'a> {
    run: String,
    #[serde(flatten)]
    episode: &'a Episode,
    rows: PathBuf,
    poses: Option<PathBuf>,
}

fn line(e: &Episode) -> String {
    let what = e.what.as_ref().map_or_else(String::new, |what| format!(" of {what}"));
    let why = e.fall.map_or_else(|| e.end.name().to_owned(), |fall| format!("{}: {fall}", e.end.name()));
    format!("{:>4}  iteration {}, {}{what}: {} strides, {why}", e.episode, e.iteration, e.phase.name(), e.strides)
}

/// Lists the episodes of a run, or runs one of them again.
pub fn replay(path: &Path, number: Option<usize>, out: Option<&Path>, json: bool) -> Result<(), Failure> {
    let run = FinishedRun::open(path, &[])?;
    let all = episodes(&run)?;
    let Some(number) = number else {
        if json {
            return output::json(&all);
        }
        all.iter().for_each(|e| output::line(line(e)));
        return Ok(());
    };
    let Some(episode) = all.get(number.wrapping_sub(1)) else {
        return Err(Failure::request(format!(
            "{}: holds episodes 1 to {}, not {number}; `stridemap replay {0}` lists them",
            path.display(),
            all.len()
        )));
    };
    let _writing = out.is_none().then(|| lock(path)).transpose()?;
    let again = replay_episode(&run, episode)?;
    let dir = out.unwrap_or(path);
    files::create_dir(&dir.join("poses"))?;
    let table = Columns::new(&run.task.process_spec()?);
    let mut text = table.header() + "\n";
    again.transitions.iter().for_each(|t| text.extend([table.row(t).as_str(), "\n"]));
    let rows = dir.join(format!("episode-{number}.csv"));
    files::write_whole(&rows, text.as_bytes())?;
    let poses = dir.join(format!("poses/episode-{number}.json"));
    let film = again.recording.filter(|film| !film.frames.is_empty());
    if let Some(film) = &film {
        files::write_json_line(&poses, film)?;
    }
    let shown = Replayed { run: path.display().to_string(), episode, rows, poses: film.map(|_| poses) };
    output::note(format!(
        "wrote {}; its motion is in poses/episode-{number}.json, for `stridemap view` and `stridemap report`",
        shown.rows.display()
    ));
    if json {
        return output::json(&shown);
    }
    output::line(line(episode));
    output::line("the same rows, to the byte");
    Ok(())
}
