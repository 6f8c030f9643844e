//! The fault table: every fault of network, messages and robot, tried on a running link, and what was seen.
//!
//! The robot is a stand-in of four perfect servos behind [`serve`](crate::serve), the controller a
//! [`RemoteMachine`](crate::RemoteMachine), and between them a [`BadNetwork`](crate::BadNetwork). Faults of
//! processes are tried on processes: `stridemap faults` does that.

mod messages;
mod network;
mod rig;
mod robot;
mod stand_in;

use serde::Serialize;
use stridemap_robot::Ros2Config;

use crate::error::LinkError;
use crate::network::Weather;

/// One row of the fault table.
#[derive(Clone, Debug, Serialize)]
pub struct FaultRow {
    /// What was done to the link.
    pub fault: String,
    /// What was seen of the robot and of the controller.
    pub seen: String,
    /// Within how many milliseconds it was safe; `None` where it needed not react. Of holding: the robot's own
    /// silence, in its time.
    pub within_ms: Option<f64>,
    /// Whether no stride with the fault in it became data: it was aborted, or the fault did not reach the
    /// robot's motion.
    pub no_bad_stride: bool,
    /// Whether everything was as it must be.
    pub ok: bool,
}

impl FaultRow {
    /// A row; `within_s` in seconds, `as_it_must` besides the strides.
    #[must_use]
    pub fn new(
        fault: impl Into<String>,
        seen: impl Into<String>,
        within_s: Option<f64>,
        no_bad_stride: bool,
        as_it_must: bool,
    ) -> Self {
        Self {
            fault: fault.into(),
            seen: seen.into(),
            within_ms: within_s.map(|s| 1e3 * s),
            no_bad_stride,
            ok: as_it_must && no_bad_stride,
        }
    }

    /// Whether a robot that was left without commands held as soon as it must, by its own silence.
    #[must_use]
    pub fn held_in_time(hold_s: Option<f64>) -> bool {
        hold_s.is_some_and(|s| s < HOLD_WITHIN_S)
    }
}

/// Robot time within which a robot without commands must hold: the bound, two periods, and what a loaded
/// machine adds.
const HOLD_WITHIN_S: f64 = 0.05 + 2.0 * stand_in::PERIOD_S + 0.05;

fn ms(seconds: f64) -> String {
    format!("{:.0} ms", 1e3 * seconds)
}

/// Tries every fault of network, messages and robot on a running link and tells `row` what was seen, as soon as
/// it is known. Rows use domains of their own, from the configuration's on: [`FAULT_DOMAINS`] of them.
///
/// # Errors
///
/// [`LinkError`] if the network cannot be joined, or a link without a fault does not work.
pub fn fault_table(link: &Ros2Config, row: &mut dyn FnMut(FaultRow)) -> Result<(), LinkError> {
    let mut domain = link.domain;
    let mut next = || {
        let link = Ros2Config {
            domain,
            ..link.clone()
        };
        // The robot's and the controller's.
        domain += 2;
        link
    };
    for for_ms in [20, 60, 500, 5000] {
        row(network::cut(&next(), for_ms)?);
    }
    row(network::delayed(&next(), 0.2)?);
    let fair = Weather::default();
    row(network::borne(
        &next(),
        "reordered: one of 5 messages overtaken by the next",
        Weather {
            overtake_one_of: Some(5),
            ..fair
        },
        |r| r.out_of_order,
        "heartbeats out of order refused",
    )?);
    row(network::borne(
        &next(),
        "duplicated: every message twice",
        Weather {
            twice: true,
            ..fair
        },
        |r| r.out_of_order,
        "heartbeats refused as known",
    )?);
    row(network::borne(
        &next(),
        "5 % lost: one of 20 messages of each topic",
        Weather {
            lose_one_of: Some(20),
            ..fair
        },
        |r| r.stale,
        "commands refused",
    )?);
    messages::bad_messages(&next())?
        .into_iter()
        .for_each(&mut *row);
    let lies: [(&str, robot::Lie); 5] = [
        ("clock jumped back by 5 s", |_, _, stamp, _| {
            *stamp -= 5_000_000_000;
        }),
        ("clock jumped forth by 5 s", |_, _, stamp, _| {
            *stamp += 5_000_000_000;
        }),
        ("NaN in a state", |_, frame, _, _| {
            frame.orientation[2] = f64::NAN;
        }),
        ("joint stuck", |_, frame, _, _| {
            frame.joints[2].position_rad = 0.1;
        }),
        ("foot-load sensor silent", |_, _, _, foot| *foot = false),
    ];
    for (fault, lie) in lies {
        row(robot::lying_robot(&next(), fault, lie)?);
    }
    row(robot::emergency_stop(&next())?);
    row(robot::second_writer(&next())?);
    Ok(())
}

/// Domains that [`fault_table`] uses.
pub const FAULT_DOMAINS: u16 = 32;
