//! The emergency stop, pressed from afar.
//!
//! It must not depend on one packet, nor on one match: a reader may not know of a writer that knows of it,
//! and what is sent then is lost. So it is pressed until the robot says that it stopped.

use std::time::{Duration, Instant};

use stridemap_robot::Ros2Config;

use crate::error::LinkError;
use crate::messages::Text;
use crate::ros2::node::{LinkNode, Topics, drain};
use crate::served::Status;

/// How often it is pressed.
pub(crate) const STOP_PERIOD: Duration = Duration::from_millis(5);

/// Presses, or after `rearm` releases, the emergency stop of the robot on a network, again and again until
/// the robot's status says that it did. Tells whether the robot said so in time.
///
/// # Errors
///
/// [`LinkError`] if the network cannot be joined.
pub fn send_stop(link: &Ros2Config, reason: &str, rearm: bool) -> Result<bool, LinkError> {
    let mut node = LinkNode::open(link, "stridemap_stop")?;
    let topic = if rearm { Topics::REARM } else { Topics::STOP };
    let publisher = node.publisher::<Text>(topic)?;
    let statuses = node.subscription::<Text>(Topics::STATUS)?;
    let deadline = Instant::now() + Duration::from_secs_f64(link.connect_s);
    while Instant::now() < deadline {
        let _ = publisher.publish(Text { data: reason.to_owned() });
        std::thread::sleep(STOP_PERIOD);
        let heard = drain(&statuses, &mut 0);
        let newest = heard.iter().rev().find_map(|(m, _)| serde_json::from_str::<Status>(&m.data).ok());
        if newest.is_some_and(|s| s.stopped.is_some() != rearm) {
            return Ok(true);
        }
    }
    Ok(false)
}
