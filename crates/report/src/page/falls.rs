//! Falls and their causes, as a table.

use super::html;
use crate::draw::{N, escape, plural};
use stridemap_record::{Fall, FallCriterion, Run};

/// Rows that a reader looks at; the rest is counted.
const MOST: usize = 20;

/// What a criterion looks at, its unit, and on which side of its threshold a fall lies.
const fn words(criterion: FallCriterion) -> (&'static str, &'static str, &'static str) {
    match criterion {
        FallCriterion::PsiRoll => ("ψ<sub>roll</sub> at the section", "\u{b0}", "below"),
        FallCriterion::Height => ("height of the mass, share of its first", "", "below"),
        FallCriterion::Tilt => ("tilt of the base", "\u{b0}", "above"),
        FallCriterion::NoSection => ("time without a section (a stall)", " s", "above"),
    }
}

fn row(place: &str, fall: &Fall) -> Vec<String> {
    let (what, unit, side) = words(fall.criterion);
    let (value, threshold) = (N(fall.value), N(fall.threshold));
    vec![escape(place), what.to_owned(), format!("{value:#.3}{unit}"), format!("{side} {threshold:#.3}{unit}")]
}

/// Every fall and stall of a run whose cause is known; nothing without one.
pub(super) fn table(run: &Run) -> String {
    let fell = run.transitions.iter().enumerate();
    let fell = fell.filter_map(|(i, t)| {
        let place = format!("stride {} (iteration {})", i + 1, t.iteration);
        Some(row(&place, &t.fall?))
    });
    let mut rows: Vec<Vec<String>> = fell.collect();
    let starts = run.summary.iter().flat_map(|s| &s.falls);
    let starts = starts.filter(|f| f.stride.is_none());
    rows.extend(starts.map(|f| {
        let place = match &f.what {
            Some(what) => format!("a start, measuring {what}"),
            None => format!("a start (iteration {})", f.iteration),
        };
        row(&place, &f.fall)
    }));
    rows.extend(run.record.iter().filter_map(|(what, t)| {
        let place = format!("measuring {what}, stride {} of a start", t.k + 1);
        Some(row(&place, &t.fall?))
    }));
    if rows.is_empty() {
        return String::new();
    }
    let more = rows.len().saturating_sub(MOST);
    rows.truncate(MOST);
    let more = match more {
        0 => String::new(),
        n => format!(
            "<p class=\"note\">And {}: the columns fall_* of transitions.csv and record.csv.</p>",
            plural(n, "more fall")
        ),
    };
    let columns = [("the robot fell in", false), ("by", false), ("measured", true), ("threshold", true)];
    html::table(&columns, &rows) + &more
}
