//! One log of 100 readings, spoilt in one way a test.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::PathBuf;

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};
use stridemap_robot::{AngleUnit, JointState as JointReading};

use super::*;
use crate::messages::{Header, RosTime, to_cdr, to_messages};

const READINGS: usize = 100;
const PERIOD_NS: u64 = 8_000_000;
const NAMES: [&str; 3] = ["hip", "ankle", "knee"];

/// A message with its topic, the number of its channel among those of the topic, and its encoding.
#[derive(Clone)]
struct Sent {
    topic: &'static str,
    channel: u8,
    encoding: &'static str,
    schema: String,
    log_time_ns: u64,
    data: Vec<u8>,
}

/// The messages of one control period.
#[derive(Clone)]
struct Tick {
    joints: JointState,
    imu: Imu,
    feet: [WrenchStamped; 2],
}

fn frame(k: usize) -> SensorFrame {
    let x = k as f64;
    let joint = |j: f64| JointReading { position_rad: 0.01 * x + 0.1 * j, velocity_rad_s: 1.25, torque_nm: 0.2 * j };
    SensorFrame {
        time_s: (PERIOD_NS * k as u64) as f64 / 1e9,
        joints: [0.0, 1.0, 2.0].map(joint).to_vec(),
        orientation: [1.0, 0.0, 0.0, 0.0],
        angular_velocity_rad_s: [0.1, 0.2, 0.01 * x],
        loads_n: [x, 30.0 - x],
    }
}

fn sent<M: RosMessage>(topic: &'static str, log_time_ns: u64, message: &M) -> Sent {
    Sent {
        topic,
        channel: 0,
        encoding: "cdr",
        schema: format!("{}/msg/{}", M::TYPE.0, M::TYPE.1),
        log_time_ns,
        data: to_cdr(message).unwrap(),
    }
}

fn shift(header: &mut Header, by_ns: i64) {
    let stamp = header.stamp.nanoseconds().saturating_add_signed(by_ns);
    header.stamp = RosTime::from_nanoseconds(stamp);
}

/// A log with an action at readings 10, 30, ..., 90, each period changed by `spoil`.
fn log(spoil: impl Fn(usize, &mut Tick)) -> Vec<Sent> {
    let names: Vec<String> = NAMES.iter().map(|n| (*n).to_owned()).collect();
    let begin = Text { data: "begin".into() };
    let mut all = vec![sent(EPISODE, 1_000_000_000, &begin)];
    for k in 0..READINGS {
        let header = Header { stamp: RosTime::from_nanoseconds(PERIOD_NS * k as u64), frame_id: "base".into() };
        let (joints, imu, feet) = to_messages(&frame(k), &names, &header);
        let mut tick = Tick { joints, imu, feet };
        spoil(k, &mut tick);
        let at = 1_000_000_000 + PERIOD_NS * k as u64;
        all.push(sent("/left_foot/wrench", at, &tick.feet[0]));
        all.push(sent("/right_foot/wrench", at, &tick.feet[1]));
        all.push(sent("/imu", at, &tick.imu));
        all.push(sent("/joint_states", at, &tick.joints));
        if k % 20 == 10 {
            let data = vec![k as f64];
            let layout = crate::messages::Layout::default();
            all.push(sent(ACTION, at, &Float64MultiArray { layout, data }));
        }
    }
    all
}

fn bytes(messages: &[Sent], compression: Option<Compression>) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    let options = WriteOptions::new().profile("ros2").compression(compression);
    let mut writer = options.chunk_size(Some(20_000)).create(&mut out).unwrap();
    let mut channels = BTreeMap::new();
    for message in messages {
        let key = (message.topic, message.channel, message.encoding);
        let channel_id = *channels.entry(key).or_insert_with(|| {
            let schema = writer.add_schema(&message.schema, "ros2msg", b"").unwrap();
            let number = [("number".to_owned(), message.channel.to_string())];
            writer.add_channel(schema, message.topic, message.encoding, &number.into()).unwrap()
        });
        let header =
            MessageHeader { channel_id, sequence: 0, log_time: message.log_time_ns, publish_time: message.log_time_ns };
        writer.write_to_known_channel(&header, &message.data).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    out.into_inner()
}

type Read = Result<(Vec<LoggedEpisode>, LogReport), LinkError>;

fn read_bytes(bytes: &[u8], link: &Ros2Config) -> Read {
    let dir = tempfile::tempdir().unwrap();
    let path: PathBuf = dir.path().join("log.mcap");
    std::fs::write(&path, bytes).unwrap();
    let limit = JointLimits { lower_rad: -0.5, upper_rad: 1.5, velocity_rad_s: 20.0, torque_nm: 5.0 };
    let names = NAMES.iter().map(|n| (*n).to_owned()).collect();
    read_log(&path, link, names, vec![limit; 3], PERIOD_NS as f64 / 1e9)
}

fn read(messages: &[Sent]) -> (LoggedEpisode, LogReport) {
    let (mut episodes, report) = read_bytes(&bytes(messages, None), &Ros2Config::default()).unwrap();
    assert_eq!(episodes.len(), 1);
    (episodes.remove(0), report)
}

fn clean() -> LoggedEpisode {
    LoggedEpisode {
        frames: (0..READINGS).map(frame).collect(),
        actions: [10, 30, 50, 70, 90]
            .map(|k| LoggedAction { time_s: frame(k).time_s, action: vec![k as f64] })
            .to_vec(),
        sections: Vec::new(),
        end: "the log ends here".into(),
        actions_after_end: 0,
    }
}

#[test]
fn a_log_is_the_same_log_however_it_is_packed_ordered_or_clocked() {
    let plain = log(|_, _| {});
    assert_eq!(read(&plain).0, clean());
    for packing in [Compression::Zstd, Compression::Lz4] {
        let (episodes, report) = read_bytes(&bytes(&plain, Some(packing)), &Ros2Config::default()).unwrap();
        assert_eq!((episodes, report.notes.len()), (vec![clean()], 0));
    }
    let alphabetical = log(|_, tick| {
        tick.joints.name.swap(0, 1);
        tick.joints.position.swap(0, 1);
        tick.joints.velocity.swap(0, 1);
        tick.joints.effort.swap(0, 1);
    });
    assert_eq!(read(&alphabetical).0, clean());
    let epoch = log(|_, tick| {
        let [left, right] = &mut tick.feet;
        for header in [&mut tick.joints.header, &mut tick.imu.header, &mut left.header, &mut right.header] {
            shift(header, 1_790_000_000_000_000_000);
        }
    });
    assert_eq!(read(&epoch).0, clean());
    // Another clock in the joint controller than in the sensors.
    let clocks = log(|_, tick| shift(&mut tick.joints.header, 1_790_000_000_000_000_000));
    let (episode, report) = read(&clocks);
    assert_eq!(episode, clean());
    assert!(report.notes.iter().any(|n| n.contains("clock of /imu")), "{report:?}");
    // Sensors a few ms off, and a joint state before the others of its period.
    let mut skewed = log(|_, tick| {
        shift(&mut tick.imu.header, 1_500_000);
        shift(&mut tick.feet[0].header, 3_000_000);
    });
    skewed.sort_by_key(|m| (m.log_time_ns, m.topic != "/joint_states", m.topic == ACTION));
    skewed.rotate_right(0);
    let first = skewed.iter().position(|m| m.topic == EPISODE).unwrap();
    let begin = skewed.remove(first);
    skewed.insert(0, begin);
    assert_eq!(read(&skewed).0, clean());
    // Everything twice.
    let (episode, report) = read(&plain.iter().flat_map(|m| [m.clone(), m.clone()]).collect::<Vec<_>>());
    assert_eq!((episode, report.doubled), (clean(), 4 * READINGS as u64 + 5));
    // An inertial unit four times as fast: of its messages the nearest counts.
    let fast: Vec<Sent> = plain
        .iter()
        .flat_map(|m| {
            let quarter = |k: u64| {
                let mut imu: Imu = from_cdr(&m.data).unwrap();
                shift(&mut imu.header, (k * PERIOD_NS / 4) as i64);
                imu.data.angular_velocity.x += k as f64;
                sent("/imu", m.log_time_ns + k * PERIOD_NS / 4, &imu)
            };
            match m.topic {
                "/imu" => (0..4).map(quarter).collect(),
                _ => vec![m.clone()],
            }
        })
        .collect();
    assert_eq!(read(&fast).0, clean());
}

#[test]
fn units_and_offsets_are_those_of_the_link() {
    let link = Ros2Config {
        angle_unit: AngleUnit::Deg,
        offset_deg: [("ankle".to_owned(), 90.0)].into(),
        ..Ros2Config::default()
    };
    let degrees = log(|_, tick| {
        tick.joints.position[1] += std::f64::consts::FRAC_PI_2;
        for value in tick.joints.position.iter_mut().chain(&mut tick.joints.velocity) {
            *value = value.to_degrees();
        }
    });
    let (episodes, _) = read_bytes(&bytes(&degrees, None), &link).unwrap();
    for (read, right) in episodes[0].frames.iter().zip(clean().frames) {
        for (read, right) in read.joints.iter().zip(right.joints) {
            assert!((read.position_rad - right.position_rad).abs() < 1e-12);
            assert!((read.velocity_rad_s - right.velocity_rad_s).abs() < 1e-12);
        }
    }
    assert_eq!(episodes[0].frames.len(), READINGS);
    let (unaware, _) = read(&degrees);
    assert!(unaware.frames.is_empty());
    assert!(unaware.end.contains("joint ankle") && unaware.end.contains("link.angle_unit"), "{}", unaware.end);
}

#[test]
fn a_lost_message_moves_no_action() {
    let mut lost = log(|_, _| {});
    let action = lost.iter().position(|m| m.topic == ACTION).unwrap();
    lost.remove(action);
    let joints: Vec<usize> = (0..lost.len()).filter(|&i| lost[i].topic == "/joint_states").collect();
    lost.remove(joints[20]);
    let (episode, report) = read(&lost);
    let mut right = clean();
    right.actions.remove(0);
    right.frames.remove(20);
    assert_eq!(episode, right);
    assert_eq!((report.missed, report.readings), (1, 99));
    // Another sensor's message lost: that reading is none.
    let mut lost = log(|_, _| {});
    let imu: Vec<usize> = (0..lost.len()).filter(|&i| lost[i].topic == "/imu").collect();
    lost.remove(imu[20]);
    let (episode, report) = read(&lost);
    assert_eq!((episode.frames.len(), report.unpaired), (99, 1));
}

#[test]
fn an_episode_ends_where_its_readings_can_no_longer_be_trusted() {
    let from = |k: usize, by_s: f64| {
        move |at: usize, tick: &mut Tick| {
            if at >= k {
                let [left, right] = &mut tick.feet;
                for header in [&mut tick.joints.header, &mut tick.imu.header, &mut left.header, &mut right.header] {
                    shift(header, (by_s * 1e9) as i64);
                }
            }
        }
    };
    let second = |from: usize| {
        let mut all = log(|_, _| {});
        let mut copies = Vec::new();
        for message in all.iter().filter(|m| m.topic == "/joint_states").skip(from) {
            let mut joints: JointState = from_cdr(&message.data).unwrap();
            joints.position.fill(0.0);
            shift(&mut joints.header, 1_000_000);
            let mut copy = sent("/joint_states", message.log_time_ns + 1_000_000, &joints);
            copy.channel = 1;
            copies.push(copy);
        }
        all.extend(copies);
        all
    };
    let cases: Vec<(Vec<Sent>, usize, &str)> = vec![
        (log(from(60, 60.0)), 60, "no state for 60.008 s of robot time"),
        (log(from(60, 0.048)), 60, "no state for 0.056 s of robot time"),
        (log(from(60, -0.45)), 60, "the robot's clock went back by"),
        (log(from(60, -0.2)), 60, "the robot's clock went back by"),
        (
            log(|k, tick| {
                if k == 60 {
                    tick.joints.position[2] = f64::NAN;
                }
            }),
            60,
            "the position of joint knee is NaN",
        ),
        (
            log(|k, tick| {
                if k >= 60 {
                    tick.joints.name[1] = "arm".into();
                }
            }),
            60,
            "\"ankle\" is not a joint of the robot",
        ),
        (log(|_, tick| tick.joints.name[1] = "hip".into()), 0, "\"hip\" is named twice by the robot"),
        (log(|_, tick| tick.joints.header.stamp = RosTime::default()), 0, "the stamps of /joint_states are all 0"),
        (log(|_, tick| tick.joints.header.stamp.sec = -5), 0, "the stamps of /joint_states are before 0 (-5.000 s)"),
        (
            log(|_, tick| {
                let q = &mut tick.imu.data.orientation;
                (q.x, q.y, q.z, q.w) = (q.w, q.x, q.y, q.z);
            }),
            0,
            "in the order w, x, y, z",
        ),
        (log(|_, tick| tick.imu.data.orientation.w = 0.0), 0, "/imu tells no orientation"),
        (log(|_, tick| tick.imu.data.orientation.w = 2.0), 0, "its quaternion has the norm 2.000"),
        (log(|k, tick| shift(&mut tick.imu.header, if k < 60 { 0 } else { 4_000_000 })), 60, "silent: a whole reading"),
        (second(60), 61, "two publishers on /joint_states"),
        (
            log(|k, tick| {
                let [left, right] = &mut tick.feet;
                for header in [&mut tick.joints.header, &mut tick.imu.header, &mut left.header, &mut right.header] {
                    shift(header, 2_000_000 * k as i64);
                }
            }),
            0,
            "a reading comes every 10.00 ms (100.0 a second)",
        ),
    ];
    for (messages, kept, why) in cases {
        let (episode, _) = read(&messages);
        assert!(episode.end.contains(why), "{why:?}: {:?}", episode.end);
        let frames = episode.frames.len();
        assert!(frames.abs_diff(kept) <= 1, "{why:?}: {frames} readings");
        let told = episode.actions.len() + episode.actions_after_end;
        assert!(kept == 0 || told == 5, "{why:?}: {told} actions");
        let right = clean();
        assert_eq!(episode.frames[..frames.min(kept)], right.frames[..frames.min(kept)], "{why:?}");
        assert!(kept == 0 || episode.actions.iter().all(|a| right.actions.contains(a)), "{why:?}");
    }
}

#[test]
fn stamps_that_jitter_by_less_than_half_a_period_are_ticks() {
    let off_ms = |k: usize, by: usize| (k * by + k * k % 11) as i64 % 7 - 3;
    let (episode, report) = read(&log(|k, tick| {
        let [left, right] = &mut tick.feet;
        for (header, by) in
            [(&mut tick.joints.header, 2), (&mut tick.imu.header, 3), (&mut left.header, 4), (&mut right.header, 5)]
        {
            shift(header, 1_000_000_000 + 1_000_000 * off_ms(k, by));
        }
    }));
    assert_eq!((episode.frames.len(), report.unpaired), (READINGS, 0));
    for (read, right) in episode.frames.iter().zip(clean().frames) {
        assert!((read.time_s - right.time_s).abs() < 0.002);
        assert_eq!((&read.joints, read.loads_n), (&right.joints, right.loads_n));
    }
    assert_eq!(report.notes.len(), 4, "{report:?}");
}

#[test]
fn rates_in_another_unit_or_sign_than_the_angles_are_refused() {
    let turning = |factor: f64| {
        log(move |k, tick| {
            let half_rad: f64 = 0.0025 * k as f64;
            let q = &mut tick.imu.data.orientation;
            (q.x, q.w) = half_rad.sin_cos();
            tick.imu.data.angular_velocity = [factor * 0.625, 0.0, 0.0].into();
        })
    };
    let rates = |factor: f64| log(move |_, tick| tick.joints.velocity.iter_mut().for_each(|v| *v *= factor));
    assert_eq!(read(&turning(1.0)).0.frames.len(), READINGS);
    for (messages, why) in [
        (rates(57.3), "/joint_states are 57.3"),
        (rates(57.3), "deg/s"),
        (rates(-1.0), "opposite"),
        (turning(57.3), "/imu is 57.3"),
        (turning(-1.0), "opposite"),
    ] {
        let error = read_bytes(&bytes(&messages, None), &Ros2Config::default()).unwrap_err();
        assert!(error.to_string().contains(why), "{error}");
    }
}

#[test]
fn what_is_not_measured_counts_as_none_and_is_told() {
    let (episode, report) = read(&log(|_, tick| {
        tick.joints.effort.fill(f64::NAN);
        tick.joints.velocity.clear();
    }));
    assert_eq!(episode.frames.len(), READINGS);
    let joints = episode.frames.iter().flat_map(|f| &f.joints);
    assert!(joints.into_iter().all(|j| j.torque_nm.abs() + j.velocity_rad_s.abs() < 1e-300));
    assert!(report.notes[0].contains("velocity and effort"), "{report:?}");
}

#[test]
fn files_that_are_none_of_ours_or_not_whole_say_so() {
    let plain = log(|_, _| {});
    let link = Ros2Config::default();
    let whole = bytes(&plain, None);
    let refused = |bytes: &[u8]| read_bytes(bytes, &link).unwrap_err().to_string();
    for (bytes, why) in [
        (&b""[..], "an empty file"),
        (b"hello\n", "it begins with \"hello\\n\""),
        (b"SQLite format 3\0....", "SQLite"),
        (&whole[..8], "it holds no message at all"),
    ] {
        let error = refused(bytes);
        assert!(error.contains(why), "{error}");
    }
    let mut json = plain.clone();
    let joints = json.iter_mut().filter(|m| m.topic == "/joint_states");
    joints.for_each(|m| m.encoding = "json");
    assert!(refused(&bytes(&json, None)).contains("/joint_states is encoded as \"json\""));
    let mut text = plain.clone();
    let imu = text.iter_mut().filter(|m| m.topic == "/imu");
    imu.for_each(|m| m.schema = "std_msgs/msg/String".into());
    assert!(refused(&bytes(&text, None)).contains("/imu holds std_msgs/msg/String"));
    let unasked: Vec<Sent> = plain.iter().filter(|m| m.topic != ACTION).cloned().collect();
    assert!(refused(&bytes(&unasked, None)).contains("no /stridemap/action"));

    // Cut in the middle, and damaged there: what is left are the log's own readings, and the place is told.
    let right = clean();
    let (episodes, report) = read_bytes(&whole[..whole.len() / 2], &link).unwrap();
    let frames = &episodes[0].frames;
    assert!((40..60).contains(&frames.len()), "{}", frames.len());
    assert_eq!(frames[..], right.frames[..frames.len()]);
    assert!(report.notes.iter().any(|n| n.contains("is cut off")), "{report:?}");
    let message = plain.iter().filter(|m| m.topic == "/joint_states").nth(50).unwrap();
    let at = whole.windows(message.data.len()).position(|w| w == message.data);
    let mut damaged = whole.clone();
    damaged[at.unwrap() + 60] ^= 0x5a;
    let (episodes, report) = read_bytes(&damaged, &link).unwrap();
    let frames = &episodes[0].frames;
    assert!(frames.len() < 51 && frames[..] == right.frames[..frames.len()]);
    assert!(report.lost > 0, "{report:?}");
    assert!(report.notes[0].contains("the chunk at byte"), "{report:?}");
    // The chunk in which the robot starts: nothing says where the rest begins.
    let at = whole.windows(5).position(|w| w == b"begin");
    let mut damaged = whole.clone();
    damaged[at.unwrap()] ^= 0x5a;
    let (episodes, report) = read_bytes(&damaged, &link).unwrap();
    assert!(episodes.is_empty() && report.notes[0].contains("is lost"), "{report:?}");
}

/// A chunk, record or string that claims 2⁶⁰ bytes, at many places: an answer, whatever it is.
#[test]
fn no_damage_is_believed() {
    let link = Ros2Config::default();
    let messages: Vec<Sent> = log(|_, _| {}).into_iter().take(60).collect();
    for packing in [None, Some(Compression::Lz4)] {
        let whole = bytes(&messages, packing);
        for at in (8..whole.len()).step_by(19) {
            let mut damaged = whole.clone();
            let huge = (1_u64 << 60).to_le_bytes();
            let until = (at + 8).min(damaged.len());
            damaged[at..until].copy_from_slice(&huge[..until - at]);
            if let Ok((episodes, report)) = read_bytes(&damaged, &link) {
                let read: usize = episodes.iter().map(|e| e.frames.len()).sum();
                assert!(read <= 15, "{at}: {report:?}");
            }
        }
    }
}
