//! `report.html` and `figures/` of one or several runs.

use std::path::Path;

use crate::error::{ReportError, Result};
use crate::figure::Figure;
use crate::figures::{
    ActionFigure, ActionIteration, Fig10, LearningCurves, LineFigure, MapFigure, PolicyFigure, ReturnMap, ReturnPair,
    RunCurve, StateOverStrides, Undisturbed, UndisturbedReturnMaps, actions, fig10, learning_curves, map_lines,
    map_slices, map_surface, policy, predicted_actual, pushed_one_stride, runs_compared, standardized_residuals,
    state_over_strides, undisturbed_return_maps,
};
use stridemap_process::StrideEnd;
use stridemap_record::{Measured, PushOutcome, PushPair, Run, Transition, World};

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
        Section { id, title, ..Section::default() }
    }

    /// Takes a figure, or says why there is none.
    fn draw(&mut self, what: &str, figure: Result<Figure>) {
        match figure {
            Ok(figure) => self.figures.push(figure),
            Err(ReportError::Empty { what: why, .. }) => self.notes.push(format!("{what}: not drawn, {why}.")),
            Err(error) => self.notes.push(format!("{what}: not drawn. {error}.")),
        }
    }
}

fn level(measured: Option<Measured>) -> Option<f64> {
    measured.map(|m| m.performance.mean_reward)
}

fn recorded(run: &Run, what: &str) -> Vec<Transition> {
    run.record.iter().filter(|r| r.0 == what).map(|r| r.1.clone()).collect()
}

/// Draws everything that a run directory has data for.
#[must_use]
pub fn sections(run: &Run) -> Vec<Section> {
    vec![learned_at_all(run), what_it_learned(run), trust(run), stability(run)]
}

fn learned_at_all(run: &Run) -> Section {
    let mut section = Section::new("learn", "Did it learn?");
    let summary = run.summary.as_ref();
    if summary.is_some_and(|s| s.improved == Some(false)) {
        section.notes.push(
            "No policy that was tried on the robot beats the nominal gait: the nominal gait is the final policy."
                .to_owned(),
        );
    }
    let best = summary.and_then(|s| s.iterations.iter().filter_map(|i| i.mean_reward).max_by(f64::total_cmp));
    section.draw(
        "Learning curve",
        learning_curves(&LearningCurves {
            trials: run.learning.clone(),
            strides: run.transitions.clone(),
            nominal: level(summary.and_then(|s| s.nominal)),
            final_policy: level(summary.and_then(|s| s.final_policy)),
            best,
            paper: paper_says(run),
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
    section.draw("Actions", actions(&action_figure(run)));
    section
}

/// The paper's number for what the task rewards, if it has one.
fn paper_says(run: &Run) -> Option<String> {
    match run.reward_quantity().as_deref() {
        Some("speed_m_s") => Some(
            "The paper's simulated robot walked at 0.14 m/s (sec. 8.1); here the reward of a stride is its speed in m/s.".to_owned(),
        ),
        // Eq. (27) with a target of 2 deg.
        None if run.target_deg().is_some_and(|t| (t - 2.0).abs() < 1e-9) => Some(
            "The paper's Fig. 8 ends at about 0 after 15 trials in a map of 20 strides.".to_owned(),
        ),
        _ => None,
    }
}

fn action_figure(run: &Run) -> ActionFigure {
    let summary = run.summary.as_ref();
    let iterations = summary.map(|s| s.iterations.as_slice()).unwrap_or_default();
    let chosen = summary.and_then(|s| s.final_iteration);
    ActionFigure {
        columns: run.columns.clone(),
        strides: run.transitions.clone(),
        iterations: iterations
            .iter()
            .map(|i| ActionIteration {
                iteration: i.iteration,
                region: i.trust_region.clone(),
                verdict: i.proof.as_ref().map(|p| p.verdict),
                warnings: i.warnings.clone(),
            })
            .collect(),
        proven: iterations
            .iter()
            .find(|i| Some(i.iteration) == chosen)
            .and_then(|i| i.proof.as_ref())
            .map(|p| p.action.clone()),
    }
}

fn what_it_learned(run: &Run) -> Section {
    let mut section = Section::new("map", "What did it learn?");
    let training = |until: usize| -> Vec<Transition> {
        let data = run.map_strides(until);
        data.filter(|s| s.end != StrideEnd::Aborted).cloned().collect()
    };
    let chosen = run.summary.as_ref().and_then(|s| s.final_iteration);
    let policies = run.policies.iter();
    let of_final = policies.clone().find(|p| Some(p.0) == chosen);
    match of_final.or(run.policies.last()) {
        None => section.notes.push("The run has no policy yet.".to_owned()),
        Some((iteration, grid)) => section.draw(
            "Policy",
            policy(&PolicyFigure {
                iteration: *iteration,
                columns: run.columns.clone(),
                grid: grid.clone(),
                earlier: policies.filter(|p| p.0 != *iteration).cloned().collect(),
                strides: training(usize::MAX),
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
    let of_final = run.lines.iter().find(|l| Some(l.0) == chosen);
    if let Some((iteration, grid)) = of_final.or(run.lines.last()) {
        let summary = run.summary.as_ref();
        let iterations = summary.map(|s| s.iterations.as_slice()).unwrap_or_default();
        section.draw(
            "The map about the policy",
            map_lines(&LineFigure {
                iteration: *iteration,
                columns: run.columns.clone(),
                grid: grid.clone(),
                strides: training(*iteration),
                region: iterations.iter().find(|i| i.iteration == *iteration).and_then(|i| i.trust_region.clone()),
                reward: run.reward_quantity(),
            }),
        );
    }
    section
}

fn trust(run: &Run) -> Section {
    let mut section = Section::new("trust", "Can it be trusted?");
    match run.maps.last() {
        None => section.notes.push("The run has no map yet, so there is nothing to check.".to_owned()),
        Some(map) => {
            let mut map = map.clone();
            if let Some(reward) = run.reward_quantity() {
                let own = map.outputs.iter_mut().filter(|o| o.name == "reward");
                own.for_each(|o| o.name.clone_from(&reward));
            }
            section.draw("Predicted against actual", predicted_actual(&map));
            section.draw("Standardized residuals", standardized_residuals(&map));
        }
    }
    section
}

fn stability(run: &Run) -> Section {
    let mut section = Section::new("stable", "Is it stable?");
    let stretches = |what: &str| -> Vec<Vec<f64>> {
        let mut out: Vec<Vec<f64>> = Vec::new();
        let mut last: Option<(usize, usize)> = None;
        let crossed = recorded(run, what).into_iter();
        for s in crossed.filter(|s| s.end == StrideEnd::Crossing) {
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
        let summary = run.summary.as_ref();
        let lines = |m: Option<Measured>| {
            let m = m.map(|m| m.performance);
            m.map_or([None; 2], |m| [m.return_map_1, m.return_map_2])
        };
        let is_psi = name.starts_with("psi_roll");
        let runs: Vec<Undisturbed> = [
            ("nominal", "nominal gait", summary.and_then(|s| s.nominal)),
            ("final", "final policy", summary.and_then(|s| s.final_policy)),
        ]
        .into_iter()
        .map(|(what, name, measured)| Undisturbed {
            name: name.to_owned(),
            stretches: stretches(what),
            // The lines are those of psi_roll.
            lines: lines(measured.filter(|_| is_psi)),
        })
        .filter(|r| !r.stretches.is_empty())
        .collect();
        section.draw(
            "Return maps without pushes",
            undisturbed_return_maps(&UndisturbedReturnMaps {
                name: name.clone(),
                runs,
                target: run.target_deg().filter(|_| is_psi),
            }),
        );
    }
    pushed(run, &mut section);
    section
}

/// The return maps under pushes, one and two strides on.
fn pushed(run: &Run, section: &mut Section) {
    let pushes: Vec<(&str, &PushOutcome)> = [("nominal gait", &run.push_nominal), ("learned policy", &run.push)]
        .into_iter()
        .filter_map(|(name, push)| Some((name, push.as_ref()?)))
        .collect();
    let Some(setting) = run.push.as_ref().or(run.push_nominal.as_ref()) else {
        section.notes.push(
            "The run was not pushed; `stridemap push` on this directory adds the return map under pushes.".to_owned(),
        );
        return;
    };
    let figure = |maps: Vec<ReturnMap>| Fig10 {
        maps,
        target_deg: run.target_deg(),
        force_n: Some(setting.force_n),
        duration_s: Some(setting.duration_s),
    };
    let pairs = |p: &PushOutcome, after: fn(&PushPair) -> f64| -> Vec<ReturnPair> {
        let pairs = p.data.iter().map(|pair| ReturnPair {
            psi_roll_deg: pair.psi_roll_deg,
            psi_roll_after_2_deg: after(pair),
            force_n: Some(pair.force_n),
        });
        let known = pairs.filter(|pair| pair.psi_roll_after_2_deg.is_finite());
        known.collect()
    };
    let one_on = pushes.iter().map(|(name, p)| ReturnMap {
        name: (*name).to_owned(),
        pairs: pairs(p, |pair| pair.psi_roll_after_1_deg),
        slope: p.after_1.map(|l| l.slope),
        fixed_point_deg: p.after_1.and_then(|l| l.fixed_point_deg),
        falls: p.falls,
    });
    let one_on: Vec<ReturnMap> = one_on.filter(|map| !map.pairs.is_empty()).collect();
    if !one_on.is_empty() {
        section.draw("Return map under pushes, one stride on", pushed_one_stride(&figure(one_on)));
    }
    let two_on = pushes.iter().map(|(name, p)| ReturnMap {
        name: (*name).to_owned(),
        pairs: pairs(p, |pair| pair.psi_roll_after_2_deg),
        slope: p.slope,
        fixed_point_deg: p.fixed_point_deg,
        falls: p.falls,
    });
    section.draw("Return map under pushes", fig10(&figure(two_on.collect())));
}

/// The figure that puts several runs on the same axes, with the spread over them.
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
                nominal: level(summary.nominal),
                iterations: summary
                    .iterations
                    .iter()
                    .filter_map(|i| Some((i.strides_so_far as f64, i.mean_reward?)))
                    .collect(),
                final_policy: level(summary.final_policy),
                trials: run.learning.iter().filter(|t| t.world == World::Map).map(|t| t.average_reward).collect(),
                falls: run.falls().0 as u64,
            }
        })
        .collect();
    let quantity = runs.first().and_then(Run::reward_quantity);
    let same = runs.iter().all(|r| r.reward_quantity() == quantity);
    let name = quantity.filter(|_| same);
    let name = name.map_or_else(|| "mean reward".to_owned(), |q| crate::figures::label(&q, ""));
    runs_compared(&curves, &name)
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
