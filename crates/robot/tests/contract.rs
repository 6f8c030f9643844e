//! The contract, on a robot whose joints go where they are told at once.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::RngCore;
use stridemap_robot::contract::{Start, check};
use stridemap_robot::{JointDescription, JointLimits, JointTargets, Robot, RobotDescription, RobotError, RobotState};

const PERIOD_S: f64 = 0.01;

/// What a toy does with gains and torques.
#[derive(Clone, Copy, PartialEq)]
enum Gains {
    Refused,
    Honoured,
    /// Against the contract.
    Ignored,
}

struct Toy {
    description: RobotDescription,
    state: RobotState,
    gains: Gains,
    /// Starts at a random place.
    disturbed: bool,
    /// Starts where it was left: against the contract.
    remembers: bool,
}

impl Toy {
    fn new(gains: Gains) -> Self {
        let joint = |name: &str| JointDescription {
            name: name.into(),
            limits: JointLimits { lower_rad: -1.0, upper_rad: 0.5, velocity_rad_s: 2.0, torque_nm: 10.0 },
            rest_rad: 0.1,
        };
        Self {
            description: RobotDescription {
                name: "toy".into(),
                control_period_s: PERIOD_S,
                mass_kg: 1.0,
                joints: ["waist", "elbow", "tail"].map(joint).into(),
                ..RobotDescription::default()
            },
            state: RobotState::default(),
            gains,
            disturbed: false,
            remembers: false,
        }
    }

    fn follow(&mut self, targets: &JointTargets) -> Result<(), RobotError> {
        self.description.check(targets)?;
        let asked = targets.joints.iter().zip(&self.description.joints);
        let mut beyond = asked.filter_map(|(c, joint)| Some((joint, c.beyond_position()?)));
        if let (Gains::Refused, Some((joint, what))) = (self.gains, beyond.next()) {
            let joint = joint.name.clone();
            return Err(RobotError::JointCannot { joint, what });
        }
        self.state.joints.resize_with(3, Default::default);
        for (joint, command) in self.state.joints.iter_mut().zip(&targets.joints) {
            joint.position_rad = command.position_rad;
            joint.torque_nm = match self.gains {
                Gains::Honoured => command.torque_nm,
                _ => 0.0,
            };
        }
        Ok(())
    }
}

impl Robot for Toy {
    fn description(&self) -> &RobotDescription {
        &self.description
    }

    fn reset(&mut self, posture: &JointTargets, rng: &mut ChaCha8Rng) -> Result<&RobotState, RobotError> {
        self.follow(posture)?;
        self.state.time_s = 0.0;
        if self.remembers {
            self.state.com.position_m[0] += 0.1;
        }
        if self.disturbed {
            self.state.base.position_m[0] = f64::from(rng.next_u32());
        }
        Ok(&self.state)
    }

    fn state(&self) -> &RobotState {
        &self.state
    }

    fn step(&mut self, targets: &JointTargets) -> Result<&RobotState, RobotError> {
        self.follow(targets)?;
        self.state.time_s += PERIOD_S;
        Ok(&self.state)
    }
}

#[test]
fn contract_holds_and_finds_what_breaks_it() {
    let toy = |gains, disturbed, remembers| move || Ok(Toy { disturbed, remembers, ..Toy::new(gains) });
    let plain = toy(Gains::Refused, false, false);
    let disturbed = toy(Gains::Refused, true, false);
    assert_eq!(check(plain, Start::Exact), Ok(()));
    assert_eq!(check(disturbed, Start::Disturbed), Ok(()));
    assert!(check(disturbed, Start::Exact).is_err());
    assert!(check(plain, Start::Disturbed).is_err());
    assert!(check(toy(Gains::Refused, false, true), Start::Exact).is_err());
    assert_eq!(check(toy(Gains::Honoured, false, false), Start::Exact), Ok(()));
    let breach = check(toy(Gains::Ignored, false, false), Start::Exact).unwrap_err();
    assert!(breach.rule.contains("gains") && breach.found.contains("waist"), "{breach}");
}
