//! A run as an MCAP file: what Foxglove and Rerun open.
//!
//! | topic | schema | one message per |
//! |---|---|---|
//! | `/nominal/tf`, `/final/tf`, and `/push/tf` where it was pushed | `foxglove.FrameTransforms` | recorded frame |
//! | `/nominal/robot`, `/final/robot` | `foxglove.SceneUpdate` | recording: the shapes, fixed to their frames |
//! | `/nominal/feet`, `/final/feet` | `stridemap.Feet` | recorded frame: loads, centre of pressure, push |
//! | `/nominal/section`, `/final/section` | `stridemap.Section` | stride: state, action, next state, reward |
//! | `/learning/section` | `stridemap.Section` | training and evaluation stride, with the map's prediction |
//!
//! Messages are JSON. Log times are robot times from 0; `/learning/section`, whose strides come from several
//! starts, counts one second a stride, so that there the time line is the step. Messages of
//! our own schemas also carry their `step`: the stride from the start of the recording, or of the run.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

use mcap::WriteOptions;
use mcap::records::MessageHeader;
use serde_json::{Value, json};

use crate::error::{ReportError, Result};
use crate::figure::write_aside;
use stridemap_record::{Recording, Run, StrideRole, Transition};
use stridemap_robot::{Pose, Shape, ShapeKind};

/// How far the nominal robot stands beside the final one, so that both can be seen at once.
const BESIDE_M: f64 = 1.2;

/// Messages that share a topic.
struct Channel {
    topic: String,
    schema: &'static str,
}

/// A message before it is written.
struct Message {
    channel: usize,
    time_s: f64,
    /// Stride on the robot that it belongs to, from 0.
    step: usize,
    value: Value,
}

#[derive(Default)]
struct Log {
    channels: Vec<Channel>,
    messages: Vec<Message>,
}

impl Log {
    fn channel(&mut self, topic: String, schema: &'static str) -> usize {
        self.channels.push(Channel { topic, schema });
        self.channels.len() - 1
    }

    fn push(&mut self, channel: usize, time_s: f64, step: usize, mut value: Value) {
        // Schemas of others have no place for it.
        if self.channels[channel].schema.starts_with("stridemap.") {
            value["step"] = step.into();
        }
        self.messages.push(Message { channel, time_s, step, value });
    }
}

/// Writes a run as MCAP.
///
/// # Errors
///
/// [`ReportError::Mcap`] if the file cannot be composed, [`ReportError::Io`] if it cannot be written.
pub fn write_mcap(run: &Run, path: &Path) -> Result<()> {
    let bytes = compose(messages(run))
        .map_err(|source| ReportError::Mcap { path: path.to_owned(), reason: source.to_string() })?;
    write_aside(path, &bytes)
}

/// The script that streams a run into Rerun, for a Python that has the `rerun` package. It reads the lines of
/// [`view_lines`] on its standard input; an argument names a file to write instead of opening the viewer.
pub const RERUN_STREAM: &str = include_str!("../assets/rerun_stream.py");

/// The messages of [`write_mcap`] in the order of time, one JSON object a line: `topic`, `time_s`, `step` and
/// `value`.
#[must_use]
pub fn view_lines(run: &Run) -> String {
    let mut log = messages(run);
    log.messages.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    let line = |m: &Message| {
        json!({
            "topic": log.channels[m.channel].topic, "time_s": m.time_s, "step": m.step, "value": m.value,
        })
        .to_string()
            + "\n"
    };
    log.messages.iter().map(line).collect()
}

fn messages(run: &Run) -> Log {
    let mut log = Log::default();
    for (what, recording) in &run.recordings {
        let left_m = if what.contains("nominal") { BESIDE_M } else { 0.0 };
        add_recording(&mut log, what, recording, left_m);
        let strides = run.record.iter().filter(|s| s.0 == *what);
        let strides: Vec<&Transition> = strides.map(|s| &s.1).collect();
        let channel = log.channel(format!("/{what}/section"), "stridemap.Section");
        let first_episode = strides.first().map(|s| s.episode);
        for (step, stride) in strides.iter().enumerate() {
            // After a fall the robot's clock begins anew; one time line shows one start.
            if Some(stride.episode) == first_episode {
                log.push(channel, stride.time_s, step, section(run, stride, None));
            }
        }
    }
    add_learning(&mut log, run);
    log
}

fn add_recording(log: &mut Log, what: &str, recording: &Recording, left_m: f64) {
    let tf = log.channel(format!("/{what}/tf"), "foxglove.FrameTransforms");
    let feet = log.channel(format!("/{what}/feet"), "stridemap.Feet");
    let torso = recording.torso();
    let mut step = 0;
    for frame in &recording.frames {
        step += usize::from(frame.crossing);
        let transforms: Vec<Value> = frame
            .poses
            .iter()
            .enumerate()
            .map(|(body, [x, y, z, qw, qx, qy, qz])| {
                json!({
                    "timestamp": stamp(frame.time_s),
                    "parent_frame_id": "world",
                    "child_frame_id": format!("{what}/{body}"),
                    "translation": { "x": x, "y": y + left_m, "z": z },
                    "rotation": { "x": qx, "y": qy, "z": qz, "w": qw },
                })
            })
            .collect();
        log.push(tf, frame.time_s, step, json!({ "transforms": transforms }));
        log.push(
            feet,
            frame.time_s,
            step,
            json!({
                "torso_m": torso.and_then(|s| frame.point_m(s, [0.0; 3])).map(|[x, y, z]| [x, y + left_m, z]),
                "left_load_n": frame.loads_n[0],
                "right_load_n": frame.loads_n[1],
                "centre_of_pressure_m": frame.cop_m.map(|[x, y]| [x, y + left_m]),
                "crossing": frame.crossing,
                "push_n": frame.push_n,
            }),
        );
    }
    let scene = log.channel(format!("/{what}/robot"), "foxglove.SceneUpdate");
    let begin_s = recording.frames.first().map_or(0.0, |f| f.time_s);
    let entities: Vec<Value> =
        recording.shapes.iter().enumerate().map(|(i, shape)| entity(what, i, shape, begin_s)).collect();
    log.push(scene, begin_s, 0, json!({ "deletions": [], "entities": entities }));
}

/// A shape as a scene entity that moves with its body's frame.
fn entity(what: &str, index: usize, shape: &Shape, time_s: f64) -> Value {
    let mut entity = json!({
        "timestamp": stamp(time_s),
        "frame_id": format!("{what}/{}", shape.body),
        "id": format!("{what}/{index}/{}", shape.name),
        "lifetime": { "sec": 0, "nsec": 0 },
        "frame_locked": true,
        "metadata": [], "arrows": [], "cubes": [], "spheres": [], "cylinders": [], "lines": [],
        "triangles": [], "texts": [], "models": [],
    });
    let [r, g, b, a] = shape.rgba;
    let color = json!({ "r": r, "g": g, "b": b, "a": a });
    let pose = pose(&shape.pose);
    let cube = |x: f64, y: f64, z: f64| json!({ "pose": pose, "size": { "x": 2.0 * x, "y": 2.0 * y, "z": 2.0 * z }, "color": color });
    let (kind, primitive) = match shape.kind {
        ShapeKind::Mesh { ref vertices_m, ref triangles } => {
            let points: Vec<Value> = vertices_m.iter().map(|[x, y, z]| json!({ "x": x, "y": y, "z": z })).collect();
            let indices: Vec<u32> = triangles.iter().flatten().copied().collect();
            ("triangles", json!({ "pose": pose, "points": points, "color": color, "colors": [], "indices": indices }))
        }
        ShapeKind::Box { half_extents_m: [x, y, z] } => ("cubes", cube(x, y, z)),
        ShapeKind::Sphere { radius_m: r } => ("spheres", cube(r, r, r)),
        ShapeKind::Ellipsoid { semi_axes_m: [x, y, z] } => ("spheres", cube(x, y, z)),
        // Foxglove has no capsule: the cylinder reaches to the tips.
        ShapeKind::Capsule { radius_m, half_length_m } => {
            ("cylinders", cylinder(&pose, radius_m, half_length_m + radius_m, &color))
        }
        ShapeKind::Cylinder { radius_m, half_length_m } => {
            ("cylinders", cylinder(&pose, radius_m, half_length_m, &color))
        }
    };
    entity[kind] = json!([primitive]);
    entity
}

fn cylinder(pose: &Value, radius_m: f64, half_length_m: f64, color: &Value) -> Value {
    json!({
        "pose": pose,
        "size": { "x": 2.0 * radius_m, "y": 2.0 * radius_m, "z": 2.0 * half_length_m },
        "bottom_scale": 1.0,
        "top_scale": 1.0,
        "color": color,
    })
}

fn pose(pose: &Pose) -> Value {
    let ([x, y, z], [qw, qx, qy, qz]) = (pose.position_m, pose.orientation);
    json!({
        "position": { "x": x, "y": y, "z": z },
        "orientation": { "x": qx, "y": qy, "z": qz, "w": qw },
    })
}

/// Training and evaluation strides in order, each with what the last map predicts from the others.
fn add_learning(log: &mut Log, run: &Run) {
    let channel = log.channel("/learning/section".into(), "stridemap.Section");
    let last = run.maps.last();
    // The map was fitted to the training strides that reached a section, in this order.
    let mut fitted = 0;
    for (step, stride) in run.transitions.iter().enumerate() {
        let is_datum = stride.role == StrideRole::Training && stride.end == stridemap_process::StrideEnd::Crossing;
        let predictions = is_datum.then(|| {
            let of_output = |o: &stridemap_map::SavedOutput| {
                let loo = &o.leave_one_out;
                let (mean, std) = (loo.mean.get(fitted)?, loo.std.get(fitted)?);
                Some((o.name.clone(), json!({ "mean": mean, "std": std })))
            };
            let outputs = last.map(|m| m.outputs.as_slice()).unwrap_or_default();
            outputs.iter().filter_map(of_output).collect::<BTreeMap<_, _>>()
        });
        fitted += usize::from(is_datum);
        log.push(channel, step as f64, step, section(run, stride, predictions));
    }
}

fn section(run: &Run, stride: &Transition, predictions: Option<BTreeMap<String, Value>>) -> Value {
    let named = |names: &[String], values: &[f64]| -> BTreeMap<String, f64> {
        names.iter().cloned().zip(values.iter().copied()).collect()
    };
    json!({
        "iteration": stride.iteration,
        "time_s": stride.time_s,
        "stance": stride.stance_name(),
        "state": named(&run.columns.state, &stride.state),
        "action": named(&run.columns.action, &stride.action),
        "next_state": named(&run.columns.state, &stride.next_state),
        "prediction": predictions,
        "reward": stride.reward,
        "end": stride.end,
    })
}

fn stamp(time_s: f64) -> Value {
    let nanoseconds = nanoseconds(time_s);
    json!({ "sec": nanoseconds / 1_000_000_000, "nsec": nanoseconds % 1_000_000_000 })
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the range")]
fn nanoseconds(time_s: f64) -> u64 {
    (time_s.clamp(0.0, 1e9) * 1e9).round() as u64
}

/// The messages in the order of time, as one file.
fn compose(mut log: Log) -> std::result::Result<Vec<u8>, mcap::McapError> {
    log.messages.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    let mut bytes = Cursor::new(Vec::new());
    let options = WriteOptions::new().compression(None).library("stridemap");
    let mut writer = options.create(&mut bytes)?;
    let mut ids = Vec::with_capacity(log.channels.len());
    for channel in &log.channels {
        let schema = writer.add_schema(channel.schema, "jsonschema", br#"{"type":"object"}"#)?;
        ids.push(writer.add_channel(schema, &channel.topic, "json", &BTreeMap::new())?);
    }
    let mut sequence = vec![0_u32; ids.len()];
    for message in &log.messages {
        let time = nanoseconds(message.time_s);
        let header = MessageHeader {
            channel_id: ids[message.channel],
            sequence: sequence[message.channel],
            log_time: time,
            publish_time: time,
        };
        sequence[message.channel] = sequence[message.channel].wrapping_add(1);
        writer.write_to_known_channel(&header, message.value.to_string().as_bytes())?;
    }
    writer.finish()?;
    drop(writer);
    Ok(bytes.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;
    use stridemap_record::{Columns, Frame};
    use stridemap_robot::Side;

    fn run() -> Run {
        let stride = |time_s| Transition {
            iteration: 1,
            time_s,
            stance: Some(Side::Left),
            state: [3.0].as_slice().into(),
            action: [0.5].as_slice().into(),
            next_state: [2.5].as_slice().into(),
            reward: -0.025,
            ..Default::default()
        };
        let shape = Shape {
            name: "foot".into(),
            body: 0,
            kind: ShapeKind::Box { half_extents_m: [0.1, 0.05, 0.01] },
            pose: Pose { position_m: [0.0; 3], orientation: [1.0, 0.0, 0.0, 0.0] },
            rgba: [1.0, 0.0, 0.0, 1.0],
        };
        let poses = || vec![[1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0]];
        let frame = |time_s: f64| Frame { time_s, poses: poses(), loads_n: [1.0, 2.0], ..Frame::default() };
        let recording =
            Recording { format: 1, shapes: vec![shape], period_s: 0.02, frames: vec![frame(4.0), frame(4.02)] };
        Run {
            columns: Columns { state: vec!["psi_roll_deg".into()], action: vec!["step_deg".into()], goal: Vec::new() },
            record: vec![("final".into(), stride(4.5)), ("nominal".into(), stride(4.4))],
            transitions: vec![stride(5.0), stride(5.6)],
            recordings: vec![("final".into(), recording)],
            ..Run::default()
        }
    }

    #[test]
    fn every_message_comes_back_on_its_topic_in_the_order_of_time() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("view.mcap");
        write_mcap(&run(), &path).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let mut topics: BTreeMap<String, Vec<(u64, Value)>> = BTreeMap::new();
        for message in mcap::MessageStream::new(&bytes).unwrap() {
            let message = message.unwrap();
            let value = serde_json::from_slice(&message.data).unwrap();
            topics.entry(message.channel.topic.clone()).or_default().push((message.log_time, value));
        }
        let names: Vec<&str> = topics.keys().map(String::as_str).collect();
        assert_eq!(names, ["/final/feet", "/final/robot", "/final/section", "/final/tf", "/learning/section"]);
        let tf = &topics["/final/tf"];
        assert_eq!(tf.iter().map(|m| m.0).collect::<Vec<_>>(), [4_000_000_000, 4_020_000_000]);
        assert_eq!(tf[0].1["transforms"][0]["translation"]["y"], 2.0);
        assert_eq!(topics["/final/section"].len(), 1);
        assert_eq!(topics["/final/section"][0].1["action"]["step_deg"], 0.5);
        assert_eq!(topics["/final/robot"][0].1["entities"][0]["cubes"][0]["size"]["x"], 0.2);
        assert_eq!(topics["/learning/section"][1].1["step"], 1);
    }

    #[test]
    fn lines_for_rerun_carry_both_times() {
        let lines = view_lines(&run());
        let learning: Vec<Value> = lines
            .lines()
            .map(|l| serde_json::from_str(l).unwrap())
            .filter(|m: &Value| m["topic"] == "/learning/section")
            .collect();
        assert_eq!((&learning[1]["step"], &learning[1]["time_s"]), (&json!(1), &json!(1.0)));
    }
}
