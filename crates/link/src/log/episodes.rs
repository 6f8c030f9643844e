//! The episodes of a log, made message by message.

use std::collections::BTreeMap;

use stridemap_robot::{BaseState, Ros2Config, SensorFrame};

use super::stamps::{self, TWO_CLOCKS_NS};
use super::{Entry, Kind, LogReport, LoggedAction, LoggedEpisode, Sorted};
use crate::assemble::LinkCounts;
use crate::assemble::{self, Assembler, Part, off_pace};
use crate::mcap_file::Findings;
use crate::messages::{Float64MultiArray, RosTime, from_cdr};
use crate::stream::Unusable;

/// An episode that is being read.
#[derive(Default)]
struct Open {
    began_ns: Option<u64>,
    frames: Vec<SensorFrame>,
    /// Stamps of joint states, and the actions after them.
    actions: Vec<(u64, Vec<f64>)>,
    sections: Vec<(u64, f64)>,
    /// Actions that were logged after the readings' end, and when.
    after_end: Vec<(u64, Box<[u8]>)>,
    newest_ns: Option<u64>,
    /// When the newest joint states were logged.
    logged_ns: u64,
    /// By how much each sensor's clock is ahead of the joint states'.
    ahead_ns: BTreeMap<Kind, i128>,
    end: Option<String>,
}

impl Open {
    /// Takes note of the next joint states; an error is why the episode ends before them.
    fn step(
        &mut self,
        part: &Part,
        log_time_ns: u64,
        link: &Ros2Config,
        assembler: &mut Assembler,
    ) -> Result<(), String> {
        let stamp = part.header().stamp.nanoseconds();
        match (self.newest_ns, self.began_ns) {
            (Some(newest), _) => {
                if let Some(gap) = assemble::gap(newest, stamp, link) {
                    let logged_ns = log_time_ns.saturating_sub(self.logged_ns);
                    let jumped = logged_ns.saturating_add(TWO_CLOCKS_NS) < stamp - newest;
                    let why = if jumped { " (its clock went on by itself)" } else { "" };
                    return Err(gap + why);
                }
            }
            (None, began) => {
                assembler.zero_ns = stamp;
                let after_ns = began.map_or(0, |began| log_time_ns.saturating_sub(began));
                let after_s = after_ns as f64 / 1e9;
                if after_s > link.gap_s {
                    return Err(format!("its first {after_s:.3} s are not in the log"));
                }
            }
        }
        self.newest_ns = Some(self.newest_ns.map_or(stamp, |newest| newest.max(stamp)));
        self.logged_ns = log_time_ns;
        Ok(())
    }
}

pub(super) struct EpisodeReader<'a> {
    link: &'a Ros2Config,
    period_s: f64,
    assembler: Assembler,
    counts: LinkCounts,
    pub report: LogReport,
    unreadable: BTreeMap<Kind, u64>,
    pub episodes: Vec<LoggedEpisode>,
    open: Option<Open>,
}

impl<'a> EpisodeReader<'a> {
    pub fn new(link: &'a Ros2Config, period_s: f64, assembler: Assembler) -> Self {
        Self {
            link,
            period_s,
            assembler,
            counts: LinkCounts::default(),
            report: LogReport::default(),
            unreadable: BTreeMap::new(),
            episodes: Vec::new(),
            open: None,
        }
    }

    pub fn begin(&mut self, entries: &[Entry], began_ns: Option<u64>) {
        self.finish();
        self.assembler.begin_anew();
        let ahead_ns = stamps::clocks(entries);
        for (kind, ahead) in &ahead_ns {
            let ahead_s = *ahead as f64 / 1e9;
            self.report.notes.push(format!(
                "episode {}: the clock of {} is {ahead_s:+.3} s from the joint states'; the two were brought \
                 together by when they were logged",
                self.episodes.len(),
                kind.about(self.link).0
            ));
        }
        self.open = Some(Open { began_ns, ahead_ns, ..Open::default() });
    }

    /// Takes the next message in; `from_here` are it and those that follow.
    pub fn take(&mut self, entry: &Entry, from_here: &[Entry]) {
        if entry.kind == Kind::Episode {
            // A start that is told twice is one.
            self.open.take_if(|open| open.newest_ns.is_none() && open.end.is_none());
            self.begin(&from_here[1..], Some(entry.log_time_ns));
            return;
        }
        let Some(open) = self.open.as_mut().filter(|open| open.end.is_none()) else {
            self.report.outside += 1;
            if let (Some(open), Kind::Action) = (&mut self.open, entry.kind) {
                let told = (entry.log_time_ns, entry.data.clone());
                open.after_end.retain(|before| *before != told);
                open.after_end.push(told);
            }
            return;
        };
        if matches!(entry.kind, Kind::Action | Kind::Section) {
            match (from_cdr::<Float64MultiArray>(&entry.data), open.newest_ns) {
                (Some(numbers), Some(newest)) if entry.kind == Kind::Action => {
                    open.actions.push((newest, numbers.data));
                }
                (Some(numbers), Some(newest)) => {
                    open.sections.extend(numbers.data.get(1).map(|psi_deg| (newest, *psi_deg)));
                }
                (Some(_), None) => self.report.outside += 1,
                (None, _) => *self.unreadable.entry(entry.kind).or_default() += 1,
            }
            return;
        }
        let Some(mut part) = entry.kind.read(&entry.data) else {
            *self.unreadable.entry(entry.kind).or_default() += 1;
            return;
        };
        if let Some(stamp) = entry.stamp_ns {
            let ahead = open.ahead_ns.get(&entry.kind).copied().unwrap_or(0);
            let stamp = u64::try_from(i128::from(stamp) - ahead).unwrap_or(0);
            part.header_mut().stamp = RosTime::from_nanoseconds(stamp);
        }
        if entry.kind == Kind::Joints
            && let Err(end) = open.step(&part, entry.log_time_ns, self.link, &mut self.assembler)
        {
            self.gather(false);
            if let Some(open) = &mut self.open {
                open.end.get_or_insert(end);
            }
            return;
        }
        let source = u128::from(entry.channel_id);
        if let Err(error) = self.assembler.push(part, source, &mut self.counts) {
            self.gather(false);
            if let Some(open) = &mut self.open {
                open.end.get_or_insert(match error {
                    Unusable::Said(what) => what,
                    Unusable::Map(error) => format!("{}: {error}", self.link.joint_states),
                });
            }
            return;
        }
        self.gather(true);
    }

    /// Takes the readings that are whole now.
    fn gather(&mut self, waits: bool) {
        let Some(open) = &mut self.open else { return };
        while open.end.is_none() {
            let before = self.assembler.last_ns;
            let Some(frame) = self.assembler.next(waits, &mut self.counts) else {
                return;
            };
            match (before, self.assembler.last_ns) {
                (Some(before), Some(now)) => open.end = assemble::gap(before, now, self.link),
                _ => open.end = no_start(&frame, self.link, open.began_ns.is_some()),
            }
            if open.end.is_none() {
                open.frames.push(frame);
            }
        }
    }

    /// Ends the open episode.
    pub fn finish(&mut self) {
        self.gather(false);
        let Some(mut open) = self.open.take() else {
            return;
        };
        let times = open.frames.windows(2);
        let gaps_ns = times.map(|w| ((w[1].time_s - w[0].time_s) * 1e9).round() as u64);
        if let Some(why) = off_pace(gaps_ns.collect(), self.period_s) {
            open.frames.clear();
            open.end = Some(format!("{why}; heard: {}", self.assembler.heard()));
        }
        let silent_ns = match (open.newest_ns, self.assembler.last_ns) {
            (Some(newest), Some(last)) => newest.saturating_sub(last),
            (newest, _) => newest.map_or(0, |_| u64::MAX),
        };
        let end = open.end.unwrap_or_else(|| {
            if silent_ns as f64 / 1e9 > self.link.gap_s
                && let Some(missing) = self.assembler.missing()
            {
                return format!("silent: {missing}");
            }
            "the log ends here".into()
        });
        let zero = self.assembler.zero_ns;
        let time_s = |stamp: u64| stamp.saturating_sub(zero) as f64 / 1e9;
        let mut actions: Vec<LoggedAction> = Vec::new();
        for (stamp, action) in open.actions {
            let time_s = time_s(stamp);
            let action = LoggedAction { time_s, action };
            if actions.last() == Some(&action) {
                self.counts.doubled += 1;
            } else {
                actions.push(action);
            }
        }
        self.episodes.push(LoggedEpisode {
            frames: open.frames,
            actions,
            sections: open.sections.iter().map(|(at, psi)| (time_s(*at), *psi)).collect(),
            end,
            actions_after_end: open.after_end.len(),
        });
    }

    /// The episodes, and what was found.
    pub fn told(mut self, sorted: &Sorted, findings: Findings) -> (Vec<LoggedEpisode>, LogReport) {
        let report = &mut self.report;
        for (kind, count) in &self.unreadable {
            let (topic, _, (package, name)) = kind.about(self.link);
            let packed = sorted.entries.iter().any(|e| e.kind == *kind && e.data.starts_with(b"\x28\xb5\x2f\xfd"));
            let why = if packed {
                " (each is compressed with zstd: record with `--compression-mode file` or none)"
            } else {
                ""
            };
            report.unreadable += count;
            report.notes.push(format!("{count} messages on {topic} cannot be read as {package}/msg/{name}{why}"));
        }
        let joints = &self.link.joint_states;
        if let Some(what) = self.assembler.wiring().untold() {
            report.notes.push(format!(
                "{joints} does not tell every joint's {what}: it counts as 0, in the strides' energy as well"
            ));
        }
        let promised = findings.promised.get(joints).copied().unwrap_or(0);
        report.lost = promised.saturating_sub(sorted.topics.get(joints).copied().unwrap_or(0));
        report.notes.extend(findings.damages);
        if report.lost > 0 {
            let lost = report.lost;
            report.notes.push(format!("{lost} of {promised} messages on {joints} are lost"));
        }
        let kept = self.episodes.iter().map(|e| e.frames.len() as u64);
        report.readings = kept.sum();
        report.episodes = self.episodes.len();
        report.missed = self.counts.missed;
        report.unpaired = self.counts.unpaired;
        report.doubled = self.counts.doubled;
        report.late = self.counts.out_of_order;
        report.unusable = self.counts.unusable;
        (self.episodes, self.report)
    }
}

/// What is wrong with the first reading after a start, or of a log that does not say where the robot starts.
fn no_start(frame: &SensorFrame, link: &Ros2Config, told: bool) -> Option<String> {
    let tilt_deg = |orientation| {
        let base = BaseState { orientation, ..BaseState::default() };
        base.tilt_rad().to_degrees()
    };
    let tilt = tilt_deg(frame.orientation);
    if tilt > link.upright_deg {
        let [w, x, y, z] = frame.orientation;
        let other_order = tilt_deg([x, y, z, w]) <= link.upright_deg;
        return Some(format!(
            "the robot is not upright at its start: {} tells a tilt of {tilt:.0} deg{}",
            link.imu,
            if other_order {
                "; it would be upright if its quaternions came in the order w, x, y, z (ROS has x, y, z, w)"
            } else {
                ""
            }
        ));
    }
    let rates = frame.joints.iter().map(|j| j.velocity_rad_s.abs());
    let fastest = rates.fold(0.0, f64::max);
    (!told && fastest > link.still_rad_s)
        .then(|| format!("it begins while the robot moves (a joint turns at {fastest:.2} rad/s): this is no start"))
}
