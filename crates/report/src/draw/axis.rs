//! An axis: range, scale, ticks, label with unit.

use super::text::number;

/// How values are laid along an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Scale {
    /// Evenly.
    Linear,
    /// Evenly within `±linear`, by decades outside: `sign(v) (1 + log10(|v| / linear))`.
    SymLog {
        /// Half width of the even part, in the axis' unit.
        linear: f64,
    },
}

impl Scale {
    fn forward(self, v: f64) -> f64 {
        match self {
            Scale::Linear => v,
            Scale::SymLog { linear } if v.abs() <= linear => v / linear,
            Scale::SymLog { linear } => v.signum() * (1.0 + (v.abs() / linear).log10()),
        }
    }
}

/// An axis with its ticks.
#[derive(Clone, Debug)]
pub(crate) struct Axis {
    pub(crate) label: String,
    pub(crate) min: f64,
    pub(crate) max: f64,
    pub(crate) scale: Scale,
    /// Value and label of each tick.
    pub(crate) ticks: Vec<(f64, String)>,
}

/// A step of 1, 2 or 5 times a power of ten that cuts `span` into at most `most` parts.
fn nice_step(span: f64, most: f64) -> f64 {
    let raw = span / most;
    let power = 10f64.powf(raw.log10().floor());
    let candidates = [1.0, 2.0, 5.0, 10.0];
    candidates.iter().map(|m| m * power).find(|s| *s >= raw * (1.0 - 1e-9)).unwrap_or(10.0 * power)
}

impl Axis {
    /// An even axis from `min` to `max` with ticks at round numbers.
    pub(crate) fn linear(label: &str, min: f64, max: f64) -> Axis {
        Self::linear_with(label, min, max, 7.0)
    }

    /// The same with about `most` intervals at most.
    pub(crate) fn linear_with(label: &str, min: f64, max: f64, most: f64) -> Axis {
        let (min, max) = if max > min { (min, max) } else { (min - 0.5, min + 0.5) };
        let step = nice_step(max - min, most);
        let first = (min / step - 1e-9).ceil() as i64;
        let last = (max / step + 1e-9).floor() as i64;
        let decimals = (-step.log10().floor()).max(0.0) as usize;
        let ticks = (first..=last)
            .map(|i| {
                let v = i as f64 * step;
                (v, super::signed(v, decimals))
            })
            .collect();
        Axis { label: label.to_owned(), min, max, scale: Scale::Linear, ticks }
    }

    /// An even axis that shows every finite value, with 4 % of air at both ends.
    pub(crate) fn covering(label: &str, values: impl IntoIterator<Item = f64>) -> Axis {
        let (lo, hi) = extent(values);
        let air = 0.04 * if hi > lo { hi - lo } else { 1.0 };
        Self::linear(label, lo - air, hi + air)
    }

    /// Whole-numbered ticks only, for counts.
    pub(crate) fn counting(label: &str, min: f64, max: f64) -> Axis {
        let mut axis = Self::linear_with(label, min, max, 8.0);
        axis.ticks.retain(|(v, _)| (v - v.round()).abs() < 1e-9);
        for (v, text) in &mut axis.ticks {
            *text = super::signed(*v, 0);
        }
        axis
    }

    /// A symmetric-logarithmic axis with a tick at zero and at each decade.
    pub(crate) fn symlog(label: &str, min: f64, max: f64, linear: f64) -> Axis {
        let mut ticks = Vec::new();
        let mut decade = linear;
        while decade <= min.abs().max(max.abs()) * (1.0 + 1e-9) {
            for v in [-decade, decade] {
                if v >= min * (1.0 + 1e-9) && v <= max {
                    ticks.push((v, number(v, 1)));
                }
            }
            decade *= 10.0;
        }
        if min <= 0.0 && max >= 0.0 {
            ticks.push((0.0, "0".to_owned()));
        }
        ticks.sort_by(|a, b| a.0.total_cmp(&b.0));
        Axis { label: label.to_owned(), min, max, scale: Scale::SymLog { linear }, ticks }
    }

    /// Where a value lies, 0 at `min`, 1 at `max`.
    pub(crate) fn fraction(&self, v: f64) -> f64 {
        let (lo, hi) = (self.scale.forward(self.min), self.scale.forward(self.max));
        (self.scale.forward(v) - lo) / (hi - lo)
    }
}

/// Least and greatest of the finite values; `(0, 1)` if there are none.
pub(crate) fn extent(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let (mut lo, mut hi) = (f64::INFINITY, f64::NEG_INFINITY);
    for v in values.into_iter().filter(|v| v.is_finite()) {
        lo = lo.min(v);
        hi = hi.max(v);
    }
    if lo.is_finite() { (lo, hi) } else { (0.0, 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let labels = |a: &Axis| a.ticks.iter().map(|t| t.1.clone()).collect::<Vec<_>>();
        assert_eq!(labels(&Axis::linear("", 0.0, 6.0)), ["0", "1", "2", "3", "4", "5", "6"]);
        assert_eq!(labels(&Axis::linear("", -0.13, 0.31)), ["\u{2212}0.1", "0.0", "0.1", "0.2", "0.3"]);
        assert_eq!(
            labels(&Axis::symlog("", -1.0, 0.0, 0.001)),
            ["\u{2212}1", "\u{2212}0.1", "\u{2212}0.01", "\u{2212}0.001", "0"]
        );
    }

    #[test]
    fn symlog_gives_every_decade_the_same_room() {
        let axis = Axis::symlog("", -1.0, 0.0, 0.01);
        let f = |v| axis.fraction(v);
        assert!((f(-0.1) - f(-1.0) - (f(-0.01) - f(-0.1))).abs() < 1e-12);
        assert!((f(0.0) - f(-0.01) - (f(-0.01) - f(-0.1))).abs() < 1e-12);
    }

    #[test]
    fn an_empty_or_flat_range_still_has_an_axis() {
        assert!(Axis::covering("", [2.0, 2.0]).max > 2.0);
        assert!(!Axis::covering("", []).ticks.is_empty());
    }
}
