//! Rows of the fault table that the network makes.

use std::time::{Duration, Instant};

use stridemap_robot::{RobotError, Ros2Config};

use super::rig::{Rig, walk};
use super::stand_in::PERIOD_S;
use super::{FaultRow, ms};
use crate::error::LinkError;
use crate::guard::Refusals;
use crate::ros2::network::NetworkConditions;
use crate::served::Status;

/// Silence, in robot time, after which the robot was first heard to do this.
fn silence_at(heard: &[Status], act: &str) -> Option<f64> {
    let mut doing = heard.iter().filter(|s| s.act == act);
    doing.find_map(|s| s.silence_s)
}

/// Nothing passes for a while, in either direction.
pub(super) fn cut(link: &Ros2Config, for_ms: u64) -> Result<FaultRow, LinkError> {
    let rig = Rig::start(link)?;
    let mut controller = rig.controller()?;
    walk(&mut controller, 50)?;
    let began = Instant::now();
    let for_s = 1e-3 * for_ms as f64;
    rig.network.set(NetworkConditions { cut: true, ..NetworkConditions::default() });
    let after = std::thread::scope(|scope| {
        scope.spawn(|| {
            std::thread::sleep(Duration::from_millis(for_ms));
            rig.network.set(NetworkConditions::default());
        });
        walk(&mut controller, 10 + (for_s / PERIOD_S) as usize)
    });
    // What the robot did in the cut, not in the silence after this walk.
    let heard = rig.listener.since(began);
    let (hold, damp) = (silence_at(&heard, "hold"), silence_at(&heard, "damp"));
    let aborted = matches!(after, Err(RobotError::Link { .. }));
    let did = match (hold, damp) {
        (None, _) => "follows on".to_owned(),
        (Some(hold), None) => format!("holds after {}", ms(hold)),
        (Some(hold), Some(damp)) => {
            format!("holds after {}, gives way after {}", ms(hold), ms(damp))
        }
    };
    let told = after.err().map_or("goes on".into(), |e| format!("aborted ({e})"));
    let in_time = if for_s > 0.05 + PERIOD_S {
        FaultRow::held_in_time(hold) && (for_s < 0.6 || damp.is_some())
    } else {
        damp.is_none()
    };
    Ok(FaultRow::new(
        format!("network cut for {for_ms} ms"),
        format!("robot {did}; stride {told}"),
        hold,
        // Where the robot held, what followed must not be data.
        hold.is_none() || aborted,
        in_time,
    ))
}

/// Every message is late: the robot must not follow answers to states long past.
pub(super) fn delayed(link: &Ros2Config, delay_s: f64) -> Result<FaultRow, LinkError> {
    let rig = Rig::start(link)?;
    let mut controller = rig.controller()?;
    walk(&mut controller, 50)?;
    let began = Instant::now();
    rig.network.set(NetworkConditions { delay_s, ..NetworkConditions::default() });
    let after = walk(&mut controller, 200);
    let aborted_s = began.elapsed().as_secs_f64();
    let is_safe = |s: &Status| s.act != "follow";
    rig.listener.wait(began, Duration::from_secs(2), is_safe);
    let heard = rig.listener.since(began);
    let hold = silence_at(&heard, "hold");
    let stale = heard.iter().map(|s| s.refusals.stale).max().unwrap_or(0);
    let aborted = matches!(after, Err(RobotError::Link { .. }));
    Ok(FaultRow::new(
        format!("every message delayed by {}", ms(delay_s)),
        format!(
            "robot holds after {}, refuses {stale} late answers; stride aborted after {}",
            ms(hold.unwrap_or(f64::NAN)),
            ms(aborted_s)
        ),
        hold,
        aborted,
        FaultRow::held_in_time(hold),
    ))
}

/// The network does something that the link must bear: the stride goes on and the robot follows all the while.
pub(super) fn borne(
    link: &Ros2Config,
    fault: &str,
    conditions: NetworkConditions,
    noticed: fn(&Refusals) -> u64,
    counted: &str,
) -> Result<FaultRow, LinkError> {
    let rig = Rig::start(link)?;
    let mut controller = rig.controller()?;
    walk(&mut controller, 50)?;
    let (began, before) = (Instant::now(), noticed(&rig.last().refusals));
    let missed_before = controller.counts().missed;
    rig.network.set(conditions);
    let after = walk(&mut controller, 250);
    let heard = rig.listener.since(began);
    let followed = heard.iter().all(|s| s.act == "follow");
    let refused = noticed(&rig.last().refusals) - before;
    let missed = controller.counts().missed - missed_before;
    let told = after.as_ref().err().map(ToString::to_string);
    Ok(FaultRow::new(
        fault,
        format!(
            "robot {}, {refused} {counted}; controller misses {missed} of 250 states; stride {}",
            if followed { "follows on" } else { "STOPS" },
            told.unwrap_or_else(|| "goes on".into())
        ),
        None,
        true,
        followed && after.is_ok() && (refused > 0 || missed > 0),
    ))
}
