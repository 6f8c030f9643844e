//! The largest push that is survived, by phase of the gait and direction: a heat map for each duration.

use super::check::{column, some};
use crate::draw::{Anchor, Axis, N, Panel, Sheet, extent, number, ramp_color};
use crate::error::Result;
use crate::figure::Figure;
use stridemap_record::{AtlasCell, AtlasHeadline, PushAtlas, direction_words};

/// Directions as an axis names them, from forward on.
const DIRECTIONS: [&str; 8] = [
    "forward",
    "forward, stance side",
    "stance side",
    "back, stance side",
    "back",
    "back, swing side",
    "swing side",
    "forward, swing side",
];

/// Draws a push atlas: colour and number are the largest change of velocity survived.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if it has no cell, or a value is not finite.
pub fn push_atlas(atlas: &PushAtlas) -> Result<Figure> {
    let stem = if atlas.policy == "nominal" { "push-atlas-nominal" } else { "push-atlas" };
    some(stem, "no cell of the atlas", atlas.cells.len())?;
    let survived: Vec<f64> = atlas.cells.iter().map(|c| c.survived_m_s).collect();
    column(stem, "survived_m_s", &survived, survived.len())?;
    let most = extent(survived.iter().copied()).1.max(atlas.tolerance_m_s);
    let who = if atlas.policy == "nominal" { "nominal gait" } else { "learned policy" };
    let mut sheet = Sheet::new(stem, &format!("Largest push survived, {who} (change of velocity, m/s)"));
    for of in &atlas.durations {
        let cells: Vec<&AtlasCell> =
            atlas.cells.iter().filter(|c| c.duration_s.total_cmp(&of.duration_s).is_eq()).collect();
        let [phases, directions] = [distinct(&cells, |c| c.phase), distinct(&cells, |c| c.direction_deg)];
        let title = format!("for {:#.3} s", N(of.duration_s));
        let mut p =
            sheet.single(34.0 * directions as f64, phase_axis(phases), direction_axis(directions), Some(&title));
        for c in cells {
            draw_cell(&mut p, c, [phases, directions], most);
        }
        sheet.add(p);
    }
    let csv = atlas.table();
    Ok(sheet.finish(&caption(atlas), &alt(atlas), csv))
}

/// How many different values there are.
fn distinct(cells: &[&AtlasCell], of: impl Fn(&AtlasCell) -> f64) -> usize {
    let mut values: Vec<f64> = cells.iter().map(|c| of(c)).collect();
    values.sort_by(f64::total_cmp);
    values.dedup_by(|a, b| a.total_cmp(b).is_eq());
    values.len()
}

fn phase_axis(phases: usize) -> Axis {
    let mut axis =
        Axis::linear("phase at which the push begins (share of a stride after the section)", 0.0, phases as f64);
    axis.ticks = (0..phases).map(|i| (i as f64 + 0.5, number(i as f64 / phases as f64, 3))).collect();
    axis
}

/// Forward at the top.
fn direction_axis(directions: usize) -> Axis {
    let mut axis = Axis::linear("", 0.0, directions as f64);
    let name = |i: usize| match directions {
        8 => DIRECTIONS[i].to_owned(),
        n => format!("{} deg", number(360.0 * i as f64 / n as f64, 3)),
    };
    axis.ticks = (0..directions).map(|i| ((directions - i) as f64 - 0.5, name(i))).collect();
    axis
}

fn draw_cell(p: &mut Panel, c: &AtlasCell, [phases, directions]: [usize; 2], most: f64) {
    let x = (c.phase * phases as f64).round();
    let y = directions as f64 - 1.0 - (c.direction_deg / 360.0 * directions as f64).round();
    let share = c.survived_m_s / most;
    p.cell((x, x + 1.0), (y, y + 1.0), &ramp_color(share));
    let at_least = if c.fallen_m_s.is_none() { "\u{2265}" } else { "" };
    // White on dark cells, black on bright ones, whatever the theme.
    let class = if share < 0.55 { "on-dark" } else { "on-bright" };
    let text = format!("{at_least}{:.2}", N(c.survived_m_s));
    p.note_px(p.px(x + 0.5), p.py(y + 0.5) + 4.5, Anchor::Middle, class, &text);
    let recover = match c.strides_to_recover {
        Some(n) => format!("recovers in {n} strides"),
        None => "not back within the strides watched".to_owned(),
    };
    let falls = c.fallen_m_s.map_or_else(|| "never falls".to_owned(), |v| format!("falls at {:.3}", N(v)));
    let text = format!(
        "phase {:#.3}, {}: survives {:.3} m/s, {falls}; {recover}",
        N(c.phase),
        direction_words(c.direction_deg),
        N(c.survived_m_s)
    );
    p.hover(x + 0.5, y + 0.5, text);
}

/// The weakest spot of a duration, in words.
pub(crate) fn weakest_words(of: &AtlasHeadline) -> String {
    format!(
        "{:.3} m/s for {:#.3} s ({:.2} N s, {:.0} % of the robot's weight; at phase {:#.3}, {})",
        N(of.smallest_m_s),
        N(of.duration_s),
        N(of.smallest_n_s),
        N(100.0 * of.smallest_of_weight),
        N(of.smallest_phase),
        direction_words(of.smallest_direction_deg)
    )
}

fn caption(atlas: &PushAtlas) -> String {
    let body = if atlas.body.is_empty() { "torso" } else { &atlas.body };
    let smallest: Vec<String> = atlas.durations.iter().map(weakest_words).collect();
    let areas: Vec<String> = atlas.durations.iter().map(|d| format!("{:.0} %", N(100.0 * d.area_survived))).collect();
    format!(
        "A horizontal force on the {body} of the {:.0} kg robot; its size is the change of velocity it gives the whole robot (force = mass x \
         change / duration). Sides are those of the stance and the swing leg at the section. Survived: not down (height, tilt, no section) in the stride pushed \
         and {} more; the border is bisected to {:#.3} m/s, from one start, so it has no spread. Smallest: {}. Of phase x direction x \
         size up to {:#.3} m/s, {} is survived. {} pushes, {} strides, seed {}. The field trains and tests at 0.5 to 1.2 m/s.",
        N(atlas.mass_kg),
        atlas.after_strides,
        N(atlas.tolerance_m_s),
        smallest.join("; "),
        N(atlas.largest_m_s),
        areas.join(" and "),
        atlas.trials,
        atlas.strides,
        atlas.seed
    )
}

fn alt(atlas: &PushAtlas) -> String {
    let smallest: Vec<String> = atlas.durations.iter().map(weakest_words).collect();
    format!(
        "Heat maps of the largest push survived over phase and direction; the smallest are {}.",
        smallest.join("; ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn atlas() -> PushAtlas {
        let cell = |i: usize| AtlasCell {
            duration_s: 0.2,
            phase: (i / 8) as f64 / 8.0,
            direction_deg: 45.0 * (i % 8) as f64,
            survived_m_s: 0.1 + 0.001 * i as f64,
            fallen_m_s: (i != 63).then_some(0.2),
            strides_to_recover: Some(3),
            fall_criterion: None,
            trials: 8,
            strides: 100,
        };
        let empty = PushAtlas { mass_kg: 95.0, largest_m_s: 1.2, tolerance_m_s: 0.01, ..PushAtlas::default() };
        empty.with((0..64).map(cell).collect())
    }

    #[test]
    fn every_cell_has_its_number_and_the_caption_the_weakest() {
        let figure = push_atlas(&atlas()).unwrap();
        assert_eq!(figure.hover.len(), 64);
        assert_eq!(figure.csv.lines().count(), 65);
        assert!(figure.svg.contains("\u{2265}0.16"), "the last cell never falls");
        assert!(figure.caption.contains("Smallest: 0.100 m/s for 0.2 s (9.50 N s, 5 % of"), "{}", figure.caption);
        assert!(push_atlas(&PushAtlas::default()).is_err());
    }
}
