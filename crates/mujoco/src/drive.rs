//! From targets to servos and torques.

use stridemap_robot::{Hold, JointTargets, RobotError};

use crate::axis::Drive;
use crate::robot::MujocoRobot;
use crate::strap::Strap;

impl MujocoRobot {
    /// Refuses targets that the joints cannot take, naming the first.
    pub(crate) fn check(&self, targets: &JointTargets) -> Result<(), RobotError> {
        self.description.check(targets)?;
        for (at, (axis, asked)) in self.binding.axes.iter().zip(&targets.joints).enumerate() {
            if let (Drive::Servo { .. }, Some(what)) = (axis.drive, asked.beyond_position()) {
                let joint = self.description.joints[at].name.clone();
                return Err(RobotError::JointCannot { joint, what });
            }
        }
        Ok(())
    }

    /// Hands the targets to servos and PD laws.
    pub(crate) fn command(&mut self, targets: &JointTargets) {
        let ctrl = self.data.ctrl_mut();
        let laws = self.laws.iter_mut().zip(&targets.joints);
        for (axis, (law, asked)) in self.binding.axes.iter().zip(laws) {
            law.asked = *asked;
            if let Drive::Servo { ctrl: index, per_rad, offset, .. } = axis.drive {
                ctrl[index] = per_rad * asked.position_rad + offset;
            }
        }
    }

    /// Hands over the targets that were given `delay_steps` before the physics step at `step` of this period.
    pub(crate) fn command_late(&mut self, step: usize) {
        let periods_ago = self.delay_steps.saturating_sub(step).div_ceil(self.steps_per_period);
        if let Some(targets) = self.late.iter().rev().nth(periods_ago).cloned() {
            self.command(&targets);
        }
    }

    /// Computes the torques of our own PD laws from the present angles and rates.
    pub(crate) fn drive(&mut self) {
        for (axis, law) in self.binding.axes.iter().zip(&self.laws) {
            if matches!(axis.drive, Drive::Servo { .. }) {
                continue;
            }
            let asked = &law.asked;
            let (kp, kd) = (asked.kp.unwrap_or(law.kp), asked.kd.unwrap_or(law.kv));
            let error = asked.position_rad - self.data.qpos()[axis.qpos];
            let rate_error = asked.velocity_rad_s - self.data.qvel()[axis.dof];
            let torque = law.gain * (kp * error + kd * rate_error) + asked.torque_nm;
            let torque = torque.clamp(-law.limit, law.limit);
            match axis.drive {
                Drive::Motor { ctrl, ctrl_per_nm } => {
                    self.data.ctrl_mut()[ctrl] = torque * ctrl_per_nm;
                }
                Drive::Applied => self.data.qfrc_applied_mut()[axis.dof] = torque,
                Drive::Servo { .. } => {}
            }
        }
    }

    /// Holds the base from where it is now, changes how it is held, or lets go.
    pub(crate) fn strap(&mut self, hold: Option<Hold>) {
        let [x, y, z, attitude @ ..] = self.base_qpos();
        let here = ([x, y, z], attitude);
        self.held_by = hold.map(|hold| {
            let (place_m, attitude) = self.held_by.map_or(here, |strap| (strap.place_m, strap.attitude));
            Strap { hold, place_m, attitude }
        });
        if self.held_by.is_none() {
            self.data.xfrc_applied_mut()[self.binding.torso].fill(0.0);
        }
    }

    /// Pulls at the base before a physics step, if it is held.
    pub(crate) fn pull_strap(&mut self) {
        let Some(strap) = self.held_by else { return };
        self.data.subtree_vel();
        let torso = self.binding.torso;
        let (speed, momentum) = (self.data.subtree_linvel()[torso], self.data.subtree_angmom()[torso]);
        let (mass_kg, gravity) = (self.description.mass_kg, self.gravity_m_s2());
        let mut wrench = strap.wrench(self.base_qpos(), speed, momentum, mass_kg, gravity);
        // Forces act at the body's own centre of mass.
        let (whole, own) = (self.data.subtree_com()[torso], self.data.xipos()[torso]);
        let arm = [0, 1, 2].map(|k| whole[k] - own[k]);
        for k in 0..3 {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            wrench[3 + k] += arm[i] * wrench[j] - arm[j] * wrench[i];
        }
        self.data.xfrc_applied_mut()[self.binding.torso] = wrench;
    }

    fn base_qpos(&self) -> [f64; 7] {
        let q = self.binding.root_qpos;
        std::array::from_fn(|k| self.data.qpos()[q + k])
    }
}
