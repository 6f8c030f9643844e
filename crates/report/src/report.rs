//! `report.html` and `figures/` of one or several runs.

use std::path::Path;

use crate::error::{ReportError, Result};
use crate::figure::Figure;
use crate::figures::{
    actions, fig10, learning_curves, map_lines, map_slices, map_surface, path, policy, predicted_actual, push_atlas,
    pushed_one_stride, standardized_residuals, state_over_strides, undisturbed_return_maps, weakest_words,
};
use stridemap_record::{PushOutcome, Run};

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

/// Draws everything that a run directory has data for.
#[must_use]
pub fn sections(run: &Run) -> Vec<Section> {
    vec![learned_at_all(run), will_it_fall(run), what_it_learned(run), trust(run), stability(run)]
}

fn learned_at_all(run: &Run) -> Section {
    let mut section = Section::new("learn", "Did it learn?");
    if run.summary.as_ref().is_some_and(|s| s.improved == Some(false)) {
        let nominal =
            "No policy that was tried on the robot beats the nominal gait: the nominal gait is the final policy.";
        section.notes.push(nominal.to_owned());
    }
    if !run.columns.goal.is_empty() {
        section.draw("Path on the floor", path(run));
    }
    section.draw("Learning curve", learning_curves(run));
    section.draw("State over strides", state_over_strides(run));
    section.draw("Actions", actions(run));
    section
}

fn will_it_fall(run: &Run) -> Section {
    let mut section = Section::new("fall", "Will it fall?");
    pushes(run, &mut section);
    section
}

/// The push atlas, in words and as heat maps.
fn pushes(run: &Run, section: &mut Section) {
    if run.atlases.is_empty() {
        let how = "How hard it may be pushed was not mapped; `stridemap push RUN --atlas` on this directory does.";
        section.notes.push(how.to_owned());
    }
    for atlas in &run.atlases {
        let who = if atlas.policy == "nominal" { "The nominal gait" } else { "The learned policy" };
        if let Some(weakest) = atlas.weakest() {
            let text = format!("{who} survives every push up to {}.", weakest_words(weakest));
            section.notes.push(text);
        }
        section.draw("Push atlas", push_atlas(atlas));
    }
}

fn what_it_learned(run: &Run) -> Section {
    let mut section = Section::new("map", "What did it learn?");
    section.draw("Policy", policy(run));
    section.draw("Map", map_surface(run));
    if !run.grids.is_empty() {
        section.draw("Slices of the map", map_slices(run));
    }
    if !run.lines.is_empty() {
        section.draw("The map about the policy", map_lines(run));
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
    section.draw("Return maps without pushes", undisturbed_return_maps(run));
    let pushed = [("nominal gait", &run.push_nominal), ("learned policy", &run.push)];
    let pushed: Vec<(&str, &PushOutcome)> =
        pushed.into_iter().filter_map(|(name, push)| Some((name, push.as_ref()?))).collect();
    if pushed.is_empty() {
        let how = "The run was not pushed; `stridemap push` on this directory adds the return map under pushes.";
        section.notes.push(how.to_owned());
        return section;
    }
    // Tables of earlier versions do not know the section between.
    if pushed.iter().any(|(_, push)| push.data.iter().any(|pair| pair.psi_roll_after_1_deg.is_finite())) {
        section.draw("Return map under pushes, one stride on", pushed_one_stride(&pushed, run.target_deg()));
    }
    section.draw("Return map under pushes", fig10(&pushed, run.target_deg()));
    section
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
