//! Falls and their causes, as a table.

use crate::draw::{escape, number, plural};
use crate::run::{Fall, Run, StrideRow};

/// Rows that a reader looks at; the rest is counted.
const MOST: usize = 20;

/// What a criterion looks at, its unit, and on which side of its threshold a fall lies.
fn words(criterion: &str) -> (&str, &str, &str) {
    match criterion {
        "psi_roll" => ("ψ<sub>roll</sub> at the section", "\u{b0}", "below"),
        "height" => ("height of the mass, share of its first", "", "below"),
        "tilt" => ("tilt of the base", "\u{b0}", "above"),
        "no_section" => ("time without a section (a stall)", " s", "above"),
        other => (other, "", "beyond"),
    }
}

fn row(place: &str, fall: &Fall) -> String {
    let (what, unit, side) = words(&fall.criterion);
    format!(
        "<tr><td>{}</td><td>{what}</td><td class=\"num\">{}{unit}</td><td class=\"num\">{side} {}{unit}</td></tr>",
        escape(place),
        number(fall.value, 3),
        number(fall.threshold, 3)
    )
}

/// Every fall and stall of a run whose cause is known; nothing without one.
pub(super) fn table(run: &Run) -> String {
    let of = |strides: &[StrideRow], place: &dyn Fn(usize, &StrideRow) -> String| -> Vec<String> {
        let fell = strides.iter().enumerate();
        fell.filter_map(|(i, t)| Some(row(&place(i, t), t.fall.as_ref()?)))
            .collect()
    };
    let mut rows = of(&run.transitions, &|i, t| {
        format!("stride {} (iteration {})", i + 1, t.iteration)
    });
    let starts = run.summary.iter().flat_map(|s| &s.falls);
    let starts = starts.filter(|f| f.stride.is_none());
    rows.extend(starts.map(|f| {
        let place = match &f.what {
            Some(what) => format!("a start, measuring {what}"),
            None => format!("a start (iteration {})", f.iteration),
        };
        row(&place, &f.fall)
    }));
    rows.extend(of(&run.record, &|_, t| {
        format!("measuring {}, stride {} of a start", t.what, t.k + 1)
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
    format!(
        "<div class=\"wide\"><table><thead><tr><th>the robot fell in</th><th>by</th><th class=\"num\">measured</th>\
         <th class=\"num\">threshold</th></tr></thead><tbody>{}</tbody></table></div>{more}",
        rows.concat()
    )
}
