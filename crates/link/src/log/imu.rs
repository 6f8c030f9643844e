//! The IMU of a log alone: readings of any robot, with nothing else known of it.

use std::path::Path;

use crate::error::LinkError;
use crate::mcap_file::{self, Raw};
use crate::messages::{Imu, from_cdr};

/// What [`read_imu`] reads, in its order.
pub const IMU_COLUMNS: &[&str] = &[
    "time_s",
    "roll_rate_rad_s",
    "pitch_rate_rad_s",
    "yaw_rate_rad_s",
    "acceleration_x_m_s2",
    "acceleration_y_m_s2",
    "acceleration_z_m_s2",
];

/// Readings of the first topic of `sensor_msgs/msg/Imu` in an MCAP log, a row of [`IMU_COLUMNS`] each, in the order of
/// their stamps; a message that came twice or cannot be read is left out.
///
/// # Errors
///
/// [`LinkError::Log`] if the file is no MCAP file, or has no such message.
pub fn read_imu(path: &Path) -> Result<Vec<Vec<f64>>, LinkError> {
    let mut topic: Option<String> = None;
    let mut rows: Vec<Vec<f64>> = Vec::new();
    mcap_file::read(path, &mut |raw: &Raw<'_>| {
        if !raw.channel.schema.ends_with("/Imu") || topic.as_ref().is_some_and(|t| *t != raw.channel.topic) {
            return;
        }
        if let Some(imu) = from_cdr::<Imu>(raw.data) {
            topic.get_or_insert_with(|| raw.channel.topic.clone());
            let (w, a) = (imu.data.angular_velocity, imu.data.linear_acceleration);
            rows.push(vec![imu.header.stamp.seconds(), w.x, w.y, w.z, a.x, a.y, a.z]);
        }
    })?;
    rows.retain(|row| row.iter().all(|x| x.is_finite()));
    rows.sort_by(|a, b| a[0].total_cmp(&b[0]));
    rows.dedup_by(|a, b| a[0].total_cmp(&b[0]).is_eq());
    if rows.len() < 2 {
        let problem = "has no readings of an IMU (sensor_msgs/msg/Imu)".to_owned();
        return Err(LinkError::Log { path: path.into(), problem });
    }
    Ok(rows)
}
