//! How many strides a map needs: prediction error and speed against the number of samples.

use super::check::{column, some};
use super::seeds::quartiles;
use crate::draw::{Axis, Dash, Key, Mark, N, Panel, Sheet, plural};
use crate::error::Result;
use crate::figure::Figure;

/// What one seed made of one number of samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SamplesPoint {
    /// Strides from which the map was learned.
    pub samples: usize,
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
    pub falls: usize,
}

/// Samples by their logarithm: what ten more are worth falls with their number.
fn place(n: usize) -> f64 {
    (n as f64).log2()
}

/// What is drawn of every point, and in which panel.
struct Series {
    panel: usize,
    name: &'static str,
    value: fn(&SamplesPoint) -> Option<f64>,
    class: &'static str,
    dash: Dash,
    mark: Mark,
}

const SERIES: [Series; 3] = [
    Series {
        panel: 0,
        name: "error on unseen strides",
        value: |p| Some(p.unseen_error),
        class: "s2",
        dash: Dash::Dashed,
        mark: Mark::Diamond,
    },
    Series {
        panel: 0,
        name: "error, leaving one out",
        value: |p| Some(p.error),
        class: "s1",
        dash: Dash::Solid,
        mark: Mark::Dot,
    },
    Series { panel: 1, name: "speed", value: |p| p.speed_m_s, class: "s0", dash: Dash::Solid, mark: Mark::Dot },
];

impl Series {
    /// Median over the seeds; NaN of none.
    fn median(&self, points: &[SamplesPoint], samples: usize) -> f64 {
        let own = points.iter().filter(|p| p.samples == samples).filter_map(self.value);
        quartiles(&own.collect::<Vec<_>>()).map_or(f64::NAN, |quartiles| quartiles[1])
    }

    /// Every seed a point, the medians a line.
    fn draw(&self, p: &mut Panel, points: &[SamplesPoint], counts: &[usize]) {
        let medians: Vec<(f64, f64)> = counts.iter().map(|n| (place(*n), self.median(points, *n))).collect();
        p.line(&medians, self.class, self.dash, 2.2);
        let seeds: Vec<_> = points.iter().filter_map(|q| Some((q, (self.value)(q)?))).collect();
        let at: Vec<(f64, f64)> = seeds.iter().map(|(q, v)| (place(q.samples), *v)).collect();
        p.marks(&at, self.class, self.mark, if self.mark == Mark::Dot { 4.0 } else { 2.8 });
        for (q, v) in seeds {
            let (name, samples, seed, falls) = (self.name, q.samples, q.seed, plural(q.falls, "fall"));
            p.hover(place(samples), v, format!("{name}, {samples} samples, seed {seed}: {:.3}, {falls}", N(v)));
        }
        p.key(self.name, Key::Both(self.class, self.dash, self.mark));
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
    for series in &SERIES {
        let values: Vec<f64> = points.iter().filter_map(series.value).collect();
        column(stem, series.name, &values, values.len())?;
    }
    let mut counts: Vec<usize> = points.iter().map(|p| p.samples).collect();
    counts.sort_unstable();
    counts.dedup();
    let (fewest, most) = (counts[0], counts[counts.len() - 1]);
    let mut x = Axis::linear("samples", place(fewest) - 0.3, place(most) + 0.3);
    x.ticks = counts.iter().map(|n| (place(*n), n.to_string())).collect();
    let mut sheet = Sheet::new(stem, "How many strides does a map of walking need?");
    let panel = |i: usize, label: &str| {
        let values = SERIES.iter().filter(|s| s.panel == i).flat_map(|s| points.iter().filter_map(s.value));
        (1.0, x.clone(), Axis::covering(label, values.chain([0.0])), None)
    };
    let panels = vec![panel(0, "prediction error (share of the spread)"), panel(1, "speed of the policy (m/s)")];
    for (i, mut p) in sheet.row(260.0, panels).into_iter().enumerate() {
        SERIES.iter().filter(|s| s.panel == i).for_each(|s| s.draw(&mut p, points, &counts));
        sheet.add(p);
    }
    let said = |n: &usize| {
        let [unseen, error, speed] = SERIES.each_ref().map(|s| N(s.median(points, *n)));
        format!("{n}: {error:#.2} and {unseen:#.2}, {speed:.3} m/s")
    };
    let said = counts.iter().map(said).collect::<Vec<_>>().join("; ");
    let falls = plural(points.iter().map(|p| p.falls).sum(), "fall");
    let (seeds, runs) = (points.iter().filter(|p| p.samples == fewest).count(), points.len());
    let caption = format!(
        "Sec. 8.1 of the paper asks how many samples a map needs. Left: one-step prediction error of the map learned from so many \
         strides of exploration, root mean square over the spread of the data, the worst component of the state: leaving one out, \
         and on the strides of another exploration that no map has seen. \
         Right: speed over up to 60 s of the policy learned from them and proven on the robot. Points: n = {seeds} seeds; lines: \
         medians ({said}). {falls} in {runs} runs. Horizontal axis logarithmic, up to {most} samples."
    );
    let mut csv = String::from("samples,seed,error,unseen_error,speed_m_s,falls\n");
    for p in points {
        let speed = p.speed_m_s.map_or_else(String::new, |v| v.to_string());
        csv += &format!("{},{},{},{},{speed},{}\n", p.samples, p.seed, p.error, p.unseen_error, p.falls);
    }
    let alt = format!("Two plots against the number of samples, medians of error and speed: {said}.");
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
            falls: usize::from(seed == 2),
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
