//! Logs read back: the episodes of a file, read as the robot itself is heard.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;
use stridemap_robot::{JointLimits, Ros2Config, SensorFrame};

use crate::assemble::{self, Assembler, Part, off_pace};
use crate::error::LinkError;
use crate::journal::{ACTION, EPISODE, SECTION};
use crate::mcap_file::{self, Findings, Raw};
use crate::messages::{
    Float64MultiArray, Imu, JointState, RosMessage, RosTime, Text, WrenchStamped, from_cdr,
    stamp_of,
};
use crate::remote::LinkCounts;

/// Stamps of two sensors that are this far apart as their messages are logged come from two clocks.
const TWO_CLOCKS_NS: u64 = 1_000_000_000;
/// Messages by which clocks are compared.
const CLOCK_MESSAGES: usize = 64;

/// What the policy asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct LoggedAction {
    /// Robot time of the last joint states before it.
    pub time_s: f64,
    /// The action.
    pub action: Vec<f64>,
}

/// One start of the robot and what followed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoggedEpisode {
    /// Readings, in time.
    pub frames: Vec<SensorFrame>,
    /// What the policy asked for.
    pub actions: Vec<LoggedAction>,
    /// Sections that whoever wrote the log found: robot time as in `actions`, `ψ_roll` in degrees.
    pub sections: Vec<(f64, f64)>,
    /// Why no more readings follow.
    pub end: String,
}

/// What was found in a log, and what of it could not be used.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LogReport {
    /// Starts of the robot.
    pub episodes: usize,
    /// Whole readings.
    pub readings: u64,
    /// Control periods of which no whole reading came.
    pub missed: u64,
    /// Joint states without another sensor's message near enough in time.
    pub unpaired: u64,
    /// Messages that came twice.
    pub doubled: u64,
    /// Joint states that came after newer ones.
    pub late: u64,
    /// Messages that say nothing usable.
    pub unusable: u64,
    /// Messages that cannot be read as what their topic holds.
    pub unreadable: u64,
    /// Messages before the first start, or after a start had to be given up.
    pub outside: u64,
    /// Joint states that the file says it holds and that are not there.
    pub lost: u64,
    /// What a person should know, in words.
    pub notes: Vec<String>,
}

/// What a topic of the log holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Joints,
    Imu,
    Foot(usize),
    Episode,
    Action,
    Section,
}

const SENSORS: [Kind; 4] = [Kind::Joints, Kind::Imu, Kind::Foot(0), Kind::Foot(1)];

impl Kind {
    /// The topic, its key in the task file, and the type of its messages.
    fn about(self, link: &Ros2Config) -> (&str, &'static str, (&'static str, &'static str)) {
        match self {
            Self::Joints => (&link.joint_states, "link.joint_states", JointState::TYPE),
            Self::Imu => (&link.imu, "link.imu", Imu::TYPE),
            Self::Foot(0) => (&link.left_foot, "link.left_foot", WrenchStamped::TYPE),
            Self::Foot(_) => (&link.right_foot, "link.right_foot", WrenchStamped::TYPE),
            Self::Episode => (EPISODE, "where the robot starts anew", Text::TYPE),
            Self::Action => (ACTION, "what the policy asked for", Float64MultiArray::TYPE),
            Self::Section => (
                SECTION,
                "where sections were found",
                Float64MultiArray::TYPE,
            ),
        }
    }

    fn of(topic: &str, link: &Ros2Config) -> Option<Self> {
        let all = SENSORS
            .into_iter()
            .chain([Self::Episode, Self::Action, Self::Section]);
        all.into_iter().find(|kind| kind.about(link).0 == topic)
    }

    fn read(self, data: &[u8]) -> Option<Part> {
        match self {
            Self::Joints => from_cdr(data).map(Part::Joints),
            Self::Imu => from_cdr(data).map(Part::Imu),
            Self::Foot(side) => from_cdr(data).map(|w| Part::Foot(side, w)),
            Self::Episode | Self::Action | Self::Section => None,
        }
    }
}

/// A message that matters, as it lies in the file.
struct Entry {
    log_time_ns: u64,
    kind: Kind,
    channel_id: u16,
    data: Box<[u8]>,
}

/// What the topics of a file hold.
#[derive(Default)]
struct Sorted {
    entries: Vec<Entry>,
    /// Messages per topic, wanted or not.
    topics: BTreeMap<String, u64>,
    /// Topics whose messages cannot be read, and why.
    foreign: BTreeMap<Kind, String>,
}

impl Sorted {
    fn take(&mut self, raw: &Raw<'_>, link: &Ros2Config) {
        let topic = &raw.channel.topic;
        match self.topics.get_mut(topic) {
            Some(count) => *count += 1,
            None => {
                self.topics.insert(topic.clone(), 1);
            }
        }
        let Some(kind) = Kind::of(topic, link) else {
            return;
        };
        let (package, name) = kind.about(link).2;
        let schema = &raw.channel.schema;
        let last = schema.rsplit(['/', ':']).next().unwrap_or("");
        let why = if raw.channel.encoding != "cdr" {
            format!("is encoded as {:?}; cdr can be read", raw.channel.encoding)
        } else if !schema.is_empty() && last.trim_end_matches('_') != name {
            format!("holds {schema}, not {package}/msg/{name}")
        } else {
            self.entries.push(Entry {
                log_time_ns: raw.log_time_ns,
                kind,
                channel_id: raw.channel_id,
                data: raw.data.into(),
            });
            return;
        };
        self.foreign.entry(kind).or_insert(why);
    }

    /// What the log lacks of a topic, in words.
    fn lack(&self, kind: Kind, link: &Ros2Config) -> Option<String> {
        let (topic, key, _) = kind.about(link);
        if self.entries.iter().any(|e| e.kind == kind) {
            return None;
        }
        Some(match self.foreign.get(&kind) {
            Some(why) => format!("{topic} {why}"),
            None => format!("no {topic} ({key})"),
        })
    }
}

/// Reads the episodes of a log, as the robot itself would be heard: the same wiring, units, names and pairing of
/// stamps. `limits` are the model's, one a joint or none.
///
/// A log that was cut short or damaged is read as far as it goes; the report says what is missing. An episode
/// ends where its readings do: at a gap of more than `link.gap_s`, at a jump of the clock, at the first message
/// that cannot be the robot's.
///
/// # Errors
///
/// [`LinkError::Log`] if the file cannot be read, is no MCAP file, or lacks a topic without which there are no
/// strides; [`LinkError::Config`] if the configuration does not fit the machine.
pub fn read_log(
    path: &Path,
    link: &Ros2Config,
    joint_names: Vec<String>,
    limits: Vec<JointLimits>,
    period_s: f64,
) -> Result<(Vec<LoggedEpisode>, LogReport), LinkError> {
    let assembler = Assembler::new(link, joint_names, limits, period_s, true)?;
    let mut sorted = Sorted::default();
    let findings = mcap_file::read(path, &mut |raw| sorted.take(raw, link))?;
    let needed = SENSORS.into_iter().chain([Kind::Action]);
    let mut lacks: Vec<String> = needed.filter_map(|kind| sorted.lack(kind, link)).collect();
    if !lacks.is_empty() {
        let has: Vec<String> = sorted
            .topics
            .iter()
            .map(|(t, n)| format!("{t} {n}"))
            .collect();
        lacks.push(if has.is_empty() {
            "it holds no message at all".into()
        } else {
            format!("it holds {}", has.join(", "))
        });
        lacks.extend(findings.damages);
        return Err(LinkError::Log {
            path: path.into(),
            problem: format!("gives no strides: {}", lacks.join("; ")),
        });
    }
    // Recorders of several threads write what they receive in nearly, not quite, the order of its time.
    sorted.entries.sort_by_key(|entry| entry.log_time_ns);
    let mut reader = EpisodeReader {
        link,
        period_s,
        assembler,
        counts: LinkCounts::default(),
        report: LogReport::default(),
        unreadable: BTreeMap::new(),
        episodes: Vec::new(),
        open: None,
    };
    let marked = sorted.entries.iter().any(|e| e.kind == Kind::Episode);
    if !marked && findings.promised.contains_key(EPISODE) {
        let lost = format!("every {EPISODE} is lost: where the robot started is not known");
        reader.report.notes.push(lost);
    } else if !marked {
        reader.report.notes.push(format!(
            "no {EPISODE}: the whole log counts as one start of the robot"
        ));
        reader.begin(&sorted.entries, None);
    }
    for (at, entry) in sorted.entries.iter().enumerate() {
        reader.take(entry, &sorted.entries[at..]);
    }
    reader.finish();
    Ok(reader.told(&sorted, findings))
}

/// An episode that is being read.
#[derive(Default)]
struct Open {
    began_ns: Option<u64>,
    frames: Vec<SensorFrame>,
    /// Stamps of joint states, and the actions after them.
    actions: Vec<(u64, Vec<f64>)>,
    sections: Vec<(u64, f64)>,
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
                    let why = if jumped {
                        " (its clock went on by itself)"
                    } else {
                        ""
                    };
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

struct EpisodeReader<'a> {
    link: &'a Ros2Config,
    period_s: f64,
    assembler: Assembler,
    counts: LinkCounts,
    report: LogReport,
    unreadable: BTreeMap<Kind, u64>,
    episodes: Vec<LoggedEpisode>,
    open: Option<Open>,
}

impl EpisodeReader<'_> {
    fn begin(&mut self, entries: &[Entry], began_ns: Option<u64>) {
        self.finish();
        self.assembler.begin_anew();
        let ahead_ns = clocks(entries);
        for (kind, ahead) in &ahead_ns {
            let ahead_s = *ahead as f64 / 1e9;
            self.report.notes.push(format!(
                "episode {}: the clock of {} is {ahead_s:+.3} s from the joint states'; the two were brought \
                 together by when they were logged",
                self.episodes.len(),
                kind.about(self.link).0
            ));
        }
        self.open = Some(Open {
            began_ns,
            ahead_ns,
            ..Open::default()
        });
    }

    /// Takes the next message in; `from_here` are it and those that follow.
    fn take(&mut self, entry: &Entry, from_here: &[Entry]) {
        if entry.kind == Kind::Episode {
            // A start that is told twice is one.
            self.open
                .take_if(|open| open.newest_ns.is_none() && open.end.is_none());
            self.begin(&from_here[1..], Some(entry.log_time_ns));
            return;
        }
        let Some(open) = self.open.as_mut().filter(|open| open.end.is_none()) else {
            self.report.outside += 1;
            return;
        };
        if matches!(entry.kind, Kind::Action | Kind::Section) {
            match (from_cdr::<Float64MultiArray>(&entry.data), open.newest_ns) {
                (Some(numbers), Some(newest)) if entry.kind == Kind::Action => {
                    open.actions.push((newest, numbers.data));
                }
                (Some(numbers), Some(newest)) => {
                    open.sections
                        .extend(numbers.data.get(1).map(|psi_deg| (newest, *psi_deg)));
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
        if let Some(ahead) = open.ahead_ns.get(&entry.kind) {
            let header = part.header_mut();
            let stamp = i128::from(header.stamp.nanoseconds()) - ahead;
            header.stamp = RosTime::from_nanoseconds(u64::try_from(stamp).unwrap_or(0));
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
                open.end.get_or_insert(error.to_string());
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
                _ if open.began_ns.is_none() => open.end = moves(&frame, self.link),
                _ => {}
            }
            if open.end.is_none() {
                open.frames.push(frame);
            }
        }
    }

    /// Ends the open episode.
    fn finish(&mut self) {
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
            sections: open
                .sections
                .iter()
                .map(|(at, psi)| (time_s(*at), *psi))
                .collect(),
            end,
        });
    }

    /// The episodes, and what was found.
    fn told(mut self, sorted: &Sorted, findings: Findings) -> (Vec<LoggedEpisode>, LogReport) {
        let report = &mut self.report;
        for (kind, count) in &self.unreadable {
            let (topic, _, (package, name)) = kind.about(self.link);
            let packed = sorted
                .entries
                .iter()
                .any(|e| e.kind == *kind && e.data.starts_with(b"\x28\xb5\x2f\xfd"));
            let why = if packed {
                " (each is compressed with zstd: record with `--compression-mode file` or none)"
            } else {
                ""
            };
            report.unreadable += count;
            report.notes.push(format!(
                "{count} messages on {topic} cannot be read as {package}/msg/{name}{why}"
            ));
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
            report.notes.push(format!(
                "{lost} of {promised} messages on {joints} are lost"
            ));
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

/// What is wrong with the first reading of a log that does not say where the robot starts.
fn moves(frame: &SensorFrame, link: &Ros2Config) -> Option<String> {
    let rates = frame.joints.iter().map(|j| j.velocity_rad_s.abs());
    let fastest = rates.fold(0.0, f64::max);
    (fastest > link.still_rad_s).then(|| {
        format!("it begins while the robot moves (a joint turns at {fastest:.2} rad/s): this is no start")
    })
}

/// By how much each sensor's clock is ahead of the joint states', where that is too much to be the way to the
/// recorder: judged by when the episode's first messages were logged.
fn clocks(entries: &[Entry]) -> BTreeMap<Kind, i128> {
    let until = entries.iter().position(|e| e.kind == Kind::Episode);
    let entries = &entries[..until.unwrap_or(entries.len())];
    let ahead_of_log = |kind: Kind| {
        let mut ahead: Vec<i128> = entries
            .iter()
            .filter(|e| e.kind == kind)
            .filter_map(|e| Some(i128::from(stamp_of(&e.data)?) - i128::from(e.log_time_ns)))
            .take(CLOCK_MESSAGES)
            .collect();
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

#[cfg(test)]
mod tests;
