//! Whatever a log holds, as a file and message by message: episodes, or an error that names it.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use mcap::MessageStream;
use mcap::records::MessageHeader;
use stridemap_link::{LinkError, read_log};
use stridemap_mutate::{Corpus, fuzz};
use stridemap_robot::Ros2Config;

fn corpus() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../mutate/corpus/log")
}

/// Reads a log of two joints; how many readings it has.
fn read(path: &Path) -> Result<usize, LinkError> {
    let joints = ["head_pan", "head_tilt"].map(String::from).to_vec();
    let (episodes, _) = read_log(path, &Ros2Config::default(), joints, Vec::new(), 0.008)?;
    for frame in episodes.iter().flat_map(|episode| &episode.frames) {
        assert!(frame.joints.len() == 2 && frame.joints.iter().all(|j| j.position_rad.is_finite()));
        assert!(frame.loads_n.iter().chain(&frame.orientation).all(|x| x.is_finite()));
    }
    Ok(episodes.iter().map(|episode| episode.frames.len()).sum())
}

#[test]
fn logs() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.mcap");
    let logs = Corpus::read(&corpus()).unwrap();
    for (_, bytes) in logs.files() {
        std::fs::write(&path, bytes).unwrap();
        assert!(read(&path).unwrap() > 5);
    }
    fuzz("log", &logs, |_, bytes| {
        std::fs::write(&path, bytes).unwrap();
        if let Err(error) = read(&path) {
            assert!(error.to_string().contains("log.mcap"), "{error}");
        }
    });
}

/// Messages that are damaged in a log that is whole: past its checksums.
#[test]
fn messages() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.mcap");
    let whole = std::fs::read(corpus().join("plain.mcap")).unwrap();
    let all: Vec<_> = MessageStream::new(&whole).unwrap().map(Result::unwrap).collect();
    let first: BTreeMap<&str, &[u8]> = all.iter().rev().map(|m| (m.channel.topic.as_str(), &*m.data)).collect();
    let messages = first.iter().fold(Corpus::default(), |corpus, (topic, data)| corpus.with(topic, data.to_vec()));
    fuzz("message", &messages, |topic, bytes| {
        let mut writer =
            mcap::WriteOptions::new().compression(None).create(std::fs::File::create(&path).unwrap()).unwrap();
        let mut channels = BTreeMap::new();
        // The last message of the topic, so that there is something before it.
        let last = all.iter().rposition(|m| m.channel.topic == topic);
        for (k, m) in all.iter().enumerate() {
            let channel_id = *channels.entry(m.channel.topic.as_str()).or_insert_with(|| {
                let schema = m.channel.schema.as_ref().unwrap();
                let schema = writer.add_schema(&schema.name, &schema.encoding, &schema.data).unwrap();
                let (topic, encoding) = (&m.channel.topic, &m.channel.message_encoding);
                writer.add_channel(schema, topic, encoding, &BTreeMap::new()).unwrap()
            });
            let header =
                MessageHeader { channel_id, sequence: m.sequence, log_time: m.log_time, publish_time: m.publish_time };
            let data = if Some(k) == last { bytes } else { &m.data };
            writer.write_to_known_channel(&header, data).unwrap();
        }
        writer.finish().unwrap();
        if let Err(error) = read(&path) {
            assert!(error.to_string().contains("log.mcap"), "{error}");
        }
    });
}
