//! Logs read back: the episodes of a file, read as the robot itself is heard.

mod episodes;
mod imu;
mod plausible;
mod stamps;

pub use self::imu::{IMU_COLUMNS, read_imu};

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;
use stridemap_robot::{JointLimits, Ros2Config, SensorFrame};

use self::episodes::EpisodeReader;
use crate::assemble::{Assembler, Part};
use crate::error::LinkError;
use crate::journal::{ACTION, EPISODE, SECTION};
use crate::mcap_file::{self, Raw};
use crate::messages::{Float64MultiArray, Imu, JointState, RosMessage, Text, WrenchStamped, from_cdr, stamp_of};

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
    /// Actions that were logged after that.
    pub actions_after_end: usize,
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
            Self::Section => (SECTION, "where sections were found", Float64MultiArray::TYPE),
        }
    }

    fn of(topic: &str, link: &Ros2Config) -> Option<Self> {
        let all = SENSORS.into_iter().chain([Self::Episode, Self::Action, Self::Section]);
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
    /// The header's stamp, if it has one from 0 on.
    stamp_ns: Option<u64>,
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
                stamp_ns: SENSORS.contains(&kind).then(|| stamp_of(raw.data)).flatten(),
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
        let has: Vec<String> = sorted.topics.iter().map(|(t, n)| format!("{t} {n}")).collect();
        lacks.push(if has.is_empty() {
            "it holds no message at all".into()
        } else {
            format!("it holds {}", has.join(", "))
        });
        lacks.extend(findings.damages);
        return Err(LinkError::Log { path: path.into(), problem: format!("gives no strides: {}", lacks.join("; ")) });
    }
    // Recorders of several threads write what they receive in nearly, not quite, the order of its time.
    sorted.entries.sort_by_key(|entry| entry.log_time_ns);
    let mut reader = EpisodeReader::new(link, period_s, assembler);
    for (kind, most_s) in stamps::even_out(&mut sorted.entries, link.gap_s) {
        reader.report.notes.push(format!(
            "the stamps of {} jitter: they count as even ticks, up to {:.1} ms from where they were",
            kind.about(link).0,
            1e3 * most_s
        ));
    }
    let marked = sorted.entries.iter().any(|e| e.kind == Kind::Episode);
    if !marked && findings.promised.contains_key(EPISODE) {
        let lost = format!("every {EPISODE} is lost: where the robot started is not known");
        reader.report.notes.push(lost);
    } else if !marked {
        reader.report.notes.push(format!("no {EPISODE}: the whole log counts as one start of the robot"));
        reader.begin(&sorted.entries, None);
    }
    for (at, entry) in sorted.entries.iter().enumerate() {
        reader.take(entry, &sorted.entries[at..]);
    }
    reader.finish();
    if let Some(why) = plausible::contradiction(&reader.episodes, link) {
        return Err(LinkError::Log { path: path.into(), problem: format!("gives no strides: {why}") });
    }
    Ok(reader.told(&sorted, findings))
}

#[cfg(test)]
mod tests;
