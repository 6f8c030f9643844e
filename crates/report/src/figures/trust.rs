//! Can it be trusted: predictions against outcomes, residuals.

use super::check::{column, some};
use super::names::{label, quantity};
use crate::draw::{Axis, Dash, Key, Mark, N, Sheet, plain};
use crate::error::Result;
use crate::figure::Figure;
use stridemap_map::{SavedLeaveOneOut, SavedMap, SavedOutput};

fn scored<'a>(stem: &str, map: &'a SavedMap) -> Result<Vec<(&'a SavedOutput, &'a SavedLeaveOneOut)>> {
    let outputs: Vec<_> =
        map.outputs.iter().map(|o| (o, &o.leave_one_out)).filter(|(_, l)| !l.actual.is_empty()).collect();
    some(stem, "no leave-one-out prediction", outputs.len())?;
    for (o, l) in &outputs {
        let n = l.actual.len();
        column(stem, &format!("{} actual", o.name), &l.actual, n)?;
        column(stem, &format!("{} mean", o.name), &l.mean, n)?;
        column(stem, &format!("{} std", o.name), &l.std, n)?;
    }
    Ok(outputs)
}

fn residuals(l: &SavedLeaveOneOut) -> Vec<f64> {
    l.actual.iter().zip(&l.mean).zip(&l.std).map(|((a, m), s)| (a - m) / s.max(1e-12)).collect()
}

/// How many residuals lie within `k` standard deviations.
fn within(residuals: &[f64], k: f64) -> usize {
    residuals.iter().filter(|r| r.abs() <= k).count()
}

/// Draws the predicted against the actual next state, each predicted from the other strides, with
/// two standard deviations.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if there is no leave-one-out prediction, or a value is not finite.
pub fn predicted_actual(map: &SavedMap) -> Result<Figure> {
    let stem = "predicted";
    let outputs = scored(stem, map)?;
    let mut sheet = Sheet::new(stem, "Predicted against actual");
    let per_row = if outputs.len() == 4 { 2 } else { outputs.len().min(3) };
    let spec = |(o, l): &(&SavedOutput, &SavedLeaveOneOut)| {
        let all =
            || l.actual.iter().copied().chain(l.mean.iter().zip(&l.std).flat_map(|(m, s)| [m - 2.0 * s, m + 2.0 * s]));
        let most = if per_row > 2 { 4.0 } else { 6.0 };
        let range = Axis::covering("", all());
        let axis = |text: String| Axis::linear_with(&text, range.min, range.max, most);
        let next = if o.name.starts_with("psi_") { "(k + 1)" } else { "" };
        (
            1.0,
            axis(format!("actual {}", label(&o.name, next))),
            axis(format!("predicted {}", label(&o.name, next))),
            None,
        )
    };
    let height = match outputs.len() {
        1 | 2 => 290.0,
        4 => 240.0,
        _ => 200.0,
    };
    let mut panels = Vec::new();
    for row in outputs.chunks(per_row) {
        panels.extend(sheet.row(height, row.iter().map(spec).collect()));
    }
    let mut csv = String::from("output,actual,predicted_mean,predicted_std,inside_2_sd\n");
    let mut scores = Vec::new();
    for ((o, l), mut p) in outputs.iter().zip(panels) {
        let r = residuals(l);
        p.line(&[(p.x.min, p.x.min), (p.x.max, p.x.max)], "ref", Dash::Solid, 1.1);
        for (inside, class) in [(true, "s0"), (false, "s1")] {
            let rows: Vec<usize> = (0..r.len()).filter(|i| (r[*i].abs() <= 2.0) == inside).collect();
            let bars: Vec<_> = rows
                .iter()
                .map(|i| (l.actual[*i], l.mean[*i] - 2.0 * l.std[*i], l.mean[*i] + 2.0 * l.std[*i]))
                .collect();
            let points: Vec<_> = rows.iter().map(|i| (l.actual[*i], l.mean[*i])).collect();
            p.error_bars(&bars, class, 0.0);
            p.marks(&points, class, if inside { Mark::Disc } else { Mark::Diamond }, 3.4);
        }
        for (i, residual) in r.iter().enumerate() {
            let [actual, mean, std] = [l.actual[i], l.mean[i], l.std[i]];
            let (k, [a, m, s]) = (i + 1, [actual, mean, std].map(N));
            p.hover(actual, mean, format!("stride {k}: predicted {m:.3} ± {s:.3}, actual {a:.3}"));
            csv += &format!("{},{actual},{mean},{std},{}\n", o.name, residual.abs() <= 2.0);
        }
        p.key("prediction ± 2 sd", Key::Mark("s0", Mark::Disc));
        p.key("outcome outside ± 2 sd", Key::Mark("s1", Mark::Diamond));
        p.key("identity", Key::Line("ref", Dash::Solid));
        sheet.add(p);
        scores.push(format!("{}: {} of {} within ±2 sd", plain(&quantity(&o.name).0), within(&r, 2.0), r.len()));
    }
    let caption = format!(
        "Map of iteration {}. Each stride predicted from all the others (leave-one-out): mean and ±2 standard deviations, noise included, \
         against what happened. {}. A calibrated map has 95 % within.",
        map.iteration,
        scores.join("; ")
    );
    let alt = format!("Scatter of predicted against actual outcomes with intervals. {}.", scores.join("; "));
    Ok(sheet.finish(&caption, &alt, csv))
}

/// Draws a histogram of the standardized leave-one-out residuals of each output against N(0, 1).
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if there is no leave-one-out prediction, or a value is not finite.
pub fn standardized_residuals(map: &SavedMap) -> Result<Figure> {
    let stem = "residuals";
    let outputs = scored(stem, map)?;
    const EDGE: f64 = 4.0;
    const BIN: f64 = 0.5;
    let bins = (2.0 * EDGE / BIN) as usize;
    let histogram = |r: &[f64]| -> Vec<f64> {
        let mut counts = vec![0.0; bins];
        for v in r {
            let bin = (((v + EDGE) / BIN).floor()).clamp(0.0, bins as f64 - 1.0) as usize;
            counts[bin] += 1.0 / (r.len() as f64 * BIN);
        }
        counts
    };
    let mut sheet = Sheet::new(stem, "Residuals against their promised spread");
    let all: Vec<(String, Vec<f64>)> =
        outputs.iter().map(|(o, l)| (plain(&quantity(&o.name).0), residuals(l))).collect();
    let per_row = if all.len() == 4 { 2 } else { all.len().min(3) };
    let spec = |(name, r): &(String, Vec<f64>)| {
        let top = histogram(r).into_iter().fold(0.42, f64::max);
        let title = (all.len() > 1).then(|| name.clone());
        (
            1.0,
            Axis::linear_with("standardized residual", -EDGE, EDGE, 8.0 / per_row as f64 + 2.0),
            Axis::linear_with("density", 0.0, top * 1.08, 5.0),
            title,
        )
    };
    let mut csv = String::from("output,bin_from,bin_to,density\n");
    let mut scores = Vec::new();
    let height = if all.len() > 2 { 150.0 } else { 220.0 };
    let mut panels = Vec::new();
    for row in all.chunks(per_row) {
        let specs: Vec<(f64, Axis, Axis, Option<String>)> = row.iter().map(spec).collect();
        let specs = specs.iter().map(|(s, x, y, title)| (*s, x.clone(), y.clone(), title.as_deref())).collect();
        panels.extend(sheet.row(height, specs));
    }
    for ((name, r), mut p) in all.iter().zip(panels) {
        for (i, density) in histogram(r).iter().enumerate() {
            let from = -EDGE + BIN * i as f64;
            p.bar((from + 0.03, from + BIN - 0.03), (0.0, *density), "s0", 0.55);
            let (n, count) = (r.len(), (density * BIN * r.len() as f64).round());
            p.hover(from + 0.5 * BIN, *density, format!("{:.1} to {:.1} sd: {count} of {n}", N(from), N(from + BIN)));
            csv += &format!("{name},{from},{},{density}\n", from + BIN);
        }
        let normal: Vec<(f64, f64)> = (-80..=80)
            .map(|i| {
                let z = f64::from(i) * 0.05;
                (z, (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt())
            })
            .collect();
        p.line(&normal, "s1", Dash::Dashed, 2.0);
        p.key("residuals", Key::Band("s0", 0.55));
        p.key("N(0, 1)", Key::Line("s1", Dash::Dashed));
        sheet.add(p);
        let n = r.len();
        let [one, two] = [1.0, 2.0].map(|k| N(100.0 * within(r, k) as f64 / n as f64));
        scores.push(format!("{name}: n = {n}, {one:#.3} % within ±1 sd, {two:#.3} % within ±2 sd"));
    }
    let caption = format!(
        "Map of iteration {}. Leave-one-out residuals, each divided by its predicted standard deviation (bars of half a deviation; those beyond \
         ±4 in the last bar), against the standard normal density. {}. N(0, 1) has 68 % and 95 %.",
        map.iteration,
        scores.join("; ")
    );
    let alt = format!("Histogram of standardized residuals against the normal density. {}.", scores.join("; "));
    Ok(sheet.finish(&caption, &alt, csv))
}
