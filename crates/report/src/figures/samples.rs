//! How many strides a map needs: prediction error and speed against the number of samples.

use super::check::{column, some};
use crate::draw::{Axis, Dash, Key, Mark, Sheet, number, plural, signed};
use crate::error::Result;
use crate::figure::Figure;

/// What one seed made of one number of samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SamplesPoint {
    /// Strides from which the map was learned.
    pub samples: u32,
    /// Root of the run's random streams.
    pub seed: u64,
    /// One-step prediction error: leave one out, root mean square over the spread of the data, the
    /// largest over the components of the state.
    pub error: f64,
    /// The same on strides of an exploration that the map has not seen, over their spread.
    pub unseen_error: f64,
    /// Speed of the policy learned from them, m/s; `None` where no policy was proven.
    pub speed_m_s: Option<f64>,
    /// Falls while learning it.
    pub falls: u32,
}

/// Median of finite numbers; NaN of none.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    match n {
        0 => f64::NAN,
        _ if n % 2 == 1 => values[n / 2],
        _ => 0.5 * (values[n / 2 - 1] + values[n / 2]),
    }
}

/// Draws prediction error and speed against the number of samples: every seed a point, medians a line.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if there is no point or a value is not finite.
pub fn samples(points: &[SamplesPoint]) -> Result<Figure> {
    let stem = "samples";
    some(stem, "points", points.len())?;
    let mut errors: Vec<f64> = points.iter().map(|p| p.error).collect();
    column(stem, "error", &errors, points.len())?;
    errors.extend(points.iter().map(|p| p.unseen_error));
    column(stem, "unseen_error", &errors, 2 * points.len())?;
    let speeds: Vec<f64> = points.iter().filter_map(|p| p.speed_m_s).collect();
    column(stem, "speed_m_s", &speeds, speeds.len())?;
    let mut counts: Vec<u32> = points.iter().map(|p| p.samples).collect();
    counts.sort_unstable();
    counts.dedup();
    let most = f64::from(counts[counts.len() - 1]);
    // Samples by their logarithm: what ten more are worth falls with their number.
    let place = |n: u32| f64::from(n).log2();
    let (first, last) = (place(counts[0]), place(counts[counts.len() - 1]));
    let x = || {
        let mut axis = Axis::linear("samples", first - 0.3, last + 0.3);
        axis.ticks = counts.iter().map(|n| (place(*n), n.to_string())).collect();
        axis
    };
    let from_zero = |label: &str, values: &[f64]| Axis::covering(label, values.iter().copied().chain([0.0]));
    let of = |n: u32, value: &dyn Fn(&SamplesPoint) -> Option<f64>| -> Vec<f64> {
        let own = points.iter().filter(|p| p.samples == n);
        own.filter_map(value).collect()
    };
    let error = |p: &SamplesPoint| Some(p.error);
    let unseen = |p: &SamplesPoint| Some(p.unseen_error);
    let speed = |p: &SamplesPoint| p.speed_m_s;
    let mut sheet = Sheet::new(stem, "How many strides does a map of walking need?");
    let panels = sheet.row(
        260.0,
        vec![
            (1.0, x(), from_zero("prediction error (share of the spread)", &errors), None),
            (1.0, x(), from_zero("speed of the policy (m/s)", &speeds), None),
        ],
    );
    type Value<'a> = &'a dyn Fn(&SamplesPoint) -> Option<f64>;
    let series: [(usize, Value<'_>, &str, Dash, Mark, &str); 3] = [
        (0, &unseen, "s2", Dash::Dashed, Mark::Diamond, "error on unseen strides"),
        (0, &error, "s1", Dash::Solid, Mark::Dot, "error, leaving one out"),
        (1, &speed, "s0", Dash::Solid, Mark::Dot, "speed"),
    ];
    for (i, mut p) in panels.into_iter().enumerate() {
        for (_, value, class, dash, mark, name) in series.iter().filter(|s| s.0 == i) {
            let medians: Vec<(f64, f64)> = counts.iter().map(|n| (place(*n), median(of(*n, value)))).collect();
            p.line(&medians, class, *dash, 2.2);
            let seeds: Vec<(f64, f64)> = points.iter().filter_map(|q| Some((place(q.samples), value(q)?))).collect();
            let size = if *mark == Mark::Dot { 4.0 } else { 2.8 };
            p.marks(&seeds, class, *mark, size);
            for q in points {
                if let Some(v) = value(q) {
                    p.hover(
                        place(q.samples),
                        v,
                        format!(
                            "{name}, {} samples, seed {}: {}, {}",
                            q.samples,
                            q.seed,
                            signed(v, 3),
                            plural(q.falls as usize, "fall")
                        ),
                    );
                }
            }
            p.key(name, Key::Both(class, *dash, *mark));
        }
        sheet.add(p);
    }
    let said: Vec<String> = counts
        .iter()
        .map(|n| {
            format!(
                "{n}: {} and {}, {} m/s",
                number(median(of(*n, &error)), 2),
                number(median(of(*n, &unseen)), 2),
                signed(median(of(*n, &speed)), 3)
            )
        })
        .collect();
    let falls: u32 = points.iter().map(|p| p.falls).sum();
    let seeds = points.iter().filter(|p| p.samples == counts[0]).count();
    let caption = format!(
        "Sec. 8.1 of the paper asks how many samples a map needs. Left: one-step prediction error of the map learned from so many \
         strides of exploration, root mean square over the spread of the data, the worst component of the state: leaving one out, \
         and on the strides of another exploration that no map has seen. \
         Right: speed over up to 60 s of the policy learned from them and proven on the robot. Points: n = {seeds} seeds; lines: \
         medians ({}). {} in {} runs. Horizontal axis logarithmic, up to {} samples.",
        said.join("; "),
        plural(falls as usize, "fall"),
        points.len(),
        number(most, 4)
    );
    let mut csv = String::from("samples,seed,error,unseen_error,speed_m_s,falls\n");
    for p in points {
        let speed = p.speed_m_s.map_or_else(String::new, |v| v.to_string());
        csv.push_str(&format!("{},{},{},{},{speed},{}\n", p.samples, p.seed, p.error, p.unseen_error, p.falls));
    }
    let alt = format!("Two plots against the number of samples, medians of error and speed: {}.", said.join("; "));
    Ok(sheet.finish(&caption, &alt, csv))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_seed_is_a_point_and_the_caption_has_the_medians() {
        let point = |samples, seed, error, speed_m_s| SamplesPoint {
            samples,
            seed,
            error,
            unseen_error: 1.0,
            speed_m_s,
            falls: u32::from(seed == 2),
        };
        let points = [
            point(20, 1, 0.8, Some(0.1)),
            point(20, 2, 1.0, None),
            point(200, 1, 0.2, Some(0.4)),
            point(200, 2, 0.4, Some(0.5)),
        ];
        let figure = samples(&points).unwrap();
        assert!(
            figure.caption.contains("(20: 0.9 and 1, 0.100 m/s; 200: 0.3 and 1, 0.450 m/s). 2 falls in 4 runs"),
            "{}",
            figure.caption
        );
        assert_eq!(figure.csv.lines().count(), 5);
        assert!(figure.csv.contains("\n20,2,1,1,,1\n"));
        // Four errors by leaving one out and three speeds, and one of either in the legend.
        assert_eq!(figure.svg.matches("<circle").count(), 7 + 2);
        assert!(samples(&[]).is_err());
    }
}
