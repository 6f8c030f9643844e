//! Four sensors of a robot of 125 Hz, heard as they come.

use super::*;
use crate::messages::{ImuData, Quaternion, RosTime};

const PERIOD_NS: u64 = 8_000_000;

fn assembler() -> Assembler {
    let config = Ros2Config::default();
    Assembler::new(&config, vec!["knee".into()], Vec::new(), 0.008, false).unwrap()
}

fn header(stamp_ns: u64) -> Header {
    Header { stamp: RosTime::from_nanoseconds(stamp_ns), frame_id: "base".into() }
}

fn joints(stamp_ns: u64) -> Part {
    Part::Joints(JointState {
        header: header(stamp_ns),
        name: vec!["knee".into()],
        position: vec![0.1],
        ..JointState::default()
    })
}

fn imu(stamp_ns: u64) -> Part {
    let orientation = Quaternion { w: 1.0, ..Quaternion::default() };
    Part::Imu(Imu { header: header(stamp_ns), data: ImuData { orientation, ..ImuData::default() } })
}

fn foot(side: usize, stamp_ns: u64) -> Part {
    let wrench = WrenchStamped { header: header(stamp_ns), ..WrenchStamped::default() };
    Part::Foot(side, wrench)
}

/// The messages of one period, the others `skew_ns` after the joint states.
fn tick(stamp_ns: u64, skew_ns: u64) -> [Part; 4] {
    let others = stamp_ns + skew_ns;
    [joints(stamp_ns), imu(others), foot(0, others), foot(1, others)]
}

/// The stamps of the readings that come of messages of writer 1, until one cannot be used.
fn hear(assembler: &mut Assembler, parts: impl IntoIterator<Item = Part>) -> (Vec<u64>, Option<String>) {
    let (mut stamps, mut counts) = (Vec::new(), LinkCounts::default());
    for part in parts {
        if let Err(why) = assembler.push(part, 1, &mut counts) {
            return (stamps, Some(why.to_string()));
        }
        while assembler.next(true, &mut counts).is_some() {
            stamps.extend(assembler.last_ns);
        }
    }
    (stamps, None)
}

#[test]
fn sensors_within_the_tolerance_are_one_reading_as_soon_as_the_last_has_come() {
    let stamps: Vec<u64> = (1..20).map(|k| k * PERIOD_NS).collect();
    for skew_ns in [0, 1_500_000, 3_500_000] {
        let parts = stamps.iter().flat_map(|s| tick(*s, skew_ns));
        assert_eq!(hear(&mut assembler(), parts), (stamps.clone(), None));
    }
    // Half a period could belong to either reading.
    let mut far = assembler();
    let parts = stamps.iter().flat_map(|s| tick(*s, 4_000_000));
    assert!(hear(&mut far, parts).0.is_empty());
    let (heard, missing) = (far.heard(), far.missing().unwrap());
    assert!(heard.contains("/imu 19, 125.0 a second, stamps never nearer than 0.0040 s"), "{heard}");
    assert!(missing.contains("a whole reading"), "{missing}");
}

#[test]
fn one_late_message_is_passed_over_and_a_clock_that_went_back_is_not() {
    let mut one_late = assembler();
    let order = [1, 2, 4, 3, 5, 6];
    let parts = order.into_iter().flat_map(|k: u64| tick(k * PERIOD_NS, 0));
    let (stamps, why) = hear(&mut one_late, parts);
    assert_eq!((stamps, why), ([1, 2, 4, 5, 6].map(|k| k * PERIOD_NS).to_vec(), None));
    let back = (100..120).chain(90..120).flat_map(|k: u64| tick(k * PERIOD_NS, 0));
    let (_, why) = hear(&mut assembler(), back);
    assert!(why.unwrap().contains("clock went back by"));
}

#[test]
fn a_robot_of_another_rate_is_told_from_one_that_loses_messages() {
    let paced = |periods: &mut dyn Iterator<Item = u64>| {
        let mut assembler = assembler();
        hear(&mut assembler, periods.flat_map(|at| tick(at, 0)));
        assembler.off_pace()
    };
    let lossy = |k: &u64| !k.is_multiple_of(4);
    assert_eq!(paced(&mut (1..60).filter(lossy).map(|k| k * PERIOD_NS)), None);
    let why = paced(&mut (1..60).map(|k| k * 10_000_000)).unwrap();
    assert!(why.contains("10.00 ms") && why.contains("8.00 ms"), "{why}");
    // One sensor at half the rate halves the rate of whole readings.
    let mut halved = assembler();
    let every_second = |part: &Part| {
        let stamp = part.header().stamp.nanoseconds();
        !matches!(part, Part::Foot(0, _)) || stamp.is_multiple_of(2 * PERIOD_NS)
    };
    let parts = (1..60).flat_map(|k| tick(k * PERIOD_NS, 0));
    hear(&mut halved, parts.filter(every_second));
    let why = halved.off_pace().unwrap();
    assert!(why.contains("/left_foot/wrench 29, 62.5 a second"), "{why}");
}

#[test]
fn a_publisher_may_take_over_but_two_may_not_take_turns() {
    let mut counts = LinkCounts::default();
    let mut turns = assembler();
    turns.push(joints(PERIOD_NS), 1, &mut counts).unwrap();
    turns.push(joints(2 * PERIOD_NS), 2, &mut counts).unwrap();
    let why = turns.push(joints(3 * PERIOD_NS), 1, &mut counts).unwrap_err();
    assert!(why.to_string().contains("two publishers on /joint_states"));
    turns.begin_anew();
    turns.push(joints(4 * PERIOD_NS), 1, &mut counts).unwrap();
    let zeros = (0..6).map(|_| imu(0));
    let why = hear(&mut assembler(), zeros).1.unwrap();
    assert!(why.contains("the stamps of /imu are all 0"), "{why}");
}
