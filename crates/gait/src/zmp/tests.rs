use super::*;
use stridemap_robot::{JointDescription, JointLimits, JointTargets, Legs, RobotState};

fn config() -> ZmpConfig {
    ZmpConfig {
        thigh_m: 0.37,
        shank_m: 0.37,
        hip_half_width_m: 0.09,
        stance_half_width_m: 0.09,
        com_height_m: 0.83,
        com_ahead_m: 0.0,
        sole_ahead_m: 0.0,
        step_length_m: 0.1,
        step_time_s: 0.6,
        hip_height_m: 0.69,
        lift_m: 0.04,
        double_support: 0.2,
        zmp_offset_m: 0.0,
        ankle_gain_rad_m: 0.0,
        step_gain: 0.0,
        stand_s: 2.0,
    }
}

fn robot() -> RobotDescription {
    let mut joints = Vec::new();
    let legs = Legs::from_fn(|side, part| {
        let rest_deg: f64 = match part {
            LegJoint::HipPitch | LegJoint::AnklePitch => 20.0,
            LegJoint::Knee => -40.0,
            _ => 0.0,
        };
        let name = format!("{}_{}", side.name(), part.name());
        joints.push(JointDescription { name, limits: JointLimits::default(), rest_rad: rest_deg.to_radians() });
        Some(LegRole { joint: joints.len() - 1, sign: 1.0 })
    });
    RobotDescription { joints, legs, ..RobotDescription::default() }
}

/// After the start the planned mass moves on by a step's length in a step's time, sways from foot to foot, and its
/// zero-moment point stays within the sole of the foot that bears once the other is in the air.
#[test]
fn the_plan_walks_and_its_zero_moment_point_stays_under_the_foot() {
    let mut gait = ZmpGait::new(config(), &robot()).unwrap();
    let (state, mut out) = (RobotState::default(), JointTargets::default());
    let (mut at_10, mut sway, mut outside) = (0.0, [0.0_f64; 2], 0.0_f64);
    for tick in 0..8000 {
        gait.targets(&state, 0.002, &mut out);
        assert!(out.joints.iter().all(|j| j.position_rad.is_finite()));
        let time_s = 0.002 * f64::from(tick);
        let [x, y] = gait.axes.map(|a| a.position_m());
        if tick == 5000 {
            at_10 = x;
        }
        if time_s > 6.0 {
            sway = [sway[0].min(y), sway[1].max(y)];
            let phase = gait.phase_rad(gait.steps.stance().unwrap()).unwrap() / std::f64::consts::PI;
            if phase > 0.3 {
                let foot = gait.steps.foot_m(gait.steps.stance().unwrap());
                for (i, axis) in gait.axes.iter().enumerate() {
                    outside = outside.max((gait.preview.zmp_m(axis) - foot[i]).abs());
                }
            }
        }
    }
    let speed = (gait.axes[0].position_m() - at_10) / 6.0;
    assert!((speed - 0.1 / 0.6).abs() < 0.01, "{speed}");
    assert!(sway[0] < -0.02 && sway[1] > 0.02 && (sway[0] + sway[1]).abs() < 2e-3, "{sway:?}");
    assert!(outside < 0.03, "{outside}");
}

/// A modulation takes effect with the next step; a reset forgets it.
#[test]
fn modulations_change_the_steps() {
    let mut gait = ZmpGait::new(config(), &robot()).unwrap();
    gait.modulate(LENGTH, 0.2).unwrap();
    assert!(gait.modulate(TIME, f64::NAN).is_err() && gait.modulate(COUNT, 0.0).is_err());
    let (state, mut out) = (RobotState::default(), JointTargets::default());
    (0..5000).for_each(|_| gait.targets(&state, 0.002, &mut out));
    let x = gait.axes[0].position_m();
    assert!(x > 2.0, "{x}");
    gait.reset();
    assert!((gait.values[LENGTH] - 0.1).abs() < 1e-15);
    let mut kneeless = robot();
    kneeless.legs[(Side::Right, LegJoint::Knee)] = None;
    assert!(ZmpGait::new(config(), &kneeless).unwrap_err().to_string().contains("knee"));
}
