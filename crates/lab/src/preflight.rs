//! Before a pretrained policy is trusted with a robot: are its sensors and joints wired as the model says?
//!
//! The robot hangs, held at its base. It is rocked about all axes, each joint makes one small motion, then it is let down
//! until its feet rest on the floor. The same is done with the model in simulation. What differs in sign, order or scale is
//! wiring; what differs a little is the robot.
//!
//! ```text
//! stamps        median of Δt                        against the control period
//! gravity       its direction while hanging         against the model's
//! gyroscope     g(t+h) − g(t) = −∫ (M ω) × g        which signed permutation M, and which scale
//! joint rates   Δq against ∫ q̇                      slope, joint by joint
//! joints        who moves when joint j is asked to  against who was asked
//! order, sign   how the base answers joint j        against the model's answers to all joints: momentum is conserved
//! zeros         the soles by kinematics             against the floor on which they rest, and the base at rest
//! ```

use std::f64::consts::TAU;

use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use stridemap_mujoco::{MujocoConfig, MujocoRobot, kinematic_model};
use stridemap_robot::kinematics::{inverse, rotate};
use stridemap_robot::{Hold, JointDescription, JointTargets, KinematicModel, Robot, RobotError};

use crate::error::{Invalid, LabError};
use crate::seed::{Role, stream};
use crate::task::Task;

/// Seconds of hanging still, of rocking, and of standing with half of the weight.
const STILL_S: f64 = 2.0;
const ROCK_S: f64 = 6.0;
const STAND_S: f64 = 2.0;
/// A joint's motion: there and back within this, then a rest, so far.
const BUMP_S: f64 = 0.5;
const PAUSE_S: f64 = 0.3;
const BUMP_RAD: f64 = 0.15;
/// How high the robot hangs.
const RAISED_M: f64 = 0.15;
/// Share of a motion that must be reached, or is another joint's.
const ANSWERS: f64 = 0.35;
/// How near to the end of its range a joint is at its end.
const AT_END_RAD: f64 = 0.08;
/// Angle by which gravity may be off (payload on a strap, a tilted unit), and soles.
const GRAVITY_OFF_RAD: f64 = 0.4;
const SOLE_OFF_RAD: f64 = 0.13;
/// Factors that are no other unit.
const SCALE: std::ops::Range<f64> = 0.5..2.0;

/// A fault of the wiring, named.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Miswired {
    /// What kind, in a word: `gyro_axes`.
    pub kind: String,
    /// What was found, and what it means.
    pub found: String,
}

/// One tick of the trial.
struct Look {
    time_s: f64,
    angles: Vec<f64>,
    rates: Vec<f64>,
    gyro: [f64; 3],
    down: [f64; 3],
}

/// What a robot did in the trial: where each part begins, and every tick.
struct Trial {
    looks: Vec<Look>,
    rock: usize,
    bumps: Vec<usize>,
    stand: usize,
}

/// Looks at the wiring of a task's simulated robot against its model, with the random stream of the check.
///
/// # Errors
///
/// [`LabError`] if the robot cannot be built, held or driven; faults of the wiring are the answer.
pub fn preflight(task: &Task, rng: &mut ChaCha8Rng) -> Result<Vec<Miswired>, LabError> {
    let mut robot = task.robot.build().map_err(|error| task.located(error))?;
    let gait = task.gait(robot.description())?;
    let mut twin = MujocoRobot::new(MujocoConfig { changes: None, sensors: None, ..task.robot.clone() })?;
    let model = kinematic_model(&task.robot)?;
    let told = trial(robot.as_mut(), gait.rest(), rng)?;
    let meant = trial(&mut twin, gait.rest(), rng)?;
    let joints = twin.description().joints.clone();
    let names: Vec<String> = joints.iter().map(|joint| joint.name.clone()).collect();
    let period_s = task.robot.control_period_s;
    let mut faults = Vec::new();
    let mut add = |kind: &str, found: String| faults.push(Miswired { kind: kind.into(), found });
    stamps(&told, period_s, &mut add);
    if faults.is_empty() {
        let mut add = |kind: &str, found: String| faults.push(Miswired { kind: kind.into(), found });
        gravity(&told, &meant, &mut add);
    }
    // What follows builds on both.
    if faults.is_empty() {
        let mut add = |kind: &str, found: String| faults.push(Miswired { kind: kind.into(), found });
        let gyro_is_right = gyroscope(&told, period_s, &mut add);
        let bump = bump(period_s);
        rates(&told, &names, bump.len(), period_s, &mut add);
        let answer = answers(&told, &meant, &joints, bump.len(), &mut add);
        if gyro_is_right && answer {
            reactions(&told, &meant, &names, bump.len(), &mut add);
        }
    }
    if faults.is_empty() && task.robot.left.foot.split(' ').count() == 1 {
        let mut add = |kind: &str, found: String| faults.push(Miswired { kind: kind.into(), found });
        zeros(&told, &meant, &model, gait.rest(), &mut add);
    }
    Ok(faults)
}

/// Refuses a robot that is wired wrongly, before anything is learned with it. Robots of which nobody says what they sense are
/// not looked at.
///
/// # Errors
///
/// [`LabError::Invalid`] with every fault; as [`preflight`].
pub fn refuse_miswired(task: &Task, seed: u64) -> Result<(), LabError> {
    if task.robot.sensors.is_none() {
        return Ok(());
    }
    let faults = preflight(task, &mut stream(seed, Role::Check, 4))?;
    if faults.is_empty() {
        return Ok(());
    }
    let found: Vec<String> = faults.iter().map(|fault| format!("{}: {}", fault.kind, fault.found)).collect();
    let requirement = format!("is wired wrongly ({}); nothing is learned with it", found.join("; "));
    Err(Invalid { key: "robot".into(), requirement }.into())
}

fn count(seconds: f64, period_s: f64) -> usize {
    (seconds / period_s).round() as usize
}

/// The way of a joint from rest during its motion and the pause after it, in units.
fn bump(period_s: f64) -> Vec<f64> {
    let moving = count(BUMP_S, period_s);
    let way = |k: usize| 0.5 * (1.0 - (TAU * k as f64 / moving as f64).cos());
    (0..moving).map(way).chain(std::iter::repeat_n(0.0, count(PAUSE_S, period_s))).collect()
}

/// Hangs a robot up and puts it through its motions.
fn trial(robot: &mut dyn Robot, rest: &JointTargets, rng: &mut ChaCha8Rng) -> Result<Trial, RobotError> {
    let period_s = robot.description().control_period_s;
    robot.reset(rest, rng)?;
    let mut looks = Vec::new();
    let mut look = |robot: &mut dyn Robot, targets: &JointTargets, hold: Hold| -> Result<(), RobotError> {
        robot.hold(Some(hold))?;
        let state = robot.step(targets)?;
        looks.push(Look {
            time_s: state.time_s,
            angles: state.joints.iter().map(|joint| joint.position_rad).collect(),
            rates: state.joints.iter().map(|joint| joint.velocity_rad_s).collect(),
            gyro: state.base.angular_velocity_rad_s,
            down: rotate(inverse(state.base.orientation), [0.0, 0.0, -1.0]),
        });
        Ok(())
    };
    let hanging = Hold { turned_rad: [0.0; 3], raised_m: RAISED_M, weight_share: 1.0 };
    let mut at = 0;
    for _ in 0..count(STILL_S, period_s) {
        look(robot, rest, hanging)?;
        at += 1;
    }
    let rock = at;
    for k in 0..count(ROCK_S, period_s) {
        let t = k as f64 * period_s;
        let swing = |hz: f64, rad: f64| rad * (TAU * hz * t).sin();
        let turned_rad = [swing(0.5, 0.5), swing(0.35, 0.5), swing(0.6, 0.6)];
        look(robot, rest, Hold { turned_rad, ..hanging })?;
        at += 1;
    }
    let mut bumps = Vec::new();
    let way = bump(period_s);
    let mut targets = rest.clone();
    for _ in 0..count(STILL_S, period_s) {
        look(robot, rest, hanging)?;
        at += 1;
    }
    for j in 0..rest.joints.len() {
        bumps.push(at);
        let limits = robot.description().joints[j].limits;
        let from = rest.joints[j].position_rad;
        // Away from the nearer end of its range.
        let sign = if from - limits.lower_rad < limits.upper_rad - from { 1.0 } else { -1.0 };
        for part in &way {
            targets.joints[j].position_rad = from + sign * BUMP_RAD * part;
            look(robot, &targets, hanging)?;
            at += 1;
        }
        targets.joints[j].position_rad = from;
    }
    let stand = at;
    for _ in 0..count(STAND_S, period_s) {
        look(robot, rest, Hold { turned_rad: [0.0; 3], raised_m: 0.0, weight_share: 0.5 })?;
    }
    robot.hold(None)?;
    Ok(Trial { looks, rock, bumps, stand })
}

type Add<'a> = &'a mut dyn FnMut(&str, String);

fn stamps(told: &Trial, period_s: f64, add: Add<'_>) {
    let mut steps: Vec<f64> = told.looks.windows(2).map(|pair| pair[1].time_s - pair[0].time_s).collect();
    steps.sort_by(f64::total_cmp);
    let median = steps.get(steps.len() / 2).copied().unwrap_or(period_s);
    if (median / period_s - 1.0).abs() > 0.05 {
        add("rate", format!("readings are stamped {median:.4} s apart; the policy was trained on {period_s} s"));
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn gravity(told: &Trial, meant: &Trial, add: Add<'_>) {
    let mean = |trial: &Trial| {
        let part = &trial.looks[trial.rock / 2..trial.rock];
        [0, 1, 2].map(|k| part.iter().map(|look| look.down[k]).sum::<f64>() / part.len().max(1) as f64)
    };
    let (is, should) = (mean(told), mean(meant));
    let cos = dot(is, should) / (dot(is, is) * dot(should, should)).sqrt();
    let off = cos.clamp(-1.0, 1.0).acos();
    let seen = format!("gravity is seen along ({:.2}, {:.2}, {:.2}) of the base", is[0], is[1], is[2]);
    if off > std::f64::consts::PI - GRAVITY_OFF_RAD {
        add("gravity_inverted", format!("{seen}: upside down"));
    } else if off > GRAVITY_OFF_RAD {
        add("gravity_axes", format!("{seen}, {off:.2} rad off: its axes are exchanged or turned"));
    }
}

/// Gravity's change in the base's axes over ten ticks against what each reading of the gyroscope would make of it.
fn gyroscope(told: &Trial, period_s: f64, add: Add<'_>) -> bool {
    const OVER: usize = 10;
    let part = &told.looks[told.rock..told.bumps[0]];
    let axes = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let mut best: Option<(f64, [usize; 3], [f64; 3], f64)> = None;
    for order in axes {
        for signs in 0..8_u8 {
            let sign = [0, 1, 2].map(|k| if signs >> k & 1 == 0 { 1.0 } else { -1.0 });
            let (mut xy, mut xx, mut yy) = (0.0, 0.0, 0.0);
            for window in part.windows(OVER + 1).step_by(OVER / 2) {
                let change = [0, 1, 2].map(|k| window[OVER].down[k] - window[0].down[k]);
                let mut made = [0.0; 3];
                for look in &window[1..] {
                    let omega = [0, 1, 2].map(|k| sign[k] * look.gyro[order[k]]);
                    let turned = cross(look.down, omega);
                    made = [0, 1, 2].map(|k| made[k] + turned[k] * period_s);
                }
                xy += dot(made, change);
                xx += dot(made, made);
                yy += dot(change, change);
            }
            let scale = if xx > 0.0 { xy / xx } else { 0.0 };
            let left = if scale > 0.0 { 1.0 - xy * xy / (xx * yy) } else { 1.0 };
            if best.is_none_or(|(least, ..)| left < least) {
                best = Some((left, order, sign, scale));
            }
        }
    }
    let Some((left, order, sign, scale)) = best else { return true };
    let named = |k: usize| format!("{}{}", if sign[k] < 0.0 { "-" } else { "" }, ["x", "y", "z"][order[k]]);
    let reading = format!("({}, {}, {})", named(0), named(1), named(2));
    let good = "as gravity turned while the robot was rocked";
    if left > 0.6 {
        add("gyro", format!("angular velocity does not turn {good}: no exchange of axes explains it"));
    } else if order != [0, 1, 2] {
        add("gyro_axes", format!("angular velocity turns {good} if it is read as {reading}: axes are exchanged"));
    } else if sign.iter().any(|s| *s < 0.0) {
        add("gyro_sign", format!("angular velocity turns {good} if it is read as {reading}: a sign is wrong"));
    } else if !SCALE.contains(&scale) {
        add("gyro_scale", format!("angular velocity turns {good} times {scale:.4}: another unit (57.3 deg are a rad)"));
    } else {
        return true;
    }
    false
}

/// Slope of a joint's way over its summed rate, within its own motion.
fn rates(told: &Trial, names: &[String], ticks: usize, period_s: f64, add: Add<'_>) {
    const OVER: usize = 5;
    let mut wrong = Vec::new();
    for (j, &from) in told.bumps.iter().enumerate() {
        let (mut xy, mut xx, mut yy) = (0.0, 0.0, 0.0);
        for window in told.looks[from..from + ticks].windows(OVER + 1) {
            let way = window[OVER].angles[j] - window[0].angles[j];
            let ends = 0.5 * (window[OVER].rates[j] - window[0].rates[j]);
            let made = (window[..OVER].iter().map(|look| look.rates[j]).sum::<f64>() + ends) * period_s;
            xy += way * made;
            xx += made * made;
            yy += way * way;
        }
        // A joint that hardly moved says nothing here.
        if xx > 0.0 && yy > 0.01 && xy * xy / (xx * yy) > 0.3 && !SCALE.contains(&(xy / xx)) {
            wrong.push((names[j].as_str(), xy / xx));
        }
    }
    let listed = |wrong: &[(&str, f64)]| wrong.iter().map(|(name, _)| *name).take(4).collect::<Vec<_>>().join(", ");
    let (negative, scaled): (Vec<_>, Vec<_>) = wrong.into_iter().partition(|(_, slope)| *slope < 0.0);
    if !negative.is_empty() {
        add(
            "joint_rate_sign",
            format!("{}: the rate has the other sign than the change of the angle", listed(&negative)),
        );
    }
    if let Some((_, slope)) = scaled.first() {
        let names = listed(&scaled);
        add("joint_rate_scale", format!("{names}: angles change by {slope:.4} of their rates (57.3 deg are a rad)"));
    }
}

/// Who moves when a joint is asked to; whether all answer for themselves.
fn answers(told: &Trial, meant: &Trial, joints: &[JointDescription], ticks: usize, add: Add<'_>) -> bool {
    let mut well = true;
    for (j, (&from, &model_from)) in told.bumps.iter().zip(&meant.bumps).enumerate() {
        let model = &meant.looks[model_from..model_from + ticks];
        let way: Vec<f64> = model.iter().map(|look| look.angles[j] - model[0].angles[j]).collect();
        let square: f64 = way.iter().map(|w| w * w).sum();
        let share = |i: usize| {
            let part = &told.looks[from..from + ticks];
            let mean = part.iter().map(|look| look.angles[i]).sum::<f64>() / ticks as f64;
            let mean_way = way.iter().sum::<f64>() / ticks as f64;
            let centred = square - mean_way * mean_way * ticks as f64;
            part.iter().zip(&way).map(|(look, w)| (look.angles[i] - mean) * (w - mean_way)).sum::<f64>() / centred
        };
        let own = share(j);
        if own > ANSWERS || square < 0.01 {
            continue;
        }
        // A load can have pushed a joint to its end, where it answers nothing.
        let part = &told.looks[from..from + ticks];
        let at = part.iter().map(|look| look.angles[j]).sum::<f64>() / ticks as f64;
        let limits = joints[j].limits;
        let at_its_end = at < limits.lower_rad + AT_END_RAD || at > limits.upper_rad - AT_END_RAD;
        let most = (0..joints.len()).filter(|i| *i != j).max_by(|a, b| share(*a).abs().total_cmp(&share(*b).abs()));
        let name = &joints[j].name;
        let other = most.filter(|other| share(*other).abs() > ANSWERS);
        if at_its_end && own.abs() < ANSWERS && other.is_none() {
            continue;
        }
        well = false;
        match other {
            _ if own < -ANSWERS => add("joint_sign", format!("{name} moves against its commands")),
            Some(other) => {
                add(
                    "joint_order",
                    format!("a command to {name} moves {}: commands and readings differ in order", joints[other].name),
                );
            }
            _ => add("joint_silent", format!("{name} does not answer its commands, nor does another joint")),
        }
    }
    well
}

/// How the base turned while a joint moved, along that motion.
fn reaction(trial: &Trial, from: usize, rates: &[f64]) -> [f64; 3] {
    let square: f64 = rates.iter().map(|r| r * r).sum();
    let part = &trial.looks[from..from + rates.len()];
    [0, 1, 2].map(|k| part.iter().zip(rates).map(|(look, r)| look.gyro[k] * r).sum::<f64>() / square)
}

/// Joints that are exchanged or turned around in commands and readings alike show only in how the base answers.
fn reactions(told: &Trial, meant: &Trial, names: &[String], ticks: usize, add: Add<'_>) {
    let n = names.len();
    let mut is = Vec::with_capacity(n);
    let mut should = Vec::with_capacity(n);
    let mut noise = Vec::with_capacity(n);
    // From tick to tick, so that a slow swing is no noise.
    let still = told.looks[told.rock / 2..told.rock].windows(2);
    let (ticks_seen, squares) = still.fold((0.0, 0.0), |(n, sum), pair| {
        let step = [0, 1, 2].map(|k| pair[1].gyro[k] - pair[0].gyro[k]);
        (n + 1.0, sum + dot(step, step))
    });
    let sd = (squares / (6.0 * f64::max(ticks_seen, 1.0))).sqrt();
    for j in 0..n {
        let model = &meant.looks[meant.bumps[j]..meant.bumps[j] + ticks];
        let rates: Vec<f64> = model.iter().map(|look| look.rates[j]).collect();
        let square: f64 = rates.iter().map(|r| r * r).sum();
        is.push(reaction(told, told.bumps[j], &rates));
        should.push(reaction(meant, meant.bumps[j], &rates));
        noise.push(sd / square.sqrt().max(1e-9));
    }
    let apart = |a: [f64; 3], b: [f64; 3]| [0, 1, 2].map(|k| a[k] - b[k]);
    let square = |a: [f64; 3]| dot(a, a);
    // How much worse than another reading, in units of the noise.
    let clear = |own: f64, other: f64, noise: f64| other < 0.35 * own && own - other > 36.0 * noise * noise;
    let mut turned = Vec::new();
    for j in 0..n {
        let (own, other) = (square(apart(is[j], should[j])), square(apart(is[j], should[j].map(|v| -v))));
        if clear(own, other, noise[j]) {
            turned.push(j);
        }
    }
    let mut exchanged = Vec::new();
    for i in 0..n {
        for j in i + 1..n {
            let own = square(apart(is[i], should[i])) + square(apart(is[j], should[j]));
            let other = square(apart(is[i], should[j])) + square(apart(is[j], should[i]));
            if clear(own, other, noise[i].max(noise[j])) {
                exchanged.push((i, j, other / own));
            }
        }
    }
    exchanged.sort_by(|a, b| a.2.total_cmp(&b.2));
    let (mut taken, mut pairs) = (vec![false; n], Vec::new());
    for (i, j, _) in exchanged {
        if !taken[i] && !taken[j] {
            (taken[i], taken[j]) = (true, true);
            pairs.push(format!("{} and {}", names[i], names[j]));
        }
    }
    if !pairs.is_empty() {
        let said = pairs.iter().take(4).cloned().collect::<Vec<_>>().join("; ");
        add(
            "joint_order",
            format!("the base answers {said} as if they were exchanged, in commands and readings alike"),
        );
        return;
    }
    for j in turned {
        let name = &names[j];
        add(
            "joint_sign",
            format!("the base answers {name} as if it turned the other way, in commands and readings alike"),
        );
    }
}

/// The soles, by kinematics, against the floor on which they rest, and against the base in the rest posture.
fn zeros(told: &Trial, meant: &Trial, model: &KinematicModel, rest: &JointTargets, add: Add<'_>) {
    let tilt = |trial: &Trial| {
        let part = &trial.looks[trial.stand + (trial.looks.len() - trial.stand) / 2..];
        let mut sums = [[0.0; 2]; 2];
        for look in part {
            let placed = model.place(&look.angles, [1.0, 0.0, 0.0, 0.0]);
            for (sum, up) in sums.iter_mut().zip(placed.soles_up) {
                // Against gravity, both in the base's axes.
                let off = cross(up, look.down.map(|d| -d));
                sum[0] += off[0] / part.len() as f64;
                sum[1] += off[1] / part.len() as f64;
            }
        }
        sums
    };
    let (is, should) = (tilt(told), tilt(meant));
    for (side, leg) in ["left", "right"].into_iter().enumerate() {
        let off = [0, 1].map(|k| is[side][k] - should[side][k]);
        if off[0].hypot(off[1]) > SOLE_OFF_RAD {
            let what = "a zero of a joint of that leg, or the rest posture, is wrong";
            add(
                "rest_pose",
                format!(
                    "the {leg} sole is on the floor, and by its joints {:.2} rad off it: {what}",
                    off[0].hypot(off[1])
                ),
            );
        }
    }
    let rest: Vec<f64> = rest.joints.iter().map(|joint| joint.position_rad).collect();
    let placed = model.place(&rest, [1.0, 0.0, 0.0, 0.0]);
    for (up, leg) in placed.soles_up.into_iter().zip(["left", "right"]) {
        let off = up[0].hypot(up[1]);
        if off > SOLE_OFF_RAD {
            add(
                "rest_pose",
                format!(
                    "with gait.policy.rest_rad the {leg} sole is {off:.2} rad off the base's level: a robot stands upright in its rest posture"
                ),
            );
        }
    }
}
