//! The fault table: every fault of network, messages and robot, tried on a running link, and what was seen.
//!
//! The robot is a stand-in of four perfect servos behind [`serve`](crate::serve), the controller a
//! [`RemoteMachine`](crate::RemoteMachine), and between them a [`BadNetwork`](crate::BadNetwork). Faults of
//! processes are tried on processes, by the tests of the command.

mod messages;
mod network;
mod rig;
mod robot;
mod stand_in;

use stridemap_robot::Ros2Config;

use crate::error::LinkError;
use crate::guard::Refusals;
use crate::ros2::network::NetworkConditions;

/// One row of the fault table.
#[derive(Clone, Debug)]
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

/// What was seen, or that the fault could not be tried and why.
fn tried(fault: &str, seen: Result<FaultRow, LinkError>) -> FaultRow {
    seen.unwrap_or_else(|error| FaultRow::new(fault, format!("could not be tried: {error}"), None, true, false))
}

fn ms(seconds: f64) -> String {
    format!("{:.0} ms", 1e3 * seconds)
}

/// Tries every fault of network, messages and robot on a running link and tells `row` what was seen, as soon as
/// it is known. Rows use domains of their own, 32 from the configuration's on.
/// A row that could not be tried (the network cannot be joined, a link without a fault does not work) says so and
/// is not ok; the others go on.
pub fn fault_table(link: &Ros2Config, row: &mut dyn FnMut(FaultRow)) {
    let mut domain = link.domain;
    let mut next = || {
        let link = Ros2Config { domain, ..link.clone() };
        // The robot's and the controller's.
        domain += 2;
        link
    };
    for for_ms in [20, 60, 500, 5000] {
        let fault = format!("network cut for {for_ms} ms");
        row(tried(&fault, network::cut(&next(), for_ms)));
    }
    row(tried("every message delayed by 200 ms", network::delayed(&next(), 0.2)));
    let fair = NetworkConditions::default();
    type Counted = fn(&Refusals) -> u64;
    let borne: [(&str, NetworkConditions, Counted, &str); 3] = [
        (
            "reordered: one of 5 messages overtaken by the next",
            NetworkConditions { overtake_one_of: Some(5), ..fair },
            |r| r.out_of_order,
            "heartbeats out of order refused",
        ),
        (
            "duplicated: every message twice",
            NetworkConditions { twice: true, ..fair },
            |r| r.out_of_order,
            "heartbeats refused as known",
        ),
        (
            "5 % lost: one of 20 messages of each topic",
            NetworkConditions { lose_one_of: Some(20), ..fair },
            |r| r.stale,
            "commands refused",
        ),
    ];
    for (fault, conditions, counted, what) in borne {
        row(tried(fault, network::borne(&next(), fault, conditions, counted, what)));
    }
    match messages::bad_messages(&next()) {
        Ok(rows) => rows.into_iter().for_each(&mut *row),
        Err(error) => row(tried("bad messages", Err(error))),
    }
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
        row(tried(fault, robot::lying_robot(&next(), fault, lie)));
    }
    row(tried("e-stop during a stride", robot::emergency_stop(&next())));
    row(tried("second writer", robot::second_writer(&next())));
}
