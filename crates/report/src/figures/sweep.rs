//! What a setting does in a sweep: every run a point, the mean of each value with its interval.

use super::check::{column, some};
use crate::draw::{Axis, Dash, Key, Mark, N, Sheet, plural};
use crate::error::Result;
use crate::figure::Figure;

/// A value of a setting with the mean of its runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SweepMean {
    /// Where on the axis.
    pub at: f64,
    /// Mean.
    pub mean: f64,
    /// Half the width of its 95 % interval; `None` with fewer than two runs.
    pub interval_95: Option<f64>,
}

/// Draws a measured value against a setting.
///
/// # Arguments
///
/// - `key`, `name` – the setting and the measured value, as they are called.
/// - `values` – the values that the setting was given, with their places on the axis; none: it was drawn, and the axis
///   is even.
/// - `runs` – setting and measured value of each run.
/// - `means` – of each value.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if there is no run or a value is not finite.
pub fn sweep(
    key: &str,
    name: &str,
    values: &[(f64, String)],
    runs: &[(f64, f64)],
    means: &[SweepMean],
) -> Result<Figure> {
    let stem = format!("{}-{name}", key.replace('.', "-"));
    some(&stem, "runs", runs.len())?;
    let (at, measured): (Vec<f64>, Vec<f64>) = runs.iter().copied().unzip();
    column(&stem, key, &at, runs.len())?;
    column(&stem, name, &measured, runs.len())?;
    let mut x = Axis::covering(key, at.iter().copied());
    let mut apart = 0.0;
    if !values.is_empty() {
        let air = 0.08 * (x.max - x.min);
        (x.min, x.max, x.ticks) = (x.min - air, x.max + air, values.to_vec());
        apart = 0.04 * (x.max - x.min);
    }
    /// Places of runs of one value, as even as those of any number of them: by the golden section.
    const GOLDEN: f64 = 0.618_034;
    let places = runs.iter().enumerate();
    let shown: Vec<_> = places.map(|(i, (x, y))| (x + apart * ((i as f64 * GOLDEN).fract() - 0.5), *y)).collect();
    let ends =
        means.iter().flat_map(|m| [m.mean - m.interval_95.unwrap_or(0.0), m.mean + m.interval_95.unwrap_or(0.0)]);
    let y = Axis::covering(name, measured.iter().copied().chain(ends));
    let mut sheet = Sheet::new(&stem, &format!("{name} against {key}"));
    for mut p in sheet.row(280.0, vec![(1.0, x, y, None)]) {
        p.marks(&shown, "s2", Mark::Dot, 2.2);
        p.key("run", Key::Mark("s2", Mark::Dot));
        if !means.is_empty() {
            let line: Vec<(f64, f64)> = means.iter().map(|m| (m.at, m.mean)).collect();
            for m in means {
                let half = m.interval_95.unwrap_or(0.0);
                p.line(&[(m.at, m.mean - half), (m.at, m.mean + half)], "s0", Dash::Solid, 3.2);
                p.hover(m.at, m.mean, format!("{name} {:.4}, 95 % within {:.4}", N(m.mean), N(half)));
            }
            p.line(&line, "s0", Dash::Solid, 2.2);
            p.marks(&line, "s0", Mark::Diamond, 4.0);
            p.key("mean, 95 % interval", Key::Both("s0", Dash::Solid, Mark::Diamond));
        }
        sheet.add(p);
    }
    let said = means.iter().map(|m| match m.interval_95 {
        Some(half) => format!("{:.4} ± {:.4}", N(m.mean), N(half)),
        None => format!("{:.4}", N(m.mean)),
    });
    let said = said.collect::<Vec<_>>().join("; ");
    let of_means = if means.is_empty() {
        String::new()
    } else {
        format!(" Line: means with their 95 % intervals by Student's t, over all other settings ({said}).")
    };
    let caption = format!("{name} of {} against {key}: every run a point.{of_means}", plural(runs.len(), "run"));
    let mut csv = format!("{key},{name}\n");
    for (at, measured) in runs {
        let named = values.iter().find(|(place, _)| (place - at).abs() < 1e-9).map(|(_, label)| label.clone());
        csv += &format!("{},{measured}\n", named.unwrap_or_else(|| at.to_string()));
    }
    Ok(sheet.finish(&caption, &format!("{name} against {key}. {said}"), csv))
}
