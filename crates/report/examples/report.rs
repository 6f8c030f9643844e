//! Makes `report.html` of run directories: `report OUT.html RUN [RUN ...]`; figures go beside the first.

use std::path::PathBuf;

use stridemap_record::Run;
use stridemap_report::{Result, write_figures, write_report};

fn main() -> Result<()> {
    let mut paths = std::env::args_os().skip(1).map(PathBuf::from);
    let Some(out) = paths.next() else {
        return Ok(());
    };
    let runs = paths.map(|dir| Ok(Run::read(&dir)?)).collect::<Result<Vec<Run>>>()?;
    if let Some(run) = runs.first() {
        write_figures(run, &out.with_extension("figures"))?;
    }
    write_report(&runs, &out)
}
