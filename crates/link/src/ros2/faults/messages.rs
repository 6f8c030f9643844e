//! Rows of the fault table that messages make.

use std::time::{Duration, Instant};

use stridemap_robot::Ros2Config;

use super::rig::Rig;
use super::stand_in::{JOINTS, limits};
use super::{FaultRow, ms};
use crate::error::LinkError;
use crate::served::Status;

/// Good commands, then bad ones: the robot must refuse and count them, and go on with the good.
pub(super) fn bad_messages(link: &Ros2Config) -> Result<Vec<FaultRow>, LinkError> {
    let mut rig = Rig::start(link)?;
    let raw = rig.raw()?;
    let mut sequence = 0;
    let mut good = || {
        sequence += 1;
        raw.beat(sequence, raw.stamp());
        raw.command(vec![0.0; JOINTS]);
    };
    type Count = fn(&Status) -> u64;
    let nan = || {
        raw.command(vec![f64::NAN; JOINTS]);
        raw.command(vec![f64::INFINITY; JOINTS]);
    };
    let short = || raw.command(vec![0.0; JOINTS - 1]);
    let again = || {
        // Both are older than what was sent before.
        raw.beat(2, 1);
        raw.beat(1, 1);
    };
    let far = || raw.command(vec![3.0; JOINTS]);
    let tries: [(&str, Count, &dyn Fn()); 4] = [
        ("NaN, infinite", |s| s.refusals.not_finite, &nan),
        ("wrong length", |s| s.refusals.wrong_length, &short),
        ("old heartbeats", |s| s.refusals.out_of_order, &again),
        (
            "limits exceeded (3 rad where 1 is the limit)",
            |s| s.refusals.position_clamped + s.refusals.rate_limited,
            &far,
        ),
    ];
    let mut rows = Vec::new();
    for (fault, count, bad) in tries {
        for _ in 0..20 {
            good();
        }
        let before = rig.last();
        raw.seen();
        let began = Instant::now();
        bad();
        rig.listener.wait(began, Duration::from_secs(2), |s| count(s) > count(&before));
        let took_s = began.elapsed().as_secs_f64();
        for _ in 0..10 {
            good();
        }
        let joints = raw.seen();
        let seen = count(&rig.last()) - count(&before);
        let follows = rig.last().act == "follow";
        let limits = limits()[0];
        let within =
            joints.fastest_rad_s <= limits.velocity_rad_s * (1.0 + 1e-6) && joints.farthest_rad <= limits.upper_rad;
        rows.push(FaultRow::new(
            fault,
            format!(
                "robot refuses or clamps {seen}, told after {}; its joints turn at up to {:.1} rad/s (limit \
                 {:.1}); it follows the next good command",
                ms(took_s),
                joints.fastest_rad_s,
                limits.velocity_rad_s
            ),
            Some(took_s),
            within,
            seen > 0 && follows,
        ));
    }
    Ok(rows)
}
