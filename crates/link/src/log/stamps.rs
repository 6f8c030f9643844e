//! Stamps of a log: clocks that differ, and clocks that jitter.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use super::{Entry, Kind, SENSORS};

/// Stamps of two sensors that are this far apart as their messages are logged come from two clocks: no message
/// is on its way for so long.
pub(super) const TWO_CLOCKS_NS: u64 = 200_000_000;
/// Messages by which clocks are compared.
const CLOCK_MESSAGES: usize = 64;
/// Neighbours on either side by which the tick of a sensor's clock is found.
const NEIGHBOURS: usize = 100;
/// Fewer messages than this tell no tick.
const FEWEST: usize = 20;
/// Stamps that are off their tick by less than this share of it stay as they are.
const EVEN: f64 = 0.05;
/// Half a period off belongs to either tick.
const MOST: f64 = 0.48;

/// Puts stamps that jitter about an even tick on it, sensor by sensor: velocities and sections are differences
/// of neighbours. A stretch of stamps ends where they jump by `gap_s`; it stays as it is where it has no tick
/// (more than half a period of jitter, or messages that come when they like). By how much a sensor's stamps
/// were moved at most, in seconds.
pub(super) fn even_out(entries: &mut [Entry], gap_s: f64) -> BTreeMap<Kind, f64> {
    let mut moved = BTreeMap::new();
    for kind in SENSORS {
        let at: Vec<(usize, u64)> = (entries.iter().enumerate())
            .filter(|(_, e)| e.kind == kind)
            .filter_map(|(i, e)| Some((i, e.stamp_ns?)))
            .collect();
        let jumps = |a: &(usize, u64), b: &(usize, u64)| a.1.abs_diff(b.1) as f64 <= 1e9 * gap_s;
        for stretch in at.chunk_by(jumps) {
            let mut stamps: Vec<u64> = stretch.iter().map(|(_, stamp)| *stamp).collect();
            stamps.sort_unstable();
            stamps.dedup();
            let Some((even, most_ns)) = even(&stamps) else {
                continue;
            };
            for (entry, stamp) in stretch {
                let place = stamps.binary_search(stamp).ok();
                entries[*entry].stamp_ns = place.and_then(|k| even.get(k).copied());
            }
            let most_s: &mut f64 = moved.entry(kind).or_default();
            *most_s = most_s.max(most_ns / 1e9);
        }
    }
    moved
}

/// Stamps on their tick, and how far they were from it at most; `None` if they are even, or have none.
fn even(stamps: &[u64]) -> Option<(Vec<u64>, f64)> {
    let n = stamps.len();
    if n < FEWEST {
        return None;
    }
    // The tick's length, over many periods (jitter counts little) and over few (few lack a message).
    let spans = [NEIGHBOURS, NEIGHBOURS / 3, NEIGHBOURS / 10].map(|span| span.min(n / 4));
    let tries = spans.map(|span| {
        let mut lengths: Vec<u64> = stamps.windows(span + 1).map(|w| w[span] - w[0]).collect();
        lengths.sort_unstable();
        let period_ns = lengths[lengths.len() / 2] as f64 / span as f64;
        let (off, together) = off_tick(stamps, period_ns);
        (period_ns, off, together)
    });
    let (period_ns, off, _) = tries.into_iter().max_by(|a, b| a.2.total_cmp(&b.2))?;
    let most_ns = off.iter().map(|off_ns| off_ns.abs()).fold(0.0, f64::max);
    let moved = stamps.iter().zip(&off);
    let even: Vec<u64> = moved.map(|(stamp, off_ns)| stamp.saturating_add_signed(*off_ns as i64)).collect();
    let apart = |w: &[u64]| w[1] as f64 - w[0] as f64 > 0.5 * period_ns;
    let jitters = most_ns > EVEN * period_ns && most_ns < MOST * period_ns;
    (jitters && even.windows(2).all(apart)).then_some((even, most_ns))
}

/// How far each stamp is before its tick, in nanoseconds: the tick's phase is the circular mean over the
/// neighbours. And how well they agree on it.
fn off_tick(stamps: &[u64], period_ns: f64) -> (Vec<f64>, f64) {
    let n = stamps.len();
    let turns = |stamp: u64| TAU * (((stamp - stamps[0]) as f64 / period_ns) % 1.0);
    let mut sums = vec![(0.0, 0.0)];
    for (k, stamp) in stamps.iter().enumerate() {
        let (sin, cos) = turns(*stamp).sin_cos();
        sums.push((sums[k].0 + cos, sums[k].1 + sin));
    }
    let mut together = 0.0;
    let off = stamps.iter().enumerate().map(|(k, stamp)| {
        let from = k.saturating_sub(NEIGHBOURS).min(n.saturating_sub(2 * NEIGHBOURS));
        let to = n.min(from + 2 * NEIGHBOURS + 1);
        let (cos, sin) = (sums[to].0 - sums[from].0, sums[to].1 - sums[from].1);
        together += cos.hypot(sin);
        let turn = ((sin.atan2(cos) - turns(*stamp)) / TAU + 0.5).rem_euclid(1.0) - 0.5;
        (turn * period_ns).round()
    });
    (off.collect(), together)
}

/// By how much each sensor's clock is ahead of the joint states', where that is too much to be the way to the
/// recorder: judged by when the episode's first messages were logged.
pub(super) fn clocks(entries: &[Entry]) -> BTreeMap<Kind, i128> {
    let until = entries.iter().position(|e| e.kind == Kind::Episode);
    let entries = &entries[..until.unwrap_or(entries.len())];
    let ahead_of_log = |kind: Kind| {
        let mut ahead: Vec<i128> = entries
            .iter()
            .filter(|e| e.kind == kind)
            .filter_map(|e| Some(i128::from(e.stamp_ns?) - i128::from(e.log_time_ns)))
            .take(CLOCK_MESSAGES)
            .collect();
        // A clock that stands tells nothing.
        let of = |e: &&Entry| e.kind == kind && e.stamp_ns != Some(0);
        if !entries.iter().any(|e| of(&e)) {
            return None;
        }
        ahead.sort_unstable();
        ahead.get(ahead.len() / 2).copied()
    };
    let Some(joints) = ahead_of_log(Kind::Joints) else {
        return BTreeMap::new();
    };
    let others = SENSORS.into_iter().filter(|kind| *kind != Kind::Joints);
    others
        .filter_map(|kind| Some((kind, ahead_of_log(kind)? - joints)))
        .filter(|(_, ahead)| ahead.unsigned_abs() > u128::from(TWO_CLOCKS_NS))
        .collect()
}
