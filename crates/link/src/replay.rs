//! Logs read back: strides from a file, with no robot at all.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::{Arc, Mutex};

use rand_chacha::ChaCha8Rng;
use stridemap_robot::{
    JointLimits, JointState as JointReading, Machine, MachineDescription, RobotError, Ros2Config,
    SensorFrame,
};

use crate::error::LinkError;
use crate::journal::{ACTION, EPISODE};
use crate::messages::{Float64MultiArray, Imu, JointState, WrenchStamped, from_cdr};

/// One start of the robot and what followed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoggedEpisode {
    /// Readings, each a control period after the one before.
    pub frames: Vec<SensorFrame>,
    /// What the policy asked for, and the number of readings that had come before.
    pub actions: Vec<(usize, Vec<f64>)>,
}

/// Reads the episodes of a log.
///
/// A log that was cut short is read as far as it goes.
///
/// # Errors
///
/// [`LinkError::Log`] if the file cannot be read, or holds no readings of this robot.
pub fn read_log(path: &Path, link: &Ros2Config) -> Result<Vec<LoggedEpisode>, LinkError> {
    let fault = |problem: String| LinkError::Log {
        path: path.into(),
        problem,
    };
    let bytes = std::fs::read(path).map_err(|e| fault(e.to_string()))?;
    let options = mcap::read::Options::IgnoreEndMagic.into();
    let stream =
        mcap::MessageStream::new_with_options(&bytes, options).map_err(|e| fault(e.to_string()))?;
    let mut episodes: Vec<LoggedEpisode> = Vec::new();
    let (mut loads_n, mut imu) = ([None, None], None::<Imu>);
    for message in stream {
        let Ok(message) = message else {
            break;
        };
        let topic = message.channel.topic.as_str();
        let data: &[u8] = &message.data;
        if topic == EPISODE {
            episodes.push(LoggedEpisode::default());
            (loads_n, imu) = ([None, None], None);
        } else if topic == link.left_foot {
            loads_n[0] = from_cdr::<WrenchStamped>(data).map(|w| w.force.z);
        } else if topic == link.right_foot {
            loads_n[1] = from_cdr::<WrenchStamped>(data).map(|w| w.force.z);
        } else if topic == link.imu {
            imu = from_cdr(data);
        } else if topic == ACTION {
            let action = from_cdr::<Float64MultiArray>(data);
            if let (Some(action), Some(episode)) = (action, episodes.last_mut()) {
                episode.actions.push((episode.frames.len(), action.data));
            }
        } else if topic == link.joint_states {
            let (Some(joints), Some(imu), [Some(left), Some(right)], Some(episode)) = (
                from_cdr::<JointState>(data),
                imu.take(),
                std::mem::take(&mut loads_n),
                episodes.last_mut(),
            ) else {
                continue;
            };
            let q = imu.data.orientation;
            episode.frames.push(SensorFrame {
                time_s: joints.header.stamp.seconds(),
                joints: (0..joints.position.len())
                    .map(|i| JointReading {
                        position_rad: joints.position[i],
                        velocity_rad_s: joints.velocity.get(i).copied().unwrap_or(0.0),
                        torque_nm: joints.effort.get(i).copied().unwrap_or(0.0),
                    })
                    .collect(),
                orientation: [q.w, q.x, q.y, q.z],
                angular_velocity_rad_s: imu.data.angular_velocity.into(),
                loads_n: [left, right],
            });
        }
    }
    if episodes.iter().all(|e| e.frames.is_empty()) {
        return Err(fault(format!(
            "holds no readings on {}, {} and the feet's topics",
            link.joint_states, link.imu
        )));
    }
    Ok(episodes)
}

/// A machine that repeats a log, whatever it is commanded.
pub struct ReplayMachine {
    description: MachineDescription,
    episodes: std::vec::IntoIter<LoggedEpisode>,
    episode: LoggedEpisode,
    next: usize,
    frame: SensorFrame,
    actions: SharedActions,
}

/// The actions of the episode that is being repeated, those not yet taken.
pub type SharedActions = Arc<Mutex<VecDeque<Vec<f64>>>>;

impl ReplayMachine {
    /// A machine that repeats these episodes, one per reset.
    #[must_use]
    pub fn new(
        episodes: Vec<LoggedEpisode>,
        joint_names: Vec<String>,
        limits: Vec<JointLimits>,
        period_s: f64,
    ) -> Self {
        Self {
            description: MachineDescription {
                name: "log".into(),
                joint_names,
                control_period_s: period_s,
                limits,
            },
            episodes: episodes.into_iter(),
            episode: LoggedEpisode::default(),
            next: 0,
            frame: SensorFrame::default(),
            actions: SharedActions::default(),
        }
    }

    /// Where the actions of each episode appear as it begins.
    #[must_use]
    pub fn actions(&self) -> SharedActions {
        Arc::clone(&self.actions)
    }

    fn over(&self) -> RobotError {
        RobotError::Link {
            time_s: self.frame.time_s,
            what: "the log ends here".into(),
        }
    }
}

impl Machine for ReplayMachine {
    fn description(&self) -> &MachineDescription {
        &self.description
    }

    fn reset(
        &mut self,
        _command_rad: &[f64],
        _rng: &mut ChaCha8Rng,
    ) -> Result<&SensorFrame, RobotError> {
        self.episode = self.episodes.next().ok_or_else(|| self.over())?;
        self.next = 0;
        if let Ok(mut actions) = self.actions.lock() {
            *actions = self.episode.actions.drain(..).map(|(_, a)| a).collect();
        }
        self.step(&[])
    }

    fn frame(&self) -> &SensorFrame {
        &self.frame
    }

    fn step(&mut self, _command_rad: &[f64]) -> Result<&SensorFrame, RobotError> {
        let Some(frame) = self.episode.frames.get(self.next) else {
            return Err(self.over());
        };
        self.frame.clone_from(frame);
        self.next += 1;
        Ok(&self.frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::journal::Journal;
    use rand_chacha::rand_core::SeedableRng;

    fn frame(k: usize) -> SensorFrame {
        let k = k as f64;
        SensorFrame {
            time_s: 8e6 * k / 1e9,
            joints: vec![
                JointReading {
                    position_rad: 0.1 * k,
                    velocity_rad_s: -k,
                    torque_nm: 0.3,
                };
                2
            ],
            orientation: [1.0, 0.0, 0.0, 0.0],
            angular_velocity_rad_s: [0.1, 0.2, k],
            loads_n: [k, 30.0 - k],
        }
    }

    #[test]
    fn what_was_logged_is_read_back_to_the_bit() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("log.mcap");
        let names = vec!["a".to_owned(), "b".to_owned()];
        let link = Ros2Config::default();
        let journal = Journal::create(&path, &names, &link).unwrap();
        {
            let mut j = journal.lock().unwrap();
            for episode in 0..2 {
                j.episode().unwrap();
                for k in 0..5 {
                    j.frame(&frame(k)).unwrap();
                    if k == 2 {
                        j.action(&[f64::from(episode)]).unwrap();
                    }
                    j.command(&[0.0, 1.0]).unwrap();
                }
                j.section(&[0.016, 1.0, 2.0, 1.0]).unwrap();
            }
            j.finish().unwrap();
        }
        let episodes = read_log(&path, &link).unwrap();
        assert_eq!(episodes.len(), 2);
        for (index, episode) in episodes.iter().enumerate() {
            assert_eq!(episode.frames, (0..5).map(frame).collect::<Vec<_>>());
            assert_eq!(episode.actions, vec![(3, vec![index as f64])]);
        }
        let mut machine = ReplayMachine::new(episodes, names, Vec::new(), 0.008);
        let rng = &mut ChaCha8Rng::seed_from_u64(0);
        assert_eq!(*machine.reset(&[], rng).unwrap(), frame(0));
        assert_eq!(*machine.step(&[]).unwrap(), frame(1));
        // A log that was cut off is read as far as it goes.
        let bytes = std::fs::read(&path).unwrap();
        let cut = dir.path().join("cut.mcap");
        std::fs::write(&cut, &bytes[..bytes.len() - 10]).unwrap();
        assert!(read_log(&cut, &link).is_ok());
        assert!(read_log(&dir.path().join("none.mcap"), &link).is_err());
    }
}
