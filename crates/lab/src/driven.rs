//! A gait that also drives joints beyond the legs to and fro: arms that swing (`[robot.posture]`).

use std::collections::BTreeMap;

use stridemap_gait::{Gait, GaitError, Modulation};
use stridemap_mujoco::Posture;
use stridemap_robot::{JointTargets, RobotDescription, RobotState, Side};

/// A joint that is driven: `A sin(φ + phase)` about its rest, with φ the phase of the gait as the right leg sees it.
struct DrivenJoint {
    at: usize,
    amplitude_rad: f64,
    phase_rad: f64,
}

/// Another gait, and joints beyond its legs.
struct Driven {
    gait: Box<dyn Gait>,
    joints: Vec<DrivenJoint>,
    time_s: f64,
}

/// The gait with what a task drives beside it; the gait itself where that is nothing.
pub(crate) fn driven(
    posture: &BTreeMap<String, Posture>,
    robot: &RobotDescription,
    gait: Box<dyn Gait>,
) -> Box<dyn Gait> {
    let joints: Vec<DrivenJoint> = (posture.iter())
        .filter_map(|(name, posture)| match *posture {
            Posture::Held(_) => None,
            Posture::Driven { amplitude_deg, phase_deg, .. } => Some(DrivenJoint {
                at: robot.joints.iter().position(|joint| joint.name == *name)?,
                amplitude_rad: amplitude_deg.to_radians(),
                phase_rad: phase_deg.to_radians(),
            }),
        })
        .collect();
    if joints.is_empty() { gait } else { Box::new(Driven { gait, joints, time_s: 0.0 }) }
}

impl Gait for Driven {
    fn modulations(&self) -> &[Modulation] {
        self.gait.modulations()
    }

    fn rest(&self) -> &JointTargets {
        self.gait.rest()
    }

    fn reset(&mut self) {
        self.time_s = 0.0;
        self.gait.reset();
    }

    fn modulate(&mut self, index: usize, value: f64) -> Result<(), GaitError> {
        self.gait.modulate(index, value)
    }

    fn targets(&mut self, state: &RobotState, dt_s: f64, out: &mut JointTargets) {
        self.gait.targets(state, dt_s, out);
        self.time_s += dt_s;
        let grown = (self.time_s / self.gait.start_up_s().max(dt_s)).min(1.0);
        let phase_rad = self.gait.phase_rad(Side::Right).unwrap_or(0.0);
        for joint in &self.joints {
            if let Some(command) = out.joints.get_mut(joint.at) {
                command.position_rad += grown * joint.amplitude_rad * (phase_rad + joint.phase_rad).sin();
            }
        }
    }

    fn start_up_s(&self) -> f64 {
        self.gait.start_up_s()
    }

    fn phase_rad(&self, leg: Side) -> Option<f64> {
        self.gait.phase_rad(leg)
    }
}

#[cfg(test)]
mod tests {
    use crate::builtin;
    use stridemap_robot::{JointTargets, RobotState};

    /// The head of the small humanoid turns by 10 deg either way; the legs do what they did.
    #[test]
    fn a_driven_joint_goes_to_and_fro_and_the_legs_do_as_they_did() {
        let mut task = builtin::load("small-stepping", &[]).unwrap().task;
        let robot = task.robot.build().unwrap();
        let robot = robot.description();
        let of_leg = |at: usize| robot.legs.roles().any(|(.., role)| role.joint == at);
        let head = (0..robot.joints.len()).find(|&at| !of_leg(at)).unwrap();
        let mut plain = task.gait(robot).unwrap();
        let driven = stridemap_mujoco::Posture::Driven { rest_deg: 0.0, amplitude_deg: 10.0, phase_deg: 90.0 };
        task.robot.posture.insert(robot.joints[head].name.clone(), driven);
        let mut both = task.gait(robot).unwrap();
        let (mut a, mut b) = (JointTargets::default(), JointTargets::default());
        let state = RobotState::default();
        let (mut low, mut high) = (0.0_f64, 0.0_f64);
        for _ in 0..4000 {
            plain.targets(&state, 0.002, &mut a);
            both.targets(&state, 0.002, &mut b);
            let off = b.joints[head].position_rad - a.joints[head].position_rad;
            (low, high) = (low.min(off), high.max(off));
        }
        assert!(low < (-9.0_f64).to_radians() && high > 9.0_f64.to_radians(), "{low} {high}");
        assert!((0..a.joints.len()).filter(|&at| at != head).all(|at| a.joints[at] == b.joints[at]));
    }
}
