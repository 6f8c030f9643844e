//! What comes on one topic, in order of its stamps.

use std::collections::BTreeMap;

use stridemap_robot::RobotError;

use crate::messages::Header;

/// Messages of a topic under way; more, and another sensor is silent.
pub(crate) const MOST_UNDER_WAY: usize = 64;
/// Stamps of 0 in a row that no simulated clock begins with.
const ZEROS_IN_A_ROW: u32 = 5;

/// Why a message or a reading cannot be used.
#[derive(Clone, Debug)]
pub(crate) enum Unusable {
    /// In words.
    Said(String),
    /// The robot has other joints.
    Map(RobotError),
}

impl std::fmt::Display for Unusable {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Said(what) => f.write_str(what),
            Self::Map(error) => error.fmt(f),
        }
    }
}

pub(crate) fn said(what: impl Into<String>) -> Unusable {
    Unusable::Said(what.into())
}

pub(crate) fn seconds(ns: u64) -> f64 {
    ns as f64 / 1e9
}

/// Who sends on a topic: the writer (or the log's channel), and the frame it names.
type Source = (u128, String);

/// What has come on one topic, by stamp.
#[derive(Clone, Debug)]
pub(crate) struct Stream<T> {
    pub topic: String,
    pub what: &'static str,
    pub parts: BTreeMap<u64, T>,
    source: Option<Source>,
    superseded: Vec<Source>,
    zeros: u32,
    heard: u64,
    oldest_ns: u64,
    pub newest_ns: Option<u64>,
    /// The smallest distance from a joint state that found no partner here; none once one did.
    apart_ns: Option<u64>,
    paired: bool,
}

impl<T: PartialEq> Stream<T> {
    pub fn new(topic: &str, what: &'static str) -> Self {
        Self {
            topic: topic.to_owned(),
            what,
            parts: BTreeMap::new(),
            source: None,
            superseded: Vec::new(),
            zeros: 0,
            heard: 0,
            oldest_ns: u64::MAX,
            newest_ns: None,
            apart_ns: None,
            paired: false,
        }
    }

    pub fn clear(&mut self) {
        self.parts.clear();
        self.source = None;
        self.superseded.clear();
        self.zeros = 0;
    }

    pub fn begin_anew(&mut self) {
        *self = Self::new(&self.topic, self.what);
    }

    /// One publisher may take over from another; two that take turns are refused.
    fn check_source(&mut self, source: u128, header: &Header) -> Result<(), Unusable> {
        let same = |s: &Source| s.0 == source && s.1 == header.frame_id;
        if self.source.as_ref().is_some_and(same) {
            return Ok(());
        }
        if self.superseded.iter().any(same) {
            let other = self.source.as_ref().map_or("", |s| s.1.as_str());
            return Err(said(format!(
                "two publishers on {} (frames {other:?} and {:?}): only one of them is the robot",
                self.topic, header.frame_id
            )));
        }
        let new = (source, header.frame_id.clone());
        self.superseded.extend(self.source.replace(new));
        Ok(())
    }

    /// Takes a message in; whether it is new. One that comes twice is not.
    pub fn take(&mut self, source: u128, header: &Header, value: T) -> Result<bool, Unusable> {
        let stamp = header.stamp.nanoseconds();
        self.heard += 1;
        self.oldest_ns = self.oldest_ns.min(stamp);
        self.newest_ns = Some(self.newest_ns.map_or(stamp, |newest| newest.max(stamp)));
        self.check_source(source, header)?;
        if header.stamp.sec < 0 {
            return Err(said(format!(
                "the stamps of {} are before 0 ({:.3} s): its publisher's clock is not set",
                self.topic,
                header.stamp.seconds()
            )));
        }
        self.zeros = if stamp == 0 { self.zeros + 1 } else { 0 };
        let before = self.parts.get(&stamp);
        let differs = before.is_some_and(|before| *before != value);
        let taken_over = !self.superseded.is_empty();
        if self.zeros >= ZEROS_IN_A_ROW || (stamp == 0 && differs && !taken_over) {
            return Err(said(format!(
                "the stamps of {} are all 0: its publisher has to fill header.stamp",
                self.topic
            )));
        }
        if differs {
            return Err(said(format!(
                "two different messages on {} have the stamp {:.3} s: two publishers, or a clock that stands",
                self.topic,
                seconds(stamp)
            )));
        }
        let new = before.is_none();
        if new {
            self.parts.insert(stamp, value);
        }
        while self.parts.len() > MOST_UNDER_WAY {
            self.parts.pop_first();
        }
        Ok(new)
    }

    /// The stamp nearest to this one, and how far it is.
    fn nearest(&self, stamp: u64) -> Option<(u64, u64)> {
        let before = self.parts.range(..=stamp).next_back();
        let after = self.parts.range(stamp..).next();
        let both = before.into_iter().chain(after);
        both.map(|(at, _)| (*at, at.abs_diff(stamp))).min_by_key(|(_, apart)| *apart)
    }

    /// The partner of a joint state, and whether no nearer one can come.
    pub fn partner(&mut self, stamp: u64, within: u64) -> Option<(u64, bool)> {
        let (at, apart) = self.nearest(stamp)?;
        if apart > within {
            self.apart_ns = Some(self.apart_ns.map_or(apart, |least| least.min(apart)));
            return None;
        }
        self.paired = true;
        Some((at, self.parts.keys().next_back() >= Some(&stamp)))
    }

    /// Whether it is heard, but not with stamps that are those of any joint state.
    pub fn never_pairs(&self) -> bool {
        self.apart_ns.is_some() && !self.paired
    }

    /// Whether what would be the partner of a joint state has not come though later ones have.
    pub fn is_past(&self, stamp: u64, within: u64) -> bool {
        self.parts.keys().next_back() > Some(&(stamp.saturating_add(within)))
    }

    pub fn forget_before(&mut self, stamp: u64) {
        self.parts = self.parts.split_off(&stamp);
    }

    /// What was heard here: count, rate, and, of a sensor that was never paired, how far its stamps are off.
    pub fn tally(&self) -> String {
        let span_s = self.newest_ns.map_or(0.0, |newest| seconds(newest.saturating_sub(self.oldest_ns)));
        let rate = match (self.heard, span_s > 0.0) {
            (0 | 1, _) => String::new(),
            (_, false) => ", all with one stamp".into(),
            (n, true) => format!(", {:.1} a second", (n - 1) as f64 / span_s),
        };
        let apart = self.apart_ns.filter(|_| !self.paired).map(seconds);
        let apart =
            apart.map_or_else(String::new, |s| format!(", stamps never nearer than {s:.4} s to the joint states'"));
        format!("{} {}{rate}{apart}", self.topic, self.heard)
    }
}
