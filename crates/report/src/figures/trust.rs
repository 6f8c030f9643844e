//! Can it be trusted: predictions against outcomes, residuals, success over seeds.

use super::check::{column, some};
use super::names::{label, quantity};
use crate::draw::{Axis, Dash, Key, Mark, Sheet, number, plain, signed};
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
            p.hover(
                l.actual[i],
                l.mean[i],
                format!(
                    "stride {}: predicted {} ± {}, actual {}",
                    i + 1,
                    signed(l.mean[i], 3),
                    signed(l.std[i], 3),
                    signed(l.actual[i], 3)
                ),
            );
            csv.push_str(&format!("{},{},{},{},{}\n", o.name, l.actual[i], l.mean[i], l.std[i], residual.abs() <= 2.0));
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
            p.hover(
                from + 0.5 * BIN,
                *density,
                format!(
                    "{} to {} sd: {} of {}",
                    signed(from, 1),
                    signed(from + BIN, 1),
                    (density * BIN * r.len() as f64).round(),
                    r.len()
                ),
            );
            csv.push_str(&format!("{name},{from},{},{density}\n", from + BIN));
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
        let n = r.len() as f64;
        scores.push(format!(
            "{name}: n = {}, {} % within ±1 sd, {} % within ±2 sd",
            r.len(),
            number(100.0 * within(r, 1.0) as f64 / n, 3),
            number(100.0 * within(r, 2.0) as f64 / n, 3)
        ));
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

/// How many runs of a number of strides succeeded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SuccessRate {
    /// Training and evaluation strides of each run.
    pub strides: u32,
    /// Runs that met every criterion.
    pub successes: u32,
    /// All runs, one per seed.
    pub runs: u32,
}

impl SuccessRate {
    /// Wilson's 95 % interval of the share of successes.
    #[must_use]
    pub fn wilson(&self) -> (f64, f64) {
        // The normal deviate that leaves 2.5 % on either side.
        const Z: f64 = 1.959_963_984_540_054;
        if self.runs == 0 {
            return (0.0, 1.0);
        }
        let n = f64::from(self.runs);
        let p = f64::from(self.successes) / n;
        let middle = (p + Z * Z / (2.0 * n)) / (1.0 + Z * Z / n);
        let half = Z / (1.0 + Z * Z / n) * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
        ((middle - half).max(0.0), (middle + half).min(1.0))
    }
}

/// Draws the share of successful runs against the strides that each was given.
///
/// # Errors
///
/// [`ReportError::Empty`](crate::ReportError::Empty) if there is no entry.
pub fn success_against_strides(rates: &[SuccessRate]) -> Result<Figure> {
    let stem = "success";
    some(stem, "no run", rates.len())?;
    let mut sorted = rates.to_vec();
    sorted.sort_by_key(|r| r.strides);
    let last = f64::from(sorted[sorted.len() - 1].strides);
    let mut sheet = Sheet::new(stem, "How many strides it takes");
    let mut p = sheet.single(
        260.0,
        Axis::counting("strides on the robot (training and evaluation)", 0.0, last * 1.06),
        Axis::linear("runs that succeed (%)", 0.0, 104.0),
    );
    let share = |r: &SuccessRate| 100.0 * f64::from(r.successes) / f64::from(r.runs.max(1));
    let points: Vec<(f64, f64)> = sorted.iter().map(|r| (f64::from(r.strides), share(r))).collect();
    let bars: Vec<_> =
        sorted.iter().map(|r| (f64::from(r.strides), 100.0 * r.wilson().0, 100.0 * r.wilson().1)).collect();
    p.across(95.0, "ref", Dash::Dotted);
    p.error_bars(&bars, "s0", 4.0);
    p.line(&points, "s0", Dash::Solid, 2.0);
    p.marks(&points, "s0", Mark::Disc, 4.4);
    let mut csv = String::from("strides,successes,runs,share,wilson_low,wilson_high\n");
    for (r, (x, y)) in sorted.iter().zip(&points) {
        let (lo, hi) = r.wilson();
        p.hover(
            *x,
            *y,
            format!(
                "{} strides: {} of {} runs, {} to {} %",
                r.strides,
                r.successes,
                r.runs,
                number(100.0 * lo, 3),
                number(100.0 * hi, 3)
            ),
        );
        csv.push_str(&format!("{},{},{},{},{lo},{hi}\n", r.strides, r.successes, r.runs, y / 100.0));
    }
    p.key("share of runs, 95 % Wilson interval", Key::Both("s0", Dash::Solid, Mark::Disc));
    p.key("95 %", Key::Line("ref", Dash::Dotted));
    sheet.add(p);
    let each: Vec<String> = sorted.iter().map(|r| format!("{} of {} at {}", r.successes, r.runs, r.strides)).collect();
    let caption = format!(
        "Share of runs, one per seed, that meet every criterion of the task, against the strides on the robot that each run was given: {}. Bars: \
         Wilson's 95 % interval. The paper uses 20 strides, 5 runs.",
        each.join(", ")
    );
    let alt = format!("Share of successful runs against strides: {}.", each.join(", "));
    Ok(sheet.finish(&caption, &alt, csv))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilson_agrees_with_the_textbook() {
        // 0 of 10: upper bound z² / (n + z²) = 0.2775; 10 of 10 mirrors it.
        let none = SuccessRate { strides: 20, successes: 0, runs: 10 };
        assert!((none.wilson().1 - 0.277_5).abs() < 1e-4 && none.wilson().0.abs() < 1e-12);
        let all = SuccessRate { strides: 20, successes: 10, runs: 10 };
        assert!((all.wilson().0 - 0.722_5).abs() < 1e-4);
    }
}
