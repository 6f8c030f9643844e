//! What every gait that a search tried looked like: the roll of the pendulum at its sections, and how high its feet came.

use crate::draw::{Axis, Dash, Key, Mark, Panel, Sheet};
use crate::error::Result;
use crate::figure::Figure;

use super::check::some;
use super::paper::PSI;

/// Gaits beside each other.
const COLUMNS: usize = 4;
/// Gaits drawn at most.
const MOST: usize = 32;

/// A gait that was tried.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriedGait {
    /// Its number, from 1.
    pub number: usize,
    /// What became of it, in a word or two.
    pub verdict: String,
    /// Its pitch amplitude.
    pub pitch_deg: f64,
    /// Time and `ψ_roll` of each section.
    pub sections: Vec<(f64, f64)>,
    /// Time, foot (0 left, 1 right) and greatest height of each swing, in millimetres.
    pub swings: Vec<(f64, usize, f64)>,
    /// Whether it was taken.
    pub taken: bool,
    /// Whether it must be drawn, however many there are.
    pub always: bool,
}

/// Draws the gaits that a search tried, from a start each: above `ψ_roll` at every section, below the greatest height of every
/// swing, all on the same axes.
///
/// # Errors
///
/// [`ReportError::Empty`](crate::ReportError::Empty) without a gait.
pub fn tried_gaits(tried: &[TriedGait]) -> Result<Figure> {
    let stem = "tune";
    some(stem, "no gait", tried.len())?;
    let spare = MOST.saturating_sub(tried.iter().filter(|t| t.always || t.taken).count());
    let mut others = 0;
    let shown: Vec<&TriedGait> = (tried.iter())
        .filter(|t| {
            others += usize::from(!(t.always || t.taken));
            t.always || t.taken || others <= spare
        })
        .collect();
    let psi = shown.iter().flat_map(|t| t.sections.iter().map(|s| s.1));
    let (low, high) = (psi.clone().fold(0.0, f64::min).max(-20.0), psi.fold(1.0, f64::max).min(25.0));
    let most_mm = shown.iter().flat_map(|t| t.swings.iter().map(|s| s.2)).fold(5.0, f64::max).min(100.0);
    let end_s = shown.iter().flat_map(|t| t.sections.iter().map(|s| s.0)).fold(5.0, f64::max);
    let mut sheet = Sheet::new(stem, "Gaits that were tried");
    for row in shown.chunks(COLUMNS) {
        let titles: Vec<String> = (row.iter())
            .map(|t| {
                let taken = if t.taken { ", taken" } else { "" };
                format!("{}: {:.1} deg, {}{taken}", t.number, t.pitch_deg, t.verdict)
            })
            .collect();
        let axes = |label: &str, from: f64, to: f64, most: f64| {
            (0..COLUMNS)
                .map(|i| {
                    let label = if i == 0 { label } else { "" };
                    (Axis::linear_with("", 0.0, end_s, 3.0), Axis::linear_with(label, from, to, most))
                })
                .collect::<Vec<_>>()
        };
        let panels = |axes: Vec<(Axis, Axis)>, titled: bool| -> Vec<(f64, Axis, Axis, Option<&str>)> {
            let with = axes.into_iter().enumerate();
            with.map(|(i, (x, y))| (1.0, x, y, titles.get(i).filter(|_| titled).map(String::as_str))).collect()
        };
        let above = sheet.row(70.0, panels(axes(&format!("{PSI} (deg)"), low, high, 4.0), true));
        for (mut panel, gait) in above.into_iter().zip(row) {
            roll(&mut panel, gait);
            sheet.add(panel);
        }
        let below = sheet.row(46.0, panels(axes("foot (mm)", 0.0, most_mm, 3.0), false));
        for (mut panel, gait) in below.into_iter().zip(row) {
            feet(&mut panel, gait);
            sheet.add(panel);
        }
    }
    sheet.key("section", Key::Both("s0", Dash::Solid, Mark::Dot));
    sheet.key("swing of the left foot", Key::Line("s1", Dash::Solid));
    sheet.key("of the right foot", Key::Line("s2", Dash::Solid));
    let left_out = tried.len() - shown.len();
    let rest = if left_out > 0 { format!(" {left_out} more were tried and are not drawn.") } else { String::new() };
    let caption = format!(
        "Each of {} gaits from its start, over time in seconds: number, pitch amplitude and what became of it; above the roll of \
         the pendulum at every section, below how high the sole came in every swing. A gait that steps lifts both feet in turn.{rest}",
        shown.len()
    );
    let mut csv = String::from("try,kind,time_s,value\n");
    for gait in tried {
        gait.sections.iter().for_each(|(t, psi)| csv += &format!("{},psi_roll_deg,{t},{psi}\n", gait.number));
        let name = |foot: usize| if foot == 0 { "left_mm" } else { "right_mm" };
        gait.swings.iter().for_each(|(t, foot, mm)| csv += &format!("{},{},{t},{mm}\n", gait.number, name(*foot)));
    }
    let alt = format!(
        "Small multiples of {} gaits: psi_roll at the sections and the height of the feet over time.",
        shown.len()
    );
    Ok(sheet.finish(&caption, &alt, csv))
}

fn roll(panel: &mut Panel, gait: &TriedGait) {
    panel.line(&gait.sections, if gait.taken { "s2" } else { "s0" }, Dash::Solid, 1.2);
    panel.marks(&gait.sections, if gait.taken { "s2" } else { "s0" }, Mark::Dot, 1.8);
}

fn feet(panel: &mut Panel, gait: &TriedGait) {
    for (time_s, foot, mm) in &gait.swings {
        panel.line(&[(*time_s, 0.0), (*time_s, *mm)], if *foot == 0 { "s1" } else { "s2" }, Dash::Solid, 1.6);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_taken_gait_is_drawn_however_many_were_tried() {
        let gait = |number| TriedGait {
            number,
            verdict: "steps".into(),
            pitch_deg: 4.0,
            sections: vec![(1.0, 3.0), (1.5, 3.2)],
            swings: vec![(1.2, 0, 12.0), (1.7, 1, 11.0)],
            taken: number == 60,
            always: number < 8,
        };
        let tried: Vec<TriedGait> = (1..=60).map(gait).collect();
        let figure = tried_gaits(&tried).unwrap();
        assert!(figure.svg.contains("60: 4.0 deg, steps, taken") && figure.caption.contains("28 more"));
        assert!(figure.csv.contains("60,left_mm,1.2,12"));
        assert!(tried_gaits(&[]).is_err());
    }
}
