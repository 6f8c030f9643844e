//! The machine on which faults are tried.

use rand_chacha::ChaCha8Rng;
use stridemap_robot::{
    JointLimits, JointState as JointReading, Machine, MachineDescription, RobotError, SensorFrame, check_command,
};

pub(super) const PERIOD_S: f64 = 0.008;
pub(super) const JOINTS: usize = 4;

/// A machine of four perfect servos that stands: what the faults are tried on.
pub(super) struct StandIn {
    description: MachineDescription,
    frame: SensorFrame,
    periods: u64,
}

pub(super) fn names() -> Vec<String> {
    (0..JOINTS).map(|i| format!("joint_{i}")).collect()
}

pub(super) fn limits() -> Vec<JointLimits> {
    let one = JointLimits { lower_rad: -1.0, upper_rad: 1.0, velocity_rad_s: 5.0, torque_nm: 1.0 };
    vec![one; JOINTS]
}

fn standing() -> SensorFrame {
    SensorFrame {
        joints: vec![JointReading::default(); JOINTS],
        orientation: [1.0, 0.0, 0.0, 0.0],
        loads_n: [15.0, 15.0],
        ..SensorFrame::default()
    }
}

impl StandIn {
    pub fn new() -> Self {
        Self {
            description: MachineDescription {
                name: "stand-in".into(),
                joint_names: names(),
                control_period_s: PERIOD_S,
                limits: limits(),
            },
            frame: standing(),
            periods: 0,
        }
    }
}

impl Machine for StandIn {
    fn description(&self) -> &MachineDescription {
        &self.description
    }

    fn reset(&mut self, command_rad: &[f64], _rng: &mut ChaCha8Rng) -> Result<&SensorFrame, RobotError> {
        self.periods = 0;
        self.frame = standing();
        self.step(command_rad)
    }

    fn frame(&self) -> &SensorFrame {
        &self.frame
    }

    fn step(&mut self, command_rad: &[f64]) -> Result<&SensorFrame, RobotError> {
        check_command(command_rad, &self.description.joint_names)?;
        self.periods += 1;
        self.frame.time_s = self.periods as f64 * PERIOD_S;
        for (joint, want) in self.frame.joints.iter_mut().zip(command_rad) {
            joint.position_rad = *want;
        }
        Ok(&self.frame)
    }
}
