//! May a policy be deployed, and is one worse than another? Numbers with intervals against limits.

use stridemap_record::{Judged, PushAtlas, Ruling};

use crate::learners::paired_difference;
use crate::walks::{Interval, Walked, distinct, share_of};

/// What is judged: name, words, unit.
pub type What = (&'static str, &'static str, &'static str);

/// Everything that is judged.
pub mod what {
    use super::What;

    /// The probability of a fall.
    pub const FALLS: What = ("fall_probability_60_s", "probability of a fall within 60 s", "");
    /// The tracking error.
    pub const TRACKING: What = ("tracking_error", "tracking error (root mean square)", "");
    /// The largest multiplier.
    pub const MULTIPLIER: What =
        ("largest_multiplier", "largest multiplier (what is left of a disturbance a stride on)", "");
    /// The smallest push survived.
    pub const PUSH: What = ("survived_push_m_s", "smallest push survived over phases and directions", "m/s");
    /// The speed.
    pub const SPEED: What = ("speed_m_s", "speed", "m/s");
}

/// A number, or why there is none, against its limit.
#[must_use]
pub fn judged(
    (name, about, unit): What,
    found: Result<Interval, String>,
    (limit, at_most): (f64, bool),
    because: &str,
    (strides, seed): (usize, u64),
) -> Judged {
    let known = found.as_ref().ok();
    let ruling = known.map_or(Ruling::CannotTell, |k| {
        let interval = (k.low, k.high);
        if at_most { Ruling::at_most(limit, interval) } else { Ruling::at_least(limit, interval) }
    });
    Judged {
        name: name.into(),
        about: about.into(),
        unit: unit.into(),
        value: known.map(|k| k.value),
        low: known.map(|k| k.low),
        high: known.map(|k| k.high),
        limit,
        at_most,
        ruling,
        because: found.as_ref().err().cloned().unwrap_or_else(|| because.into()),
        strides,
        seed,
    }
}

/// Falls in walks of a minute.
#[must_use]
pub fn judged_falls(walks: &[Walked], limit: f64, seed: u64) -> Judged {
    let different = distinct(walks);
    let fell = different.iter().filter(|w| w.fell).count();
    let n = different.len();
    let alike =
        if n < walks.len() { format!(", of {} walks that are all different", walks.len()) } else { String::new() };
    let because = format!("{fell} falls in {n} walks{alike}");
    let strides = walks.iter().map(|w| w.strides).sum();
    judged(what::FALLS, Ok(share_of(fell, n)), (limit, true), &because, (strides, seed))
}

/// Mean with Student's t interval of some numbers.
///
/// # Errors
///
/// In words, with fewer than two.
pub fn mean_of(values: &[f64]) -> Result<Interval, String> {
    let found = paired_difference(values, &vec![0.0; values.len()]);
    match (found.low, found.high) {
        (Some(low), Some(high)) => Ok(Interval { value: found.mean, low, high }),
        _ => Err(format!("{} walks that settled; at least 2 are needed", values.len())),
    }
}

/// The tracking error over walks that settled.
#[must_use]
pub fn judged_tracking(walks: &[Walked], (limit, of): (f64, &str), seed: u64) -> Judged {
    let errors: Vec<f64> = distinct(walks).iter().filter_map(|w| w.tracking).collect();
    let because = format!("{of}; mean over {} walks", errors.len());
    let strides = walks.iter().map(|w| w.strides).sum();
    judged(what::TRACKING, mean_of(&errors), (limit, true), &because, (strides, seed))
}

/// The smallest push survived: known to lie between what was survived and what was not.
#[must_use]
pub fn judged_push(atlas: &PushAtlas, limit: f64) -> Judged {
    let found = atlas.weakest().ok_or_else(|| "the push atlas has no cell".to_owned());
    let known = found.map(|of| Interval {
        value: of.smallest_m_s,
        low: of.smallest_m_s,
        high: of.smallest_fallen_m_s.unwrap_or(atlas.largest_m_s),
    });
    let because = format!("{} pushes of the push atlas; the interval is that of the bisection", atlas.trials);
    judged(what::PUSH, known, (limit, false), &because, (atlas.strides, atlas.seed))
}

/// Falls of B less those of A in walks from the same starts, as a difference of probabilities: paired, with the interval of
/// Bonett and Price (2012), which adds one to either kind of discordant pair.
///
/// # Example
///
/// Three walks of 40 in which only B falls:
///
/// ```
/// let mut pairs = vec![(false, false); 37];
/// pairs.extend([(false, true); 3]);
/// let d = stridemap_lab::fall_difference(&pairs);
/// assert!((d.value - 3.0 / 40.0).abs() < 1e-12);
/// let (b, c) = (4.0_f64 / 42.0, 1.0 / 42.0);
/// let half = 1.959964 * ((b + c - (b - c) * (b - c)) / 42.0).sqrt();
/// assert!((d.high - (b - c + half)).abs() < 1e-6);
/// ```
#[must_use]
pub fn fall_difference(pairs: &[(bool, bool)]) -> Interval {
    const NORMAL_95: f64 = 1.959_963_984_540_054;
    let n = pairs.len() as f64;
    let only_b = pairs.iter().filter(|(a, b)| !a && *b).count() as f64;
    let only_a = pairs.iter().filter(|(a, b)| *a && !b).count() as f64;
    let (b, c) = ((only_b + 1.0) / (n + 2.0), (only_a + 1.0) / (n + 2.0));
    let half = NORMAL_95 * ((b + c - (b - c).powi(2)) / (n + 2.0)).sqrt();
    let value = if n > 0.0 { (only_b - only_a) / n } else { 0.0 };
    Interval { value, low: (b - c - half).max(-1.0), high: (b - c + half).min(1.0) }
}

/// The difference of two numbers with intervals of their own, by the square-and-add rule of Zou and Donner (2008).
#[must_use]
pub fn difference(a: Interval, b: Interval) -> Interval {
    let value = b.value - a.value;
    Interval {
        value,
        low: value - (b.value - b.low).hypot(a.high - a.value),
        high: value + (b.high - b.value).hypot(a.value - a.low),
    }
}

/// Whether B is worse than A by a difference in the bad direction: no, if it is at most the margin; yes, if it is certainly above
/// zero and may exceed the margin; else it cannot be told.
#[must_use]
pub fn judged_worse(
    what: What,
    worse_by: Result<Interval, String>,
    margin: f64,
    because: &str,
    of: (usize, u64),
) -> Judged {
    let mut judged = judged(what, worse_by, (margin, true), because, of);
    if judged.ruling == Ruling::CannotTell && judged.low.is_some_and(|low| low > 0.0) {
        judged.ruling = Ruling::Fail;
    }
    judged.about = format!("{}: B worse than A by", judged.about);
    judged
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng;
    use rand_chacha::ChaCha8Rng;
    use rand_chacha::rand_core::SeedableRng;

    #[test]
    fn worse_is_what_is_certainly_above_zero_and_not_surely_within_the_margin() {
        let ruling = |low, high| {
            judged_worse(what::FALLS, Ok(Interval { value: 0.5 * (low + high), low, high }), 0.05, "", (0, 0)).ruling
        };
        assert_eq!(ruling(-0.1, 0.04), Ruling::Pass);
        assert_eq!(ruling(0.01, 0.04), Ruling::Pass, "worse, but by less than matters");
        assert_eq!(ruling(0.01, 0.2), Ruling::Fail);
        assert_eq!(ruling(-0.01, 0.2), Ruling::CannotTell);
        assert_eq!(judged_worse(what::FALLS, Err("no".into()), 0.05, "", (0, 0)).ruling, Ruling::CannotTell);
    }

    /// Intervals of paired falls hold the truth in 95 % of 2,000 comparisons of 60 walks; those of shares in at least as many.
    #[test]
    fn intervals_hold_the_truth() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let (a_falls, b_falls) = (0.05, 0.15);
        let (mut paired, mut alone) = (0, 0);
        for _ in 0..2000 {
            let pairs: Vec<(bool, bool)> =
                (0..60).map(|_| (rng.random::<f64>() < a_falls, rng.random::<f64>() < b_falls)).collect();
            let d = fall_difference(&pairs);
            paired += usize::from((d.low..=d.high).contains(&(b_falls - a_falls)));
            let b = share_of(pairs.iter().filter(|p| p.1).count(), 60);
            alone += usize::from((b.low..=b.high).contains(&b_falls));
        }
        assert!((1860..=1960).contains(&paired), "{paired}");
        assert!(alone >= 1900, "{alone}");
    }

    /// 1 and 3 with standard deviation √2: mean 2 ± 12.706 · 1.
    #[test]
    fn a_mean_has_the_interval_of_student() {
        let mean = mean_of(&[1.0, 3.0]).unwrap();
        assert!((mean.high - 2.0 - 12.706_204_736).abs() < 1e-6 && (mean.value - 2.0).abs() < 1e-12);
        assert!(mean_of(&[1.0]).is_err());
        let one = Interval { value: 1.0, low: 0.7, high: 1.4 };
        let d = difference(one, Interval { value: 2.0, low: 1.6, high: 2.3 });
        assert!(
            (d.low - (1.0 - 0.4_f64.hypot(0.4))).abs() < 1e-12 && (d.high - (1.0 + 0.3_f64.hypot(0.3))).abs() < 1e-12
        );
    }
}
