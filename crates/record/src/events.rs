//! `events.ndjson`: what happened to a run, one JSON object a line, only ever appended to.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::error::RecordError;
use crate::files::{Keep, Log};
use crate::stride::{RobotFall, StridePhase};

/// The name of the file.
pub const EVENTS: &str = "events.ndjson";
/// Its first line.
pub const EVENTS_HEADER: &str = r#"{"format":1}"#;

/// The name of the event of a fall in a start on a robot behind a link, which no table of strides has.
pub const FELL_IN_START: &str = "fell_in_start";

/// The name of the event of an episode's first stride: an [`EpisodeStart`].
pub const EPISODE_BEGUN: &str = "episode";

/// Where the rows of an episode begin, and the state of the random generator before the reset that began it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct EpisodeStart {
    /// `transitions.csv` or `record.csv`.
    pub log: String,
    /// Row of its first stride, from 0.
    pub row: usize,
    /// The policy that is measured, in `record.csv`.
    pub what: Option<String>,
    /// Stream of the run's generator.
    pub stream: u64,
    /// 32-bit words drawn from it.
    pub word: u64,
}

/// The episodes that a run began, oldest first; a phase that was made anew after a crash is in it twice.
#[must_use]
pub fn episode_starts(run: &Path) -> Vec<EpisodeStart> {
    let begun = events(run).into_iter().filter(|event| event["event"] == EPISODE_BEGUN);
    begun.filter_map(|event| serde_json::from_value(event).ok()).collect()
}

/// The line of an event that happens now.
#[must_use]
pub fn event_line(kind: &str, details: Value) -> String {
    let mut event = serde_json::json!({
        "time": jiff::Timestamp::now().to_string(),
        "event": kind,
    });
    if let (Some(map), Value::Object(more)) = (event.as_object_mut(), details) {
        map.extend(more);
    }
    event.to_string()
}

/// Appends an event to a run's `events.ndjson` at once, whoever else writes into it: for those beside the run,
/// such as the person who was asked something.
///
/// # Errors
///
/// [`RecordError::File`].
pub fn append_event(run: &Path, kind: &str, details: Value) -> Result<(), RecordError> {
    Log::open(&run.join(EVENTS), EVENTS_HEADER, Keep::Lines)?.append(&event_line(kind, details))
}

/// The events of a run, oldest first. Lines that cannot be read are passed over: a run may have been killed while
/// it wrote one.
fn events(run: &Path) -> Vec<Value> {
    let text = std::fs::read(run.join(EVENTS)).unwrap_or_default();
    let text = String::from_utf8_lossy(&text);
    let lines = text.lines();
    lines.filter_map(|line| serde_json::from_str(line).ok()).collect()
}

/// The falls in starts since the last checkpoint.
#[must_use]
pub fn falls_in_starts(run: &Path, iteration: usize) -> Vec<RobotFall> {
    let events = events(run).into_iter().rev();
    let since = events.take_while(|event| event["event"] != "checkpoint");
    let fell = since.filter(|event| event["event"] == FELL_IN_START);
    let fell = fell.filter_map(|event| serde_json::from_value(event).ok());
    let fell = fell.map(|fall| RobotFall { iteration, phase: StridePhase::Collect, what: None, stride: None, fall });
    fell.collect()
}

/// Why a run stopped before its end.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Stop {
    /// Wall-clock time (RFC 3339).
    pub time: String,
    /// In the words of the command that stopped.
    pub reason: String,
}

/// The reason in the last `stopped` of a run's events, unless the run went on or ended after it.
pub(crate) fn stopped(run: &Path) -> Option<Stop> {
    let mut stop = None;
    for event in events(run) {
        let word = |key: &str| event.get(key).and_then(Value::as_str);
        match (word("event"), word("reason")) {
            (Some("stopped"), Some(reason)) => {
                stop = Some(Stop { time: word("time").unwrap_or_default().to_owned(), reason: reason.to_owned() });
            }
            (Some("resumed" | "end"), _) => stop = None,
            _ => {}
        }
    }
    stop
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reason_is_that_of_the_last_stop() {
        let dir = tempfile::tempdir().unwrap();
        let first = r#"{"format":1}
{"time":"2026-01-01T00:00:00Z","event":"stopped","reason":"interrupted"}"#;
        let again = r#"{"time":"2026-01-01T00:00:01Z","event":"resumed","strides":3}"#;
        let last = r#"{"time":"2026-01-01T00:00:02Z","event":"stopped","reason":"the robot fell 4 times"}"#;
        let of = |lines: &[&str]| {
            std::fs::write(dir.path().join(EVENTS), lines.join("\n")).unwrap();
            stopped(dir.path())
        };
        assert_eq!(of(&[first]).unwrap().reason, "interrupted");
        assert_eq!(of(&[first, again]), None);
        let torn = of(&[first, again, "\u{fffd}", last, "{\"time\":\"20"]);
        assert_eq!(torn, Some(Stop { time: "2026-01-01T00:00:02Z".into(), reason: "the robot fell 4 times".into() }));
    }
}
