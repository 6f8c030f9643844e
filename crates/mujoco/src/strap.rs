//! A base that is held, softly.

use stridemap_robot::Hold;
use stridemap_robot::kinematics::{inverse, of_rotation_vector, product, rotation_vector};

/// Natural frequency of the robot in the strap along ways; about axes while it hangs, slower than a joint moves, so that the base
/// answers; and about axes while it stands.
const WAY_RAD_S: f64 = 12.0;
const HANGING_RAD_S: f64 = 3.0;
const STANDING_RAD_S: f64 = 12.0;
/// Radius of gyration of a robot of 1 m: what a turn of the base has to move.
const GYRATION_M: f64 = 0.3;

/// Where a base is held.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Strap {
    /// How.
    pub hold: Hold,
    /// Where it was when it was taken.
    pub place_m: [f64; 3],
    /// Its attitude then.
    pub attitude: [f64; 4],
}

impl Strap {
    /// Force at the centre of mass of the whole robot, so that it hangs as it is turned, and torque, in the world.
    ///
    /// It is damped by the motion of the whole robot, which no small body at its end makes stiff: `speed_m_s` of its centre of
    /// mass, `momentum` about that.
    pub fn wrench(
        &self,
        qpos: [f64; 7],
        speed_m_s: [f64; 3],
        momentum: [f64; 3],
        mass_kg: f64,
        gravity: [f64; 3],
    ) -> [f64; 6] {
        let [x, y, z, now @ ..] = qpos;
        let place = [x, y, z];
        let about = |axis: usize| {
            let mut vector = [0.0; 3];
            vector[axis] = self.hold.turned_rad[axis];
            of_rotation_vector(vector)
        };
        let wanted = product(product(product(about(2), about(1)), about(0)), self.attitude);
        let error = rotation_vector(product(wanted, inverse(now)));
        let inertia = mass_kg * GYRATION_M * GYRATION_M;
        let turn_rad_s = if self.hold.weight_share < 1.0 { STANDING_RAD_S } else { HANGING_RAD_S };
        let mut wrench = [0.0; 6];
        for k in 0..3 {
            let raised = if k == 2 { self.hold.raised_m } else { 0.0 };
            // With less than the weight the strap lets the feet find the floor.
            let stiffness = if k == 2 && self.hold.weight_share < 1.0 { 0.0 } else { WAY_RAD_S * WAY_RAD_S };
            let way = self.place_m[k] + raised - place[k];
            let carried = self.hold.weight_share * gravity[k];
            wrench[k] = mass_kg * (stiffness * way - 2.0 * WAY_RAD_S * speed_m_s[k] - carried);
            wrench[3 + k] = inertia * turn_rad_s * turn_rad_s * error[k] - 2.0 * turn_rad_s * momentum[k];
        }
        wrench
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A base where it is held feels its weight alone; one that is pitched forward too far is turned back.
    #[test]
    fn a_strap_carries_the_weight_and_turns_the_base_back() {
        let hold = Hold { weight_share: 1.0, ..Hold::default() };
        let strap = Strap { hold, place_m: [0.0, 0.0, 0.7], attitude: [1.0, 0.0, 0.0, 0.0] };
        let gravity = [0.0, 0.0, -9.81];
        let here = strap.wrench([0.0, 0.0, 0.7, 1.0, 0.0, 0.0, 0.0], [0.0; 3], [0.0; 3], 10.0, gravity);
        assert!((here[2] - 98.1).abs() < 1e-9 && here[0].abs() + here[4].abs() < 1e-9);
        let [w, x, y, z] = of_rotation_vector([0.0, 0.2, 0.0]);
        let pitched = strap.wrench([0.0, 0.0, 0.7, w, x, y, z], [0.0; 3], [0.0; 3], 10.0, gravity);
        assert!((pitched[4] + 10.0 * 0.09 * HANGING_RAD_S * HANGING_RAD_S * 0.2).abs() < 1e-9);
    }
}
