//! The log of a robot: everything that it said and was told, as ROS 2 messages in an MCAP file.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};
use rand_chacha::ChaCha8Rng;
use stridemap_robot::{Machine, MachineDescription, Pose, RobotError, RobotState, Ros2Config, SensorFrame, Shape};

use crate::error::LinkError;
use crate::messages::{Float64MultiArray, Header, RosMessage, RosTime, Text, to_cdr, to_messages};
use crate::wiring::Wiring;

/// `std_msgs/String`: `"begin"` where a robot starts anew.
pub(crate) const EPISODE: &str = "/stridemap/episode";
/// `std_msgs/Float64MultiArray`: what the policy asked for, at the beginning of a stride.
pub(crate) const ACTION: &str = "/stridemap/action";
/// `std_msgs/Float64MultiArray`: `[time, ψ_roll deg, ψ_pitch deg, side]` of each section; side + is left.
pub(crate) const SECTION: &str = "/stridemap/section";

/// Writes an MCAP file of profile `ros2`.
pub struct Journal {
    path: PathBuf,
    writer: Writer<BufWriter<File>>,
    channels: BTreeMap<String, u16>,
    sequence: u32,
    wiring: Wiring,
    link: Ros2Config,
    /// Robot time at which the present episode began: the log's clock never goes back.
    begin_s: f64,
    now_s: f64,
}

/// A journal shared by those who write into it.
pub type SharedJournal = Arc<Mutex<Journal>>;

impl Journal {
    /// Creates a log for a machine with these joints.
    ///
    /// # Errors
    ///
    /// [`LinkError::Log`].
    pub fn create(path: &Path, joint_names: &[String], link: &Ros2Config) -> Result<SharedJournal, LinkError> {
        let fault = |problem: String| LinkError::Log { path: path.into(), problem };
        let mut wiring = Wiring::new(link, joint_names.to_vec())?;
        wiring.find(joint_names)?;
        let file = File::create(path).map_err(|e| fault(e.to_string()))?;
        let writer = WriteOptions::new()
            .profile("ros2")
            .compression(None)
            .create(BufWriter::new(file))
            .map_err(|e| fault(e.to_string()))?;
        Ok(Arc::new(Mutex::new(Self {
            path: path.into(),
            writer,
            channels: BTreeMap::new(),
            sequence: 0,
            wiring,
            link: link.clone(),
            begin_s: 0.0,
            now_s: 0.0,
        })))
    }

    fn fault(&self, problem: impl std::fmt::Display) -> LinkError {
        LinkError::Log { path: self.path.clone(), problem: problem.to_string() }
    }

    fn write<M: RosMessage>(&mut self, topic: &str, message: &M) -> Result<(), LinkError> {
        let channel_id = match self.channels.get(topic) {
            Some(id) => *id,
            None => {
                let (package, name) = M::TYPE;
                let schema = self
                    .writer
                    .add_schema(&format!("{package}/msg/{name}"), "ros2msg", M::DEFINITION.as_bytes())
                    .map_err(|e| self.fault(e))?;
                let id = self.writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).map_err(|e| self.fault(e))?;
                self.channels.insert(topic.to_owned(), id);
                id
            }
        };
        let Some(bytes) = to_cdr(message) else {
            return Err(self.fault("a message cannot be written"));
        };
        let time = RosTime::from_seconds(self.begin_s + self.now_s).nanoseconds();
        self.sequence = self.sequence.wrapping_add(1);
        let header = MessageHeader { channel_id, sequence: self.sequence, log_time: time, publish_time: time };
        self.writer.write_to_known_channel(&header, &bytes).map_err(|e| self.fault(e))
    }

    /// A robot starts anew; its clock will begin at 0.
    pub(crate) fn episode(&mut self) -> Result<(), LinkError> {
        self.begin_s += self.now_s + 1.0;
        self.now_s = 0.0;
        self.write(EPISODE, &Text { data: "begin".into() })
    }

    /// A reading.
    pub(crate) fn frame(&mut self, frame: &SensorFrame) -> Result<(), LinkError> {
        self.now_s = frame.time_s;
        let header = Header { stamp: RosTime::from_seconds(frame.time_s), frame_id: "base".into() };
        let (_, imu, [left, right]) = to_messages(frame, &[], &header);
        // In the units and from the zeros of the robot's own topics: a log is read as the robot is.
        let joints = self.wiring.tell(header, &frame.joints);
        let link = self.link.clone();
        self.write(&link.left_foot, &left)?;
        self.write(&link.right_foot, &right)?;
        self.write(&link.imu, &imu)?;
        self.write(&link.joint_states, &joints)
    }

    /// A command.
    pub(crate) fn command(&mut self, command_rad: &[f64]) -> Result<(), LinkError> {
        let topic = self.link.commands.clone();
        self.numbers(&topic, &self.wiring.write(command_rad))
    }

    fn numbers(&mut self, topic: &str, data: &[f64]) -> Result<(), LinkError> {
        self.write(topic, &Float64MultiArray { data: data.to_vec(), ..Float64MultiArray::default() })
    }

    /// What the policy asks for, as a stride begins.
    ///
    /// # Errors
    ///
    /// [`LinkError::Log`].
    pub fn action(&mut self, action: &[f64]) -> Result<(), LinkError> {
        self.numbers(ACTION, action)
    }

    /// A section: `[time, ψ_roll deg, ψ_pitch deg, side]`.
    ///
    /// # Errors
    ///
    /// [`LinkError::Log`].
    pub fn section(&mut self, numbers: &[f64]) -> Result<(), LinkError> {
        self.numbers(SECTION, numbers)?;
        // A controller that is killed loses no more than the stride it was in.
        self.writer.flush().map_err(|e| self.fault(e))
    }

    /// Writes the index: the log can then be opened anywhere.
    ///
    /// # Errors
    ///
    /// [`LinkError::Log`].
    pub fn finish(&mut self) -> Result<(), LinkError> {
        match self.writer.finish() {
            Ok(_) => Ok(()),
            Err(e) => Err(self.fault(e)),
        }
    }
}

/// A machine of which everything is logged.
pub struct LoggedMachine<M> {
    inner: M,
    journal: SharedJournal,
}

impl<M: Machine> LoggedMachine<M> {
    /// Logs a machine.
    pub const fn new(inner: M, journal: SharedJournal) -> Self {
        Self { inner, journal }
    }

    fn log(&self, write: impl FnOnce(&mut Journal) -> Result<(), LinkError>) -> Result<(), RobotError> {
        let fault = |what: String| RobotError::Link { time_s: self.inner.frame().time_s, what };
        match self.journal.lock() {
            Ok(mut journal) => write(&mut journal).map_err(|e| fault(e.to_string())),
            Err(_) => Err(fault("the log is broken".into())),
        }
    }
}

impl<M: Machine> Machine for LoggedMachine<M> {
    fn description(&self) -> &MachineDescription {
        self.inner.description()
    }

    fn reset(&mut self, command_rad: &[f64], rng: &mut ChaCha8Rng) -> Result<&SensorFrame, RobotError> {
        self.inner.reset(command_rad, rng)?;
        self.log(|j| {
            j.episode()?;
            j.frame(self.inner.frame())
        })?;
        Ok(self.inner.frame())
    }

    fn frame(&self) -> &SensorFrame {
        self.inner.frame()
    }

    fn step(&mut self, command_rad: &[f64]) -> Result<&SensorFrame, RobotError> {
        self.log(|j| j.command(command_rad))?;
        self.inner.step(command_rad)?;
        self.log(|j| j.frame(self.inner.frame()))?;
        Ok(self.inner.frame())
    }

    fn true_state(&self) -> Option<&RobotState> {
        self.inner.true_state()
    }

    fn set_push(&mut self, force_n: [f64; 3]) -> Result<(), RobotError> {
        self.inner.set_push(force_n)
    }

    fn engine_seconds(&self) -> Option<f64> {
        self.inner.engine_seconds()
    }

    fn geometry(&self) -> Vec<Shape> {
        self.inner.geometry()
    }

    fn poses(&self, out: &mut Vec<Pose>) {
        self.inner.poses(out);
    }
}
