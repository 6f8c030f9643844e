//! `report.html` and `figures/` of one or several runs.

use std::path::Path;

use crate::error::{ReportError, Result};
use crate::figure::Figure;
use crate::figures::{
    Fig10, LearningCurves, MapFigure, PolicyFigure, ReturnMap, RunCurve, StateOverStrides,
    UndisturbedReturnMaps, fig10, learning_curves, map_slices, map_surface, policy,
    predicted_actual, runs_compared, standardized_residuals, state_over_strides,
    undisturbed_return_maps,
};
use crate::run::{Run, StrideEnd, StrideRow};

/// A part of the report of one run: a question, its figures, and what could not be drawn.
#[derive(Clone, Debug, Default)]
pub struct Section {
    /// Short name, for links inside the page.
    pub id: &'static str,
    /// The question.
    pub title: &'static str,
    /// The figures that answer it.
    pub figures: Vec<Figure>,
    /// What is missing, in words.
    pub notes: Vec<String>,
}

impl Section {
    fn new(id: &'static str, title: &'static str) -> Section {
        Section {
            id,
            title,
            ..Section::default()
        }
    }

    /// Takes a figure, or says why there is none.
    fn draw(&mut self, what: &str, figure: Result<Figure>) {
        match figure {
            Ok(figure) => self.figures.push(figure),
            Err(ReportError::Empty { what: why, .. }) => {
                self.notes.push(format!("{what}: not drawn, {why}."))
            }
            Err(error) => self.notes.push(format!("{what}: not drawn. {error}.")),
        }
    }
}

fn recorded(run: &Run, what: &str) -> Vec<StrideRow> {
    run.record
        .iter()
        .filter(|r| r.what == what)
        .cloned()
        .collect()
}

/// Draws everything that a run directory has data for.
#[must_use]
pub fn sections(run: &Run) -> Vec<Section> {
    vec![
        learned_at_all(run),
        what_it_learned(run),
        trust(run),
        stability(run),
    ]
}

fn learned_at_all(run: &Run) -> Section {
    let mut section = Section::new("learn", "Did it learn?");
    let summary = run.summary.as_ref();
    let best = summary.and_then(|s| {
        s.iterations
            .iter()
            .filter_map(|i| i.mean_reward)
            .max_by(f64::total_cmp)
    });
    let level = |m: Option<crate::run::Measured>| m.and_then(|m| m.mean_reward);
    section.draw(
        "Learning curve",
        learning_curves(&LearningCurves {
            trials: run.learning.clone(),
            strides: run.transitions.clone(),
            nominal: level(summary.and_then(|s| s.nominal)),
            final_policy: level(summary.and_then(|s| s.final_policy)),
            best,
        }),
    );
    if let Some(name) = run.columns.state.first() {
        section.draw(
            "State over strides",
            state_over_strides(&StateOverStrides {
                name: name.clone(),
                component: 0,
                target: run.target_deg().filter(|_| name.starts_with("psi_roll")),
                strides: run.transitions.clone(),
                nominal: recorded(run, "nominal"),
                final_policy: recorded(run, "final"),
            }),
        );
    }
    section
}

fn what_it_learned(run: &Run) -> Section {
    let mut section = Section::new("map", "What did it learn?");
    let training = |until: u32| -> Vec<StrideRow> {
        let datum = |s: &&StrideRow| {
            s.role == "training" && s.iteration <= until && s.end != StrideEnd::Aborted
        };
        run.transitions.iter().filter(datum).cloned().collect()
    };
    match run.policies.split_last() {
        None => section.notes.push("The run has no policy yet.".to_owned()),
        Some(((iteration, grid), earlier)) => section.draw(
            "Policy",
            policy(&PolicyFigure {
                iteration: *iteration,
                columns: run.columns.clone(),
                grid: grid.clone(),
                earlier: earlier.to_vec(),
                strides: training(u32::MAX),
            }),
        ),
    }
    match run.grids.last() {
        None => section.notes.push("The run has no map yet.".to_owned()),
        Some((iteration, grid)) => {
            let data = MapFigure {
                iteration: *iteration,
                columns: run.columns.clone(),
                grid: grid.clone(),
                strides: training(*iteration),
            };
            section.draw("Map", map_surface(&data));
            section.draw("Slices of the map", map_slices(&data));
        }
    }
    section
}

fn trust(run: &Run) -> Section {
    let mut section = Section::new("trust", "Can it be trusted?");
    match run.maps.last() {
        None => section
            .notes
            .push("The run has no map yet, so there is nothing to check.".to_owned()),
        Some(map) => {
            section.draw("Predicted against actual", predicted_actual(map));
            section.draw("Standardized residuals", standardized_residuals(map));
        }
    }
    section
}

fn stability(run: &Run) -> Section {
    let mut section = Section::new("stable", "Is it stable?");
    let stretches = |what: &str| -> Vec<Vec<f64>> {
        let mut out: Vec<Vec<f64>> = Vec::new();
        let mut last: Option<(u64, u64)> = None;
        for s in run
            .record
            .iter()
            .filter(|s| s.what == what && s.end == StrideEnd::Crossing)
        {
            let Some(x) = s.next_state.first() else {
                continue;
            };
            let follows = last.is_some_and(|(e, k)| e == s.episode && s.k == k + 1);
            match out.last_mut() {
                Some(stretch) if follows => stretch.push(*x),
                _ => out.push(vec![*x]),
            }
            last = Some((s.episode, s.k));
        }
        out
    };
    if let Some(name) = run.columns.state.first() {
        let runs: Vec<(String, Vec<Vec<f64>>)> =
            [("nominal", "nominal gait"), ("final", "final policy")]
                .iter()
                .map(|(what, name)| ((*name).to_owned(), stretches(what)))
                .filter(|r| !r.1.is_empty())
                .collect();
        let target = run.target_deg().filter(|_| name.starts_with("psi_roll"));
        section.draw(
            "Return maps without pushes",
            undisturbed_return_maps(&UndisturbedReturnMaps {
                name: name.clone(),
                runs,
                target,
            }),
        );
    }
    let maps: Vec<ReturnMap> = [
        ("nominal gait", &run.push_nominal),
        ("learned policy", &run.push),
    ]
    .into_iter()
    .filter_map(|(name, push)| {
        let (pairs, summary) = push.as_ref()?;
        Some(ReturnMap {
            name: name.to_owned(),
            pairs: pairs.clone(),
            slope: summary.slope,
            fixed_point_deg: summary.fixed_point_deg,
            falls: summary.falls,
        })
    })
    .collect();
    if maps.is_empty() {
        section.notes.push("The run was not pushed; `stridemap push` on this directory adds the return map under pushes.".to_owned());
    } else {
        let setting = run
            .push
            .as_ref()
            .or(run.push_nominal.as_ref())
            .map(|p| &p.1);
        section.draw(
            "Return map under pushes",
            fig10(&Fig10 {
                maps,
                target_deg: run.target_deg(),
                force_n: setting.and_then(|s| s.force_n),
                duration_s: setting.and_then(|s| s.duration_s),
            }),
        );
    }
    section
}

/// The figure that puts several runs on the same axes.
///
/// # Errors
///
/// [`ReportError::Empty`] if no run has a measured iteration.
pub fn comparison(runs: &[Run]) -> Result<Figure> {
    let curves: Vec<RunCurve> = runs
        .iter()
        .map(|run| {
            let summary = run.summary.clone().unwrap_or_default();
            RunCurve {
                name: run.name.clone(),
                nominal: summary.nominal.and_then(|n| n.mean_reward),
                iterations: summary
                    .iterations
                    .iter()
                    .filter_map(|i| Some((i.strides_so_far as f64, i.mean_reward?)))
                    .collect(),
                falls: run.falls().0 as u64,
            }
        })
        .collect();
    runs_compared(&curves)
}

/// Writes the figures of a run as SVG, PNG and CSV, and returns their stems.
///
/// # Errors
///
/// [`ReportError`] if a file cannot be written.
pub fn write_figures(run: &Run, dir: &Path) -> Result<Vec<String>> {
    let mut stems = Vec::new();
    for figure in sections(run).iter().flat_map(|s| &s.figures) {
        figure.write(dir)?;
        stems.push(figure.stem.clone());
    }
    Ok(stems)
}
