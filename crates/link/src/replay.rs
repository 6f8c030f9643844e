//! A log repeated: strides from a file, with no robot at all.

use std::sync::{Arc, Mutex};

use rand_chacha::ChaCha8Rng;
use stridemap_robot::{JointLimits, Machine, MachineDescription, RobotError, SensorFrame};

use crate::log::{LoggedAction, LoggedEpisode};

/// What is left of a log that is being repeated.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Repeated {
    /// Episodes that have not begun.
    pub left: usize,
    /// Actions of the episode under way.
    pub actions: Vec<LoggedAction>,
    /// Its sections, as the log has them: robot time and `ψ_roll` in degrees.
    pub sections: Vec<(f64, f64)>,
    /// Actions that were logged after its readings' end.
    pub after_end: usize,
}

/// A machine that repeats a log, whatever it is commanded.
pub struct ReplayMachine {
    description: MachineDescription,
    episodes: std::vec::IntoIter<LoggedEpisode>,
    episode: LoggedEpisode,
    next: usize,
    frame: SensorFrame,
    repeated: Arc<Mutex<Repeated>>,
}

impl ReplayMachine {
    /// A machine that repeats these episodes, one per reset.
    #[must_use]
    pub fn new(
        episodes: Vec<LoggedEpisode>,
        joint_names: Vec<String>,
        limits: Vec<JointLimits>,
        period_s: f64,
    ) -> Self {
        let repeated = Repeated { left: episodes.len(), ..Repeated::default() };
        Self {
            description: MachineDescription { name: "log".into(), joint_names, control_period_s: period_s, limits },
            episodes: episodes.into_iter(),
            episode: LoggedEpisode::default(),
            next: 0,
            frame: SensorFrame::default(),
            repeated: Arc::new(Mutex::new(repeated)),
        }
    }

    /// Where the actions of each episode appear as it begins.
    #[must_use]
    pub fn repeated(&self) -> Arc<Mutex<Repeated>> {
        Arc::clone(&self.repeated)
    }

    fn over(&self) -> RobotError {
        let end = self.episode.end.as_str();
        RobotError::Link {
            time_s: self.frame.time_s,
            what: if end.is_empty() { "the log ends here" } else { end }.into(),
        }
    }
}

impl Machine for ReplayMachine {
    fn description(&self) -> &MachineDescription {
        &self.description
    }

    fn reset(&mut self, _command_rad: &[f64], _rng: &mut ChaCha8Rng) -> Result<&SensorFrame, RobotError> {
        self.frame = SensorFrame::default();
        self.episode = self.episodes.next().unwrap_or_default();
        self.next = 0;
        if let Ok(mut repeated) = self.repeated.lock() {
            repeated.left = self.episodes.len();
            repeated.actions = std::mem::take(&mut self.episode.actions);
            repeated.sections = std::mem::take(&mut self.episode.sections);
            repeated.after_end = self.episode.actions_after_end;
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
    use std::path::Path;

    use crate::journal::Journal;
    use crate::log::read_log;
    use rand_chacha::rand_core::SeedableRng;
    use stridemap_robot::{JointState as JointReading, Ros2Config};

    fn frame(k: usize) -> SensorFrame {
        let k = k as f64;
        SensorFrame {
            time_s: 8e6 * k / 1e9,
            joints: vec![JointReading { position_rad: 0.1 * k, velocity_rad_s: -k, torque_nm: 0.3 }; 2],
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
        let read = |path: &Path| read_log(path, &link, names.clone(), Vec::new(), 0.008);
        let (episodes, report) = read(&path).unwrap();
        assert_eq!((report.readings, report.missed, report.notes.len()), (10, 0, 0));
        assert_eq!(episodes.len(), 2);
        for (index, episode) in episodes.iter().enumerate() {
            assert_eq!(episode.frames, (0..5).map(frame).collect::<Vec<_>>());
            let asked = LoggedAction { time_s: 0.016, action: vec![index as f64] };
            assert_eq!(episode.actions, [asked]);
        }
        let mut machine = ReplayMachine::new(episodes, names.clone(), Vec::new(), 0.008);
        let rng = &mut ChaCha8Rng::seed_from_u64(0);
        assert_eq!(*machine.reset(&[], rng).unwrap(), frame(0));
        assert_eq!(*machine.step(&[]).unwrap(), frame(1));
        // A log that was cut off is read as far as it goes.
        let bytes = std::fs::read(&path).unwrap();
        let cut = dir.path().join("cut.mcap");
        std::fs::write(&cut, &bytes[..bytes.len() - 10]).unwrap();
        let (episodes, _) = read(&cut).unwrap();
        assert_eq!(episodes.len(), 2);
        assert!(read(&dir.path().join("none.mcap")).is_err());
    }
}
