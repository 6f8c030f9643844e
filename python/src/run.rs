//! Runs: what a run directory holds.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use pyo3::prelude::*;
use stridemap_lab::fit_map;
use stridemap_lab::run::FinishedRun;
use stridemap_map::LearnedMap;
use stridemap_record::{Run as Record, StridePhase, Transition, files};
use stridemap_report::{sections, write_figures, write_report};

use crate::error::{Fault, of_lab, request};
use crate::map::Map;
use crate::policy::{Policy, python};
use crate::table::Table;
use crate::task::Task;

/// A run directory.
///
/// >>> run = Run("runs/stepping-1")
/// >>> run.transitions["reward"].mean()
/// >>> run.policy(state)
#[pyclass(module = "stridemap", frozen)]
pub struct Run {
    pub path: PathBuf,
}

/// A figure of a run: SVG, PNG, and the data drawn as CSV. Notebooks show it.
#[pyclass(module = "stridemap", frozen)]
pub struct Figure(stridemap_report::Figure);

impl Run {
    /// The run as it goes on.
    pub fn finished(&self) -> PyResult<FinishedRun> {
        FinishedRun::open(&self.path, &[]).map_err(of_lab)
    }

    fn record(&self, py: Python<'_>) -> PyResult<Record> {
        py.detach(|| Record::read(&self.path)).map_err(of_lab)
    }

    fn table(&self, name: &str) -> PyResult<Table> {
        Table::read(&self.path.join(name))
    }

    fn figures_of(&self, py: Python<'_>) -> PyResult<Vec<stridemap_report::Figure>> {
        let record = self.record(py)?;
        Ok(py.detach(|| sections(&record).into_iter().flat_map(|section| section.figures).collect()))
    }
}

/// Draws figures and page of a run into its directory.
pub fn draw(path: &Path) -> Result<PathBuf, Fault> {
    let record = Record::read(path)?;
    let page = path.join("report.html");
    write_figures(&record, &path.join("figures")).map_err(Fault::Report)?;
    write_report(std::slice::from_ref(&record), &page).map_err(Fault::Report)?;
    Ok(page)
}

/// The map in which the policy of an iteration was improved, fitted again.
fn map_of(run: &FinishedRun, iteration: usize) -> Result<LearnedMap, stridemap_lab::LabError> {
    let before =
        |t: &&Transition| t.iteration < iteration || t.iteration == iteration && t.phase != StridePhase::Evaluate;
    let strides: Vec<Transition> = run.progress.transitions.iter().filter(before).cloned().collect();
    fit_map(&run.task, &strides, &run.progress.in_place(), run.provenance.seed, iteration)
}

#[pymethods]
impl Run {
    #[new]
    fn new(path: PathBuf) -> PyResult<Self> {
        let run = Self { path };
        run.finished()?;
        Ok(run)
    }

    /// Where it lies.
    #[getter]
    fn path(&self) -> PathBuf {
        self.path.clone()
    }

    /// Its task.
    #[getter]
    fn task(&self) -> PyResult<Task> {
        Ok(Task::of_run(self.path.join("config.toml"), self.finished()?.task))
    }

    /// Its seed.
    #[getter]
    fn seed(&self) -> PyResult<u64> {
        Ok(self.finished()?.provenance.seed)
    }

    /// Whether it reached its end.
    #[getter]
    fn is_complete(&self) -> PyResult<bool> {
        Ok(self.finished()?.is_complete())
    }

    /// What it achieved: `summary.json`.
    #[getter]
    fn summary<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let value: serde_json::Value = files::read_json(&self.path.join("summary.json")).map_err(of_lab)?;
        python(py, &value)
    }

    /// Where its numbers came from: `provenance.json`.
    #[getter]
    fn provenance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        python(py, &self.finished()?.provenance)
    }

    /// Training and evaluation strides, a row each.
    #[getter]
    fn transitions(&self) -> PyResult<Table> {
        self.table("transitions.csv")
    }

    /// Strides made only to report, a row each; `what` names the measured policy.
    #[getter]
    fn record_strides(&self) -> PyResult<Table> {
        self.table("record.csv")
    }

    /// The learning curve: trials in the map, and the robot's own after each iteration.
    #[getter]
    fn learning(&self) -> PyResult<Table> {
        self.table("learning.csv")
    }

    /// The policy: the final one; before there is one the best so far.
    #[getter]
    fn policy(&self) -> PyResult<Policy> {
        self.finished()?.policy().map(Policy::of).map_err(of_lab)
    }

    /// The policy of each iteration.
    #[getter]
    fn policies(&self) -> PyResult<Vec<Policy>> {
        Ok(self.finished()?.progress.policies.into_iter().map(Policy::of).collect())
    }

    /// The policy of an iteration (by default the last) along each component of the state, as a table: mean and
    /// standard deviation of the action.
    #[pyo3(signature = (iteration=None))]
    fn policy_table(&self, iteration: Option<usize>) -> PyResult<Table> {
        let last = self.finished()?.progress.policies.len();
        self.table(&format!("figures/data/policy-{}.csv", iteration.unwrap_or(last)))
    }

    /// The map in which the last policy was improved.
    #[getter]
    fn map(&self, py: Python<'_>) -> PyResult<Map> {
        self.map_of_iteration(py, None)
    }

    /// The map in which the policy of an iteration was improved: fitted again, with the same numbers.
    #[pyo3(signature = (iteration=None))]
    fn map_of_iteration(&self, py: Python<'_>, iteration: Option<usize>) -> PyResult<Map> {
        let run = self.finished()?;
        let last = run.progress.iterations.len();
        let iteration = iteration.unwrap_or(last);
        if iteration == 0 || iteration > last {
            return Err(request(format!("{}: iteration {iteration} of {last} has no map", self.path.display())));
        }
        let map = py.detach(|| map_of(&run, iteration)).map_err(of_lab)?;
        Ok(Map::of(map, Arc::new(run.task)))
    }

    /// Everything that can be drawn of it.
    #[getter]
    fn figures(&self, py: Python<'_>) -> PyResult<Vec<Figure>> {
        Ok(self.figures_of(py)?.into_iter().map(Figure).collect())
    }

    /// Writes `report.html` and the figures into the run's directory.
    fn report(&self, py: Python<'_>) -> PyResult<PathBuf> {
        Ok(py.detach(|| draw(&self.path))?)
    }

    fn _repr_html_(&self, py: Python<'_>) -> PyResult<String> {
        let mut page = format!("<h3>{}</h3>", self.path.display());
        for figure in self.figures_of(py)? {
            page += &format!("<h4>{}</h4>\n{}\n", figure.title, figure.svg);
        }
        Ok(page)
    }

    fn __repr__(&self) -> String {
        format!("Run({:?})", self.path).replace('"', "'")
    }
}

#[pymethods]
impl Figure {
    /// File name without extension.
    #[getter]
    fn stem(&self) -> &str {
        &self.0.stem
    }

    /// One line above the picture.
    #[getter]
    fn title(&self) -> &str {
        &self.0.title
    }

    /// What is drawn, units, n and spread.
    #[getter]
    fn caption(&self) -> &str {
        &self.0.caption
    }

    /// The picture with its caption.
    #[getter]
    fn svg(&self) -> &str {
        &self.0.svg
    }

    /// The data drawn.
    #[getter]
    fn csv(&self) -> &str {
        &self.0.csv
    }

    /// The picture as PNG.
    fn png(&self, py: Python<'_>) -> PyResult<Vec<u8>> {
        Ok(py.detach(|| self.0.png()).map_err(Fault::Report)?)
    }

    /// Writes SVG, PNG and CSV into a directory.
    fn save(&self, py: Python<'_>, dir: PathBuf) -> PyResult<()> {
        Ok(py.detach(|| self.0.write(&dir)).map_err(Fault::Report)?)
    }

    fn _repr_svg_(&self) -> &str {
        &self.0.svg
    }

    fn __repr__(&self) -> String {
        format!("<stridemap.Figure {}: {}>", self.0.stem, self.0.title)
    }
}
