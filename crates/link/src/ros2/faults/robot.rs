//! Rows of the fault table that the robot makes, or somebody beside it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use stridemap_robot::{Machine, RobotError, Ros2Config, SensorFrame};

use super::rig::{Rig, walk};
use super::stand_in::{JOINTS, PERIOD_S, StandIn, limits, names};
use super::{FaultRow, ms};
use crate::error::LinkError;
use crate::messages::{Float64MultiArray, Header, Imu, JointState, RosTime, WrenchStamped, to_messages};
use crate::operator::AlwaysConfirms;
use crate::ros2::node::{LinkNode, drain};
use crate::ros2::remote::RemoteMachine;
use crate::ros2::stop::send_stop;

fn generator() -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(0)
}

/// Somebody else commands the robot during a stride, and is there when the next one would begin.
pub(super) fn second_writer(link: &Ros2Config) -> Result<FaultRow, LinkError> {
    let mut rig = Rig::start(link)?;
    let mut controller = rig.controller()?;
    let raw = rig.raw()?;
    walk(&mut controller, 50)?;
    let start_s = controller.frame().time_s;
    let began = Instant::now();
    let mut after = Ok(());
    let mut farthest: f64 = 0.0;
    for _ in 0..200 {
        raw.command(vec![0.9; JOINTS]);
        after = walk(&mut controller, 1);
        let angles = controller.frame().joints.iter().map(|j| j.position_rad.abs());
        farthest = angles.fold(farthest, f64::max);
        if after.is_err() {
            break;
        }
    }
    let took_s = controller.frame().time_s - start_s;
    // The controller may hear of the second before the robot has said what it did with its commands.
    rig.listener.wait(began, Duration::from_secs(2), |s| s.refusals.second_writer > 0);
    let refused = rig.last().refusals.second_writer;
    // The second goes on until it has the robot; a new start is then refused.
    let stop = AtomicBool::new(false);
    let again = std::thread::scope(|scope| {
        scope.spawn(|| {
            while !stop.load(Ordering::Relaxed) {
                raw.command(vec![0.1; JOINTS]);
                std::thread::sleep(Duration::from_millis(8));
            }
        });
        // Long enough for the robot to take the second for its writer.
        std::thread::sleep(Duration::from_millis(1500));
        let again = controller.reset(&[0.0; JOINTS], &mut generator()).map(|_| ());
        stop.store(true, Ordering::Relaxed);
        again
    });
    let why = again.err().map(|e| e.to_string()).unwrap_or_default();
    let kept_out = why.contains("somebody else");
    Ok(FaultRow::new(
        "second writer",
        format!(
            "robot refuses {refused} of the second's commands and does not move to them; stride aborted after \
             {}; a start beside it is {}",
            ms(took_s),
            if kept_out { "refused" } else { "NOT refused" }
        ),
        Some(took_s),
        after.is_err() && farthest < 0.5,
        refused > 0 && kept_out,
    ))
}

/// The emergency stop is pressed during a stride, latches, and is re-armed.
pub(super) fn emergency_stop(link: &Ros2Config) -> Result<FaultRow, LinkError> {
    let rig = Rig::start(link)?;
    let mut controller = rig.controller()?;
    walk(&mut controller, 50)?;
    let began = Instant::now();
    let after = std::thread::scope(|scope| {
        scope.spawn(|| send_stop(&rig.robot_side, "fault table", false));
        walk(&mut controller, 2000)
    });
    let stopped = matches!(after, Err(RobotError::EmergencyStop { .. }));
    rig.listener.wait(began, Duration::from_secs(2), |s| s.stopped.is_some() && s.act == "damp");
    // How long the robot followed after the stop was pressed: from its own words.
    let heard = rig.listener.since(began);
    let pressed = heard.iter().find(|s| s.stopped.is_some());
    let damped = heard.iter().find(|s| s.stopped.is_some() && s.act == "damp");
    let within_s = match (pressed, damped) {
        (Some(pressed), Some(damped)) => Some((damped.time_s - pressed.time_s).max(0.0)),
        _ => None,
    };
    let again = controller.reset(&[0.0; JOINTS], &mut generator()).map(|_| ());
    let latched = matches!(again, Err(RobotError::EmergencyStop { .. }));
    let rearmed = Instant::now();
    let _ = send_stop(&rig.robot_side, "", true)?;
    rig.listener.wait(rearmed, Duration::from_secs(2), |s| s.stopped.is_none());
    let moves = controller.reset(&[0.0; JOINTS], &mut generator()).is_ok();
    Ok(FaultRow::new(
        "e-stop during a stride",
        format!(
            "robot gives way within {} of hearing it, {}, {} re-armed by hand; stride aborted",
            ms(within_s.unwrap_or(f64::NAN)),
            if latched { "refuses to start" } else { "STARTS AGAIN" },
            if moves { "moves once" } else { "does NOT move when" }
        ),
        within_s,
        stopped,
        within_s.is_some_and(|s| s <= PERIOD_S + 1e-6) && latched && moves,
    ))
}

/// What a lying robot may change of period `k` after it began to lie: its reading, its clock, whether the left
/// foot speaks.
pub(super) type Lie = fn(k: u64, frame: &mut SensorFrame, stamp_ns: &mut u64, foot: &mut bool);

/// A robot whose sensors can be made to lie. It has no guard and no status: a real robot need not have any.
pub(super) fn lying_robot(link: &Ros2Config, fault: &str, lie: Lie) -> Result<FaultRow, LinkError> {
    let link = Ros2Config { silence_s: 0.5, sets_itself_up: false, ..link.clone() };
    let mut node = LinkNode::open(&link, "liar")?;
    let joints = node.publisher::<JointState>(&link.joint_states)?;
    let imu = node.publisher::<Imu>(&link.imu)?;
    let feet = [node.publisher::<WrenchStamped>(&link.left_foot)?, node.publisher::<WrenchStamped>(&link.right_foot)?];
    let commands = node.subscription::<Float64MultiArray>(&link.commands)?;
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    let lied_at = Arc::new(Mutex::new(None::<Instant>));
    let when = Arc::clone(&lied_at);
    let liar = std::thread::spawn(move || {
        // The node lives as long as its robot.
        let _node = node;
        let mut machine = StandIn::new();
        let mut lies_from = None;
        let mut commanded = 0_u64;
        for k in 0..10_000_u64 {
            if flag.load(Ordering::Relaxed) {
                break;
            }
            if let Some((message, _)) = drain(&commands, &mut 0).pop() {
                commanded += 1;
                let _ = machine.step(&message.data);
            }
            if commanded == 100 && lies_from.is_none() {
                lies_from = Some(k);
                if let Ok(mut at) = when.lock() {
                    *at = Some(Instant::now());
                }
            }
            let mut frame = machine.frame().clone();
            let mut stamp = 10_000_000_000 + k * 8_000_000;
            let mut foot = true;
            if let Some(from) = lies_from {
                lie(k - from, &mut frame, &mut stamp, &mut foot);
            }
            let header = || Header { stamp: RosTime::from_nanoseconds(stamp), frame_id: "base".into() };
            let (js, im, [left, right]) = to_messages(&frame, &names(), &header());
            if foot {
                let _ = feet[0].publish(left);
            }
            let _ = feet[1].publish(right);
            let _ = imu.publish(im);
            let _ = joints.publish(js);
            std::thread::sleep(Duration::from_millis(8));
        }
    });
    let result = (|| {
        let mut controller = RemoteMachine::open(&link, names(), limits(), PERIOD_S, Box::new(AlwaysConfirms))?;
        controller.reset(&[0.0; JOINTS], &mut generator())?;
        let after = walk(&mut controller, 1000);
        // On this machine's clock: the robot's own may be what lies.
        let since = lied_at.lock().ok().and_then(|at| *at);
        let took_s = since.map_or(f64::NAN, |at| at.elapsed().as_secs_f64());
        let said = after.as_ref().err().map(ToString::to_string);
        let aborted = matches!(after, Err(RobotError::Link { .. }));
        let seen = format!(
            "stride aborted after {} ({}); the robot has no more commands",
            ms(took_s),
            said.unwrap_or_default()
        );
        Ok(FaultRow::new(fault, seen, Some(took_s), aborted, since.is_some()))
    })();
    stop.store(true, Ordering::Relaxed);
    let _ = liar.join();
    result
}
