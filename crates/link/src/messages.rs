//! The ROS 2 messages that pass over the link, as they lie on the wire.

use serde::{Deserialize, Serialize};
use stridemap_robot::SensorFrame;

/// `builtin_interfaces/Time`: robot time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct RosTime {
    /// Seconds.
    pub sec: i32,
    /// Nanoseconds within the second.
    pub nanosec: u32,
}

impl RosTime {
    /// From seconds, to the nanosecond; saturates.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_link::RosTime;
    ///
    /// let time = RosTime::from_seconds(2.5);
    /// assert_eq!((time.sec, time.nanosec), (2, 500_000_000));
    /// assert_eq!(time.seconds(), 2.5);
    /// ```
    #[must_use]
    pub fn from_seconds(seconds: f64) -> Self {
        Self::from_nanoseconds((seconds * 1e9).round().max(0.0) as u64)
    }

    /// From nanoseconds.
    #[must_use]
    pub const fn from_nanoseconds(nanoseconds: u64) -> Self {
        Self { sec: (nanoseconds / 1_000_000_000) as i32, nanosec: (nanoseconds % 1_000_000_000) as u32 }
    }

    /// Nanoseconds; negative times are 0.
    #[must_use]
    pub const fn nanoseconds(self) -> u64 {
        if self.sec < 0 {
            return 0;
        }
        self.sec as u64 * 1_000_000_000 + self.nanosec as u64
    }

    /// Seconds.
    #[must_use]
    pub const fn seconds(self) -> f64 {
        // One division: the nearest number to the decimal fraction.
        (self.sec as i64 * 1_000_000_000 + self.nanosec as i64) as f64 / 1e9
    }
}

/// `std_msgs/Header`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// When, in robot time.
    pub stamp: RosTime,
    /// In which frame.
    pub frame_id: String,
}

/// `sensor_msgs/JointState`. Arrays may be empty where the robot does not measure something.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointState {
    /// When.
    pub header: Header,
    /// Names of the joints.
    pub name: Vec<String>,
    /// Angles, rad.
    pub position: Vec<f64>,
    /// Rates, rad/s.
    pub velocity: Vec<f64>,
    /// Torques, N m.
    pub effort: Vec<f64>,
}

/// `geometry_msgs/Vector3`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Vector3 {
    /// Forward.
    pub x: f64,
    /// Left.
    pub y: f64,
    /// Up.
    pub z: f64,
}

impl From<[f64; 3]> for Vector3 {
    fn from([x, y, z]: [f64; 3]) -> Self {
        Self { x, y, z }
    }
}

impl From<Vector3> for [f64; 3] {
    fn from(v: Vector3) -> Self {
        [v.x, v.y, v.z]
    }
}

/// `geometry_msgs/Quaternion`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Quaternion {
    /// Vector part.
    pub x: f64,
    /// Vector part.
    pub y: f64,
    /// Vector part.
    pub z: f64,
    /// Scalar part.
    pub w: f64,
}

/// `sensor_msgs/Imu`. A covariance whose first entry is −1 says that the field is not measured (REP-145).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ImuData {
    /// Orientation of the base.
    pub orientation: Quaternion,
    /// Unknown: 0.
    pub orientation_covariance: [f64; 9],
    /// In the base's axes, rad/s.
    pub angular_velocity: Vector3,
    /// Unknown: 0.
    pub angular_velocity_covariance: [f64; 9],
    /// In the base's axes, m/s².
    pub linear_acceleration: Vector3,
    /// Not measured: −1.
    pub linear_acceleration_covariance: [f64; 9],
}

/// `sensor_msgs/Imu`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Imu {
    /// When.
    pub header: Header,
    /// What.
    pub data: ImuData,
}

/// `geometry_msgs/WrenchStamped`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WrenchStamped {
    /// When.
    pub header: Header,
    /// Force, N.
    pub force: Vector3,
    /// Torque, N m.
    pub torque: Vector3,
}

/// `rosgraph_msgs/Clock`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Clock {
    /// Robot time.
    pub clock: RosTime,
}

/// `std_msgs/MultiArrayDimension`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Dimension {
    /// Name.
    pub label: String,
    /// Entries.
    pub size: u32,
    /// Entries per step.
    pub stride: u32,
}

/// `std_msgs/MultiArrayLayout`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Layout {
    /// Dimensions.
    pub dim: Vec<Dimension>,
    /// Where the data begin.
    pub data_offset: u32,
}

/// `std_msgs/Float64MultiArray`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Float64MultiArray {
    /// Layout; empty.
    pub layout: Layout,
    /// Numbers.
    pub data: Vec<f64>,
}

/// `std_msgs/UInt64MultiArray`: the heartbeat, `[sequence, stamp of the answered state in ns]`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct UInt64MultiArray {
    /// Layout; empty.
    pub layout: Layout,
    /// Numbers.
    pub data: Vec<u64>,
}

/// `std_msgs/String`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Text {
    /// The text.
    pub data: String,
}

/// `trajectory_msgs/JointTrajectoryPoint`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrajectoryPoint {
    /// Angles, rad.
    pub positions: Vec<f64>,
    /// Rates, rad/s.
    pub velocities: Vec<f64>,
    /// Accelerations, rad/s².
    pub accelerations: Vec<f64>,
    /// Torques, N m.
    pub effort: Vec<f64>,
    /// When, after the trajectory's start.
    pub time_from_start: RosTime,
}

/// `trajectory_msgs/JointTrajectory`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointTrajectory {
    /// When it starts; 0: at once.
    pub header: Header,
    /// Which joints.
    pub joint_names: Vec<String>,
    /// The points, in time.
    pub points: Vec<TrajectoryPoint>,
}

/// A message with its ROS 2 type and the definition that a log carries.
pub(crate) trait RosMessage: Serialize + for<'de> Deserialize<'de> + Clone + Send + 'static {
    /// Package and name of the type.
    const TYPE: (&'static str, &'static str);
    /// Definition, with those of the types it is made of.
    const DEFINITION: &'static str;
}

#[cfg(test)]
const RULE: &str = "\n================================================================================\nMSG: ";

macro_rules! ros_message {
    ($type:ty, $package:literal, $name:literal, $definition:expr) => {
        impl RosMessage for $type {
            const TYPE: (&'static str, &'static str) = ($package, $name);
            const DEFINITION: &'static str = $definition;
        }
    };
}

macro_rules! rule {
    () => {
        "\n================================================================================\nMSG: "
    };
}

macro_rules! header {
    () => {
        concat!(
            rule!(),
            "std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id",
            rule!(),
            "builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
        )
    };
}

macro_rules! vector3 {
    () => {
        concat!(rule!(), "geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n")
    };
}

macro_rules! layout {
    () => {
        concat!(
            rule!(),
            "std_msgs/MultiArrayLayout\nMultiArrayDimension[] dim\nuint32 data_offset",
            rule!(),
            "std_msgs/MultiArrayDimension\nstring label\nuint32 size\nuint32 stride\n"
        )
    };
}

ros_message!(
    JointState,
    "sensor_msgs",
    "JointState",
    concat!(
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort",
        header!()
    )
);
ros_message!(
    Imu,
    "sensor_msgs",
    "Imu",
    concat!(
        "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n\
         geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n\
         geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance",
        rule!(),
        "geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w",
        vector3!(),
        header!()
    )
);
ros_message!(
    WrenchStamped,
    "geometry_msgs",
    "WrenchStamped",
    concat!(
        "std_msgs/Header header\ngeometry_msgs/Wrench wrench",
        rule!(),
        "geometry_msgs/Wrench\ngeometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque",
        vector3!(),
        header!()
    )
);
ros_message!(
    Clock,
    "rosgraph_msgs",
    "Clock",
    concat!("builtin_interfaces/Time clock", rule!(), "builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n")
);
ros_message!(
    Float64MultiArray,
    "std_msgs",
    "Float64MultiArray",
    concat!("MultiArrayLayout layout\nfloat64[] data", layout!())
);
ros_message!(
    UInt64MultiArray,
    "std_msgs",
    "UInt64MultiArray",
    concat!("MultiArrayLayout layout\nuint64[] data", layout!())
);
ros_message!(Text, "std_msgs", "String", "string data\n");
ros_message!(
    JointTrajectory,
    "trajectory_msgs",
    "JointTrajectory",
    concat!(
        "std_msgs/Header header\nstring[] joint_names\ntrajectory_msgs/JointTrajectoryPoint[] points",
        rule!(),
        "trajectory_msgs/JointTrajectoryPoint\nfloat64[] positions\nfloat64[] velocities\n\
         float64[] accelerations\nfloat64[] effort\nbuiltin_interfaces/Duration time_from_start",
        rule!(),
        "builtin_interfaces/Duration\nint32 sec\nuint32 nanosec",
        header!()
    )
);

/// A message as CDR with its encapsulation header (little endian), as ROS 2 logs hold it.
pub(crate) fn to_cdr<M: RosMessage>(message: &M) -> Option<Vec<u8>> {
    let body = cdr_encoding::to_vec::<M, byteorder::LittleEndian>(message).ok()?;
    let mut bytes = vec![0, 1, 0, 0];
    bytes.extend(body);
    Some(bytes)
}

/// A message from CDR with its encapsulation header.
pub(crate) fn from_cdr<M: RosMessage>(bytes: &[u8]) -> Option<M> {
    let (head, body) = bytes.split_at_checked(4)?;
    let read = match head[..2] {
        [0, 1] => cdr_encoding::from_bytes::<M, byteorder::LittleEndian>(body),
        [0, 0] => cdr_encoding::from_bytes::<M, byteorder::BigEndian>(body),
        // Another encoding than plain CDR.
        _ => return None,
    };
    read.ok().map(|(message, _)| message)
}

/// The stamp of a message that begins with a header, in nanoseconds.
pub(crate) fn stamp_of(bytes: &[u8]) -> Option<u64> {
    let word = |at: usize| bytes.get(at..at + 4)?.try_into().ok();
    let (sec, nanosec) = match bytes.get(1)? & 1 {
        1 => (i32::from_le_bytes(word(4)?), u32::from_le_bytes(word(8)?)),
        _ => (i32::from_be_bytes(word(4)?), u32::from_be_bytes(word(8)?)),
    };
    (sec >= 0).then(|| RosTime { sec, nanosec }.nanoseconds())
}

/// A reading as messages.
pub(crate) fn to_messages(
    frame: &SensorFrame,
    names: &[String],
    header: &Header,
) -> (JointState, Imu, [WrenchStamped; 2]) {
    let [w, x, y, z] = frame.orientation;
    let mut absent = [0.0; 9];
    absent[0] = -1.0;
    let wrench = |load_n: f64| WrenchStamped {
        header: header.clone(),
        force: [0.0, 0.0, load_n].into(),
        torque: [0.0; 3].into(),
    };
    (
        JointState {
            header: header.clone(),
            name: names.to_vec(),
            position: frame.joints.iter().map(|j| j.position_rad).collect(),
            velocity: frame.joints.iter().map(|j| j.velocity_rad_s).collect(),
            effort: frame.joints.iter().map(|j| j.torque_nm).collect(),
        },
        Imu {
            header: header.clone(),
            data: ImuData {
                orientation: Quaternion { x, y, z, w },
                angular_velocity: frame.angular_velocity_rad_s.into(),
                linear_acceleration_covariance: absent,
                ..ImuData::default()
            },
        },
        frame.loads_n.map(wrench),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_survive_the_wire_format() {
        let message = JointState {
            header: Header { stamp: RosTime::from_seconds(1.25), frame_id: "base".into() },
            name: vec!["a".into(), "knee".into()],
            position: vec![0.1, -0.2],
            velocity: vec![],
            effort: vec![1.0, 2.0],
        };
        let bytes = to_cdr(&message).unwrap();
        assert_eq!(from_cdr::<JointState>(&bytes), Some(message));
        let imu = Imu::default();
        // Header: 8 of time, 4 + 1 of an empty string, 3 to align; then 37 numbers of 8 bytes.
        assert_eq!(to_cdr(&imu).unwrap().len(), 4 + 16 + 37 * 8);
        assert_eq!(from_cdr::<Imu>(&to_cdr(&imu).unwrap()), Some(imu));
        assert_eq!(from_cdr::<Imu>(&[0, 1]), None);
    }

    #[test]
    fn definitions_name_every_type_they_use() {
        assert!(JointTrajectory::DEFINITION.contains(&format!("{RULE}builtin_interfaces/Duration")));
        assert!(Imu::DEFINITION.contains(&format!("{RULE}geometry_msgs/Quaternion")));
    }
}
