//! The guard and the contract, on a robot whose joints go where they are told at once.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};
use stridemap_robot::contract::{Start, check};
use stridemap_robot::{
    GuardCounts, GuardLimits, Guarded, JointLimits, JointTargets, LEG_JOINTS, LegJoint, Legs,
    Robot, RobotDescription, RobotError, RobotState, Side,
};

const PERIOD_S: f64 = 0.01;
const KNEE: (Side, LegJoint) = (Side::Left, LegJoint::Knee);

struct Toy {
    description: RobotDescription,
    state: RobotState,
    commanded: JointTargets,
    /// Starts at a random place.
    disturbed: bool,
    /// Starts where it was left: against the contract.
    remembers: bool,
    /// Spoils the next state.
    fault: Option<fn(&mut RobotState)>,
}

impl Toy {
    fn new() -> Self {
        Self {
            description: RobotDescription {
                name: "toy".into(),
                control_period_s: PERIOD_S,
                mass_kg: 1.0,
                limits: Legs::from_fn(|_, _| JointLimits {
                    lower_rad: -1.0,
                    upper_rad: 0.5,
                    velocity_rad_s: 2.0,
                    torque_nm: 10.0,
                }),
            },
            state: RobotState::default(),
            commanded: JointTargets::default(),
            disturbed: false,
            remembers: false,
            fault: None,
        }
    }

    fn follow(&mut self, targets: &JointTargets) {
        self.commanded = *targets;
        for side in Side::BOTH {
            for joint in LEG_JOINTS {
                self.state.joints[(side, joint)].position_rad = targets.position_rad[(side, joint)];
            }
        }
    }
}

impl Robot for Toy {
    fn description(&self) -> &RobotDescription {
        &self.description
    }

    fn reset(
        &mut self,
        posture: &JointTargets,
        rng: &mut ChaCha8Rng,
    ) -> Result<&RobotState, RobotError> {
        posture.check_finite()?;
        let place_m = self.state.com.position_m[0];
        self.state = RobotState::default();
        if self.remembers {
            self.state.com.position_m[0] = place_m + 0.1;
        }
        self.follow(posture);
        if self.disturbed {
            self.state.base.position_m[0] = f64::from(rng.next_u32());
        }
        Ok(&self.state)
    }

    fn state(&self) -> &RobotState {
        &self.state
    }

    fn step(&mut self, targets: &JointTargets) -> Result<&RobotState, RobotError> {
        targets.check_finite()?;
        self.follow(targets);
        self.state.time_s += PERIOD_S;
        if let Some(fault) = self.fault.take() {
            fault(&mut self.state);
        }
        Ok(&self.state)
    }
}

fn rng() -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(1)
}

fn ready() -> Result<Guarded<Toy>, RobotError> {
    let mut robot = Guarded::new(Toy::new());
    robot.reset(&JointTargets::default(), &mut rng())?;
    Ok(robot)
}

fn knee_at(angle_rad: f64) -> JointTargets {
    let mut targets = JointTargets::default();
    targets.position_rad[KNEE] = angle_rad;
    targets
}

fn is_stop(error: &RobotError) -> bool {
    matches!(error, RobotError::EmergencyStop { .. })
}

#[test]
fn contract_holds_bare_and_guarded_and_finds_what_breaks_it() {
    let posture = JointTargets::default();
    let plain = || Ok(Toy::new());
    let guarded = || Ok(Guarded::new(Toy::new()));
    let disturbed = || {
        Ok(Toy {
            disturbed: true,
            ..Toy::new()
        })
    };
    let remembers = || {
        Ok(Toy {
            remembers: true,
            ..Toy::new()
        })
    };
    assert_eq!(check(plain, &posture, Start::Exact), Ok(()));
    assert_eq!(check(guarded, &posture, Start::Exact), Ok(()));
    assert_eq!(check(disturbed, &posture, Start::Disturbed), Ok(()));
    assert!(check(disturbed, &posture, Start::Exact).is_err());
    assert!(check(plain, &posture, Start::Disturbed).is_err());
    assert!(check(remembers, &posture, Start::Exact).is_err());
}

#[test]
fn guard_changes_nothing_within_the_limits() -> Result<(), RobotError> {
    let mut robot = ready()?;
    for period in 0..100 {
        let targets = knee_at(-0.4 * (0.02 * f64::from(period)).sin());
        robot.step(&targets)?;
        assert_eq!(robot.inner().commanded, targets);
    }
    assert_eq!(robot.counts(), GuardCounts::default());
    Ok(())
}

#[test]
fn commands_are_kept_to_range_and_rate() -> Result<(), RobotError> {
    let mut robot = ready()?;
    // 2 rad/s allow 0.02 rad a period; 0.9 rad is beyond the range, which ends at 0.5 rad.
    for period in 1..=30 {
        robot.step(&knee_at(0.9))?;
        let expected = (0.02 * f64::from(period)).min(0.5);
        assert!((robot.inner().commanded.position_rad[KNEE] - expected).abs() < 1e-12);
    }
    assert_eq!(robot.counts().position_clamped, 30);
    // The end is reached at the 25th; rounding may leave a hair for the 26th.
    assert!((24..=25).contains(&robot.counts().rate_limited));
    Ok(())
}

#[test]
fn nan_is_refused_and_does_not_stop_the_robot() -> Result<(), RobotError> {
    let mut robot = ready()?;
    let before = robot.state().clone();
    let answer = robot.step(&knee_at(f64::NAN)).err();
    assert!(matches!(answer, Some(RobotError::NotFinite { .. })));
    assert_eq!(*robot.state(), before);
    assert_eq!(robot.counts().not_finite, 1);
    robot.step(&knee_at(0.0)).map(|_| ())
}

#[test]
fn nonsense_latches_the_emergency_stop() -> Result<(), RobotError> {
    let faults: [fn(&mut RobotState); 5] = [
        |state| state.time_s -= 2.0 * PERIOD_S,
        |state| state.time_s -= PERIOD_S,
        |state| state.time_s += 11.0 * PERIOD_S,
        |state| state.com.position_m[2] = f64::NAN,
        |state| state.base.orientation = [f64::NAN; 4],
    ];
    for fault in faults {
        let mut robot = ready()?;
        robot.inner_mut().fault = Some(fault);
        assert!(robot.step(&knee_at(0.01)).is_err_and(|e| is_stop(&e)));
        assert!(robot.step(&knee_at(0.01)).is_err_and(|e| is_stop(&e)));
        let reset = robot.reset(&knee_at(0.0), &mut rng());
        assert!(reset.is_err_and(|e| is_stop(&e)));
        assert_eq!(robot.counts().emergency_stops, 1);
        robot.rearm();
        robot.reset(&knee_at(0.0), &mut rng())?;
        robot.step(&knee_at(0.01))?;
    }
    Ok(())
}

#[test]
fn tilt_stops_only_where_it_is_limited() -> Result<(), RobotError> {
    let lie_down: fn(&mut RobotState) =
        |state| state.base.orientation = [0.5_f64.sqrt(), 0.5_f64.sqrt(), 0.0, 0.0];
    let mut robot = ready()?;
    robot.inner_mut().fault = Some(lie_down);
    robot.step(&knee_at(0.0))?;

    let mut limits = GuardLimits::of(robot.description());
    limits.tilt_rad = 0.8;
    let mut robot = Guarded::with_limits(Toy::new(), limits);
    robot.reset(&knee_at(0.0), &mut rng())?;
    robot.inner_mut().fault = Some(lie_down);
    let error = robot.step(&knee_at(0.0)).err().map(|e| e.to_string());
    assert!(error.is_some_and(|e| e.contains("90 deg")));
    Ok(())
}

#[test]
fn after_rearming_rates_count_from_the_measured_angle() -> Result<(), RobotError> {
    let mut robot = ready()?;
    robot.step(&knee_at(0.02))?;
    robot.stop("test");
    robot.inner_mut().state.joints[KNEE].position_rad = -0.5;
    robot.rearm();
    robot.step(&knee_at(0.3))?;
    assert!((robot.inner().commanded.position_rad[KNEE] + 0.48).abs() < 1e-12);
    Ok(())
}
