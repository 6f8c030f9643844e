//! Readings from messages, paired by their stamps: the same for a robot that speaks now and for its log.

use std::collections::VecDeque;

use serde::Serialize;
use stridemap_robot::{JointLimits, JointState as JointReading, RobotError, Ros2Config, SensorFrame};

use crate::error::LinkError;
use crate::messages::{Header, Imu, JointState, WrenchStamped};
use crate::stream::{MOST_UNDER_WAY, Stream, Unusable, said, seconds};
use crate::wiring::Wiring;

/// What the controller's end of the link counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LinkCounts {
    /// States received whole.
    pub states: u64,
    /// Periods of which no whole state came.
    pub missed: u64,
    /// States whose clock did not advance.
    pub out_of_order: u64,
    /// Messages that came twice.
    pub doubled: u64,
    /// Joint states without another sensor's message near enough in time.
    pub unpaired: u64,
    /// Messages that say nothing usable: NaN, another number of joints, no orientation.
    pub unusable: u64,
    /// Messages that could not be read.
    pub unreadable: u64,
    /// Commands held back to a joint's range, rate or torque.
    pub limited: u64,
    /// Commands sent.
    pub commands: u64,
}

/// Stamps this share of a control period apart belong to one reading, unless `link.pair_within_s` says otherwise.
const PAIR_WITHIN_PERIODS: f64 = 0.45;
/// A clock that fell back by more than this is the robot's; less, and an old message arrived late, ...
const CLOCK_FELL_BACK_NS: u64 = 1_000_000_000;
/// ... unless so many came late without a newer one between.
const LATE_IN_A_ROW: u32 = 3;
/// A joint this far beyond its range is in another unit, or counts from another zero.
const FAR_BEYOND_RAD: f64 = 1.0;
/// Readings whose distances tell the robot's pace.
const PACE_READINGS: usize = 10;
/// Distances kept for it.
const PACE_KEPT: usize = 64;
/// A robot whose period differs from the task's by more than this share is another robot.
const PACE_TOLERANCE: f64 = 0.05;

/// A message of one sensor.
#[derive(Clone, Debug)]
pub(crate) enum Part {
    /// Joint states.
    Joints(JointState),
    /// The inertial unit.
    Imu(Imu),
    /// The load of the left (0) or right (1) foot.
    Foot(usize, WrenchStamped),
}

impl Part {
    /// The message's header.
    pub const fn header(&self) -> &Header {
        match self {
            Self::Joints(message) => &message.header,
            Self::Imu(message) => &message.header,
            Self::Foot(_, message) => &message.header,
        }
    }

    /// The message's header, to change.
    pub const fn header_mut(&mut self) -> &mut Header {
        match self {
            Self::Joints(message) => &mut message.header,
            Self::Imu(message) => &mut message.header,
            Self::Foot(_, message) => &mut message.header,
        }
    }
}

/// Attitude and turn, as the inertial unit tells them.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Turn {
    orientation: [f64; 4],
    rate_rad_s: [f64; 3],
}

/// Makes whole readings out of the messages of four topics.
///
/// A reading has the stamp of its joint states, and of every other sensor the message whose stamp is nearest to
/// it, `link.pair_within_s` away at most. A patient assembler (of a log) waits until no nearer one can come; an
/// eager one (of a robot that is being commanded) takes the nearest of those that have come.
#[derive(Clone, Debug)]
pub(crate) struct Assembler {
    wiring: Wiring,
    limits: Vec<JointLimits>,
    period_s: f64,
    within_ns: u64,
    patient: bool,
    joints: Stream<Vec<JointReading>>,
    imu: Stream<Turn>,
    feet: [Stream<f64>; 2],
    late: u32,
    /// Distances of the last whole readings.
    gaps_ns: VecDeque<u64>,
    /// Stamp of the newest whole reading.
    pub last_ns: Option<u64>,
    /// Robot time that counts as 0.
    pub zero_ns: u64,
}

impl Assembler {
    /// An assembler of a machine with these joints; `limits` are the model's, one a joint or none.
    ///
    /// # Errors
    ///
    /// [`LinkError::Config`] if the configuration names a joint that is not there, or pairs readings of two
    /// periods.
    pub fn new(
        config: &Ros2Config,
        joint_names: Vec<String>,
        limits: Vec<JointLimits>,
        period_s: f64,
        patient: bool,
    ) -> Result<Self, LinkError> {
        let within_s = config.pair_within_s.unwrap_or(PAIR_WITHIN_PERIODS * period_s);
        if !(within_s >= 0.0 && within_s < 0.5 * period_s) {
            return Err(LinkError::Config {
                field: "pair_within_s",
                value: within_s.to_string(),
                problem: format!(
                    "is not from 0 to less than half the control period of {period_s} s: a sensor's message \
                     would belong to two readings"
                ),
            });
        }
        Ok(Self {
            wiring: Wiring::new(config, joint_names)?,
            limits,
            period_s,
            within_ns: (within_s * 1e9) as u64,
            patient,
            joints: Stream::new(&config.joint_states, "joint states"),
            imu: Stream::new(&config.imu, "inertial unit"),
            feet: [
                Stream::new(&config.left_foot, "left foot's load"),
                Stream::new(&config.right_foot, "right foot's load"),
            ],
            late: 0,
            gaps_ns: VecDeque::new(),
            last_ns: None,
            zero_ns: 0,
        })
    }

    pub const fn wiring(&self) -> &Wiring {
        &self.wiring
    }

    /// Forgets messages under way, and who sent them.
    pub fn clear(&mut self) {
        self.joints.clear();
        self.imu.clear();
        self.feet.iter_mut().for_each(Stream::clear);
        self.late = 0;
    }

    /// Forgets the robot's clock as well.
    pub fn begin_anew(&mut self) {
        self.joints.begin_anew();
        self.imu.begin_anew();
        self.feet.iter_mut().for_each(Stream::begin_anew);
        self.late = 0;
        self.gaps_ns.clear();
        self.last_ns = None;
    }

    /// Takes a message in; `source` tells its writer from others.
    pub fn push(&mut self, part: Part, source: u128, counts: &mut LinkCounts) -> Result<(), Unusable> {
        let header = part.header().clone();
        let taken = match part {
            Part::Joints(message) => self
                .check_clock(header.stamp.nanoseconds(), counts)
                .and_then(|()| self.joints_of(&message))
                .and_then(|joints| self.joints.take(source, &header, joints)),
            Part::Imu(message) => self.turn_of(&message).and_then(|turn| self.imu.take(source, &header, turn)),
            Part::Foot(side, message) => {
                let load_n = message.force.z;
                if load_n.is_finite() {
                    self.feet[side].take(source, &header, load_n)
                } else {
                    let topic = &self.feet[side].topic;
                    Err(said(format!("the load on {topic} is {load_n}")))
                }
            }
        };
        match taken {
            Ok(new) => {
                counts.doubled += u64::from(!new);
                Ok(())
            }
            Err(error) => {
                counts.unusable += 1;
                Err(error)
            }
        }
    }

    /// Refuses a clock that went back; passes over a message that is late.
    fn check_clock(&mut self, stamp: u64, counts: &mut LinkCounts) -> Result<(), Unusable> {
        let Some(last) = self.last_ns else {
            return Ok(());
        };
        if stamp >= last {
            self.late = if stamp == last { self.late } else { 0 };
            return Ok(());
        }
        if self.joints.parts.contains_key(&stamp) {
            return Ok(()); // It comes twice.
        }
        counts.out_of_order += 1;
        self.late += 1;
        if last - stamp > CLOCK_FELL_BACK_NS || self.late >= LATE_IN_A_ROW {
            self.begin_anew();
            return Err(said(format!("the robot's clock went back by {:.3} s", seconds(last - stamp))));
        }
        Ok(())
    }

    fn joints_of(&mut self, message: &JointState) -> Result<Vec<JointReading>, Unusable> {
        let joints = self.wiring.read(message).map_err(|error| match error {
            RobotError::CommandLength { expected, found } => {
                let topic = &self.joints.topic;
                said(format!("{topic}: {found} numbers for {expected} joints"))
            }
            other => Unusable::Map(other),
        })?;
        let names = self.wiring.names();
        for (name, joint) in names.iter().zip(&joints) {
            for (field, value) in
                [("position", joint.position_rad), ("velocity", joint.velocity_rad_s), ("effort", joint.torque_nm)]
            {
                if !value.is_finite() {
                    return Err(said(format!("the {field} of joint {name} is {value}")));
                }
            }
        }
        for ((name, joint), limit) in names.iter().zip(&joints).zip(&self.limits) {
            let (at, low, high) = (joint.position_rad, limit.lower_rad, limit.upper_rad);
            if at < low - FAR_BEYOND_RAD || at > high + FAR_BEYOND_RAD {
                return Err(said(format!(
                    "joint {name} is at {at:.3} rad, far beyond its range of {low:.3} to {high:.3} rad: are \
                     link.angle_unit and link.offset_deg right?"
                )));
            }
        }
        Ok(joints)
    }

    fn turn_of(&self, message: &Imu) -> Result<Turn, Unusable> {
        let topic = &self.imu.topic;
        let q = message.data.orientation;
        let orientation = [q.w, q.x, q.y, q.z];
        let rate_rad_s: [f64; 3] = message.data.angular_velocity.into();
        if orientation.iter().any(|v| !v.is_finite()) {
            return Err(said(format!("the orientation on {topic} is not finite")));
        }
        if rate_rad_s.iter().any(|v| !v.is_finite()) {
            let what = "the angular velocity on";
            return Err(said(format!("{what} {topic} is not finite")));
        }
        let norm = orientation.iter().map(|v| v * v).sum::<f64>().sqrt();
        // REP-145: a covariance of −1 says that there is none.
        let absent = message.data.orientation_covariance[0] < 0.0;
        if absent || norm < 1e-6 {
            return Err(said(format!("{topic} tells no orientation: the robot needs an inertial unit that does")));
        }
        if (norm - 1.0).abs() > 0.005 {
            return Err(said(format!(
                "the orientation on {topic} is no rotation: its quaternion has the norm {norm:.3}"
            )));
        }
        Ok(Turn { orientation, rate_rad_s })
    }

    /// The next whole reading. `waits` is whether a patient assembler still hopes for nearer messages.
    pub fn next(&mut self, waits: bool, counts: &mut LinkCounts) -> Option<SensorFrame> {
        let waits = waits && self.patient;
        let after = self.last_ns.map_or(0, |last| last + 1);
        let under_way: Vec<u64> = self.joints.parts.range(after..).map(|(s, _)| *s).collect();
        for (skipped, &stamp) in under_way.iter().enumerate() {
            let within = self.within_ns;
            let found = [
                self.imu.partner(stamp, within),
                self.feet[0].partner(stamp, within),
                self.feet[1].partner(stamp, within),
            ];
            if let [Some(imu), Some(left), Some(right)] = found {
                if waits && !(imu.1 && left.1 && right.1) {
                    return None;
                }
                counts.unpaired += skipped as u64;
                return self.reading(stamp, imu.0, [left.0, right.0], counts);
            }
            let past = (found[0].is_none() && self.imu.is_past(stamp, within))
                || (0..2).any(|side| found[side + 1].is_none() && self.feet[side].is_past(stamp, within));
            if waits && !past && under_way.len() < MOST_UNDER_WAY {
                return None;
            }
        }
        None
    }

    /// A reading from its parts.
    fn reading(&mut self, stamp: u64, imu: u64, feet: [u64; 2], counts: &mut LinkCounts) -> Option<SensorFrame> {
        let joints = self.joints.parts.get(&stamp)?.clone();
        let turn = *self.imu.parts.get(&imu)?;
        let loads_n = [*self.feet[0].parts.get(&feet[0])?, *self.feet[1].parts.get(&feet[1])?];
        self.joints.forget_before(stamp);
        let kept = stamp.saturating_sub(self.within_ns);
        self.imu.forget_before(kept);
        self.feet.iter_mut().for_each(|f| f.forget_before(kept));
        if let Some(before) = self.last_ns.replace(stamp) {
            let gap_ns = stamp - before;
            let missed = (seconds(gap_ns) / self.period_s).round() - 1.0;
            counts.missed += missed.max(0.0) as u64;
            if self.gaps_ns.len() == PACE_KEPT {
                self.gaps_ns.pop_front();
            }
            self.gaps_ns.push_back(gap_ns);
        }
        counts.states += 1;
        Some(SensorFrame {
            time_s: seconds(stamp.saturating_sub(self.zero_ns)),
            joints,
            orientation: turn.orientation,
            angular_velocity_rad_s: turn.rate_rad_s,
            loads_n,
        })
    }

    /// Whether enough whole readings came to tell the robot's pace.
    pub fn knows_pace(&self) -> bool {
        self.gaps_ns.len() >= PACE_READINGS
    }

    /// What is wrong with the robot's pace: its readings come at another rate than the gait is made for.
    pub fn off_pace(&self) -> Option<String> {
        let gaps = self.gaps_ns.iter().copied().collect();
        off_pace(gaps, self.period_s).map(|why| format!("{why}; heard: {}", self.heard()))
    }

    /// What is missing of the newest reading under way; `None` if nothing has come since the last.
    pub fn missing(&self) -> Option<String> {
        let streams = [
            (self.joints.what, self.joints.newest_ns),
            (self.imu.what, self.imu.newest_ns),
            (self.feet[0].what, self.feet[0].newest_ns),
            (self.feet[1].what, self.feet[1].newest_ns),
        ];
        let newest = streams.iter().filter_map(|(_, newest)| *newest).max()?;
        if self.last_ns.is_some_and(|last| newest <= last + self.within_ns) {
            return None;
        }
        let silent =
            streams.iter().filter(|(_, at)| at.is_none_or(|at| seconds(newest.saturating_sub(at)) > self.period_s));
        let silent: Vec<&str> = silent.map(|(what, _)| *what).collect();
        // Of clocks that differ the slower seems silent and is not.
        let feet = self.feet.iter().any(Stream::never_pairs);
        let apart = feet || self.imu.never_pairs();
        Some(if silent.is_empty() || apart { format!("a whole reading ({})", self.heard()) } else { silent.join(", ") })
    }

    /// Whether anything was heard on any topic.
    pub fn heard_any(&self) -> bool {
        let feet = self.feet.iter().any(|f| f.newest_ns.is_some());
        feet || self.joints.newest_ns.is_some() || self.imu.newest_ns.is_some()
    }

    /// What was heard on each topic.
    pub fn heard(&self) -> String {
        [self.joints.tally(), self.imu.tally(), self.feet[0].tally(), self.feet[1].tally()].join("; ")
    }
}

/// What is wrong with readings that are so far apart, if another period than the task's is between most of them.
pub(crate) fn off_pace(mut gaps_ns: Vec<u64>, control_period_s: f64) -> Option<String> {
    gaps_ns.sort_unstable();
    let enough = gaps_ns.len() >= PACE_READINGS;
    let period_s = seconds(*gaps_ns.get(gaps_ns.len() / 2).filter(|_| enough)?);
    let mean_s = gaps_ns.iter().copied().map(seconds).sum::<f64>() / gaps_ns.len() as f64;
    let tempo = control_period_s / period_s;
    // Lost messages lengthen the mean, stamps that jitter scatter the median: another rate moves both.
    let off = |s: f64| (control_period_s / s - 1.0).abs() > PACE_TOLERANCE;
    (off(period_s) && off(mean_s)).then(|| {
        format!(
            "a reading comes every {:.2} ms ({:.1} a second), and the task's robot.control_period_s is {:.2} ms \
             ({:.1} a second): the gait would run at {tempo:.2} of its tempo ({})",
            1e3 * period_s,
            1.0 / period_s,
            1e3 * control_period_s,
            1.0 / control_period_s,
            if (0.01..100.0).contains(&tempo) {
                "another robot, or two publishers?"
            } else {
                "header.stamp in another unit than seconds and nanoseconds?"
            },
        )
    })
}

/// What is wrong if the robot's clock went on by this much from one reading to the next; a stride ends there.
pub(crate) fn gap(before_ns: u64, now_ns: u64, config: &Ros2Config) -> Option<String> {
    let gap_s = seconds(now_ns.saturating_sub(before_ns));
    (gap_s > config.gap_s).then(|| format!("no state for {gap_s:.3} s of robot time"))
}

#[cfg(test)]
mod tests;
