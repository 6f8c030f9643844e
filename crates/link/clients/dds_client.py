"""A ROS 2 client that none of us wrote: reads the robot's joint states with Cyclone DDS and commands it.

Usage: dds_client.py DOMAIN. Prints what it saw as JSON; exits with 1 if a joint did not go where it was
sent, by forward commands and by a trajectory.
"""

import json
import sys
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


@dataclass
class Dimension(IdlStruct, typename="std_msgs::msg::dds_::MultiArrayDimension_"):
    label: str
    size: uint32
    stride: uint32


@dataclass
class Layout(IdlStruct, typename="std_msgs::msg::dds_::MultiArrayLayout_"):
    dim: sequence[Dimension]
    data_offset: uint32


@dataclass
class Float64MultiArray(IdlStruct, typename="std_msgs::msg::dds_::Float64MultiArray_"):
    layout: Layout
    data: sequence[float64]


@dataclass
class Duration(IdlStruct, typename="builtin_interfaces::msg::dds_::Duration_"):
    sec: int32
    nanosec: uint32


@dataclass
class Point(IdlStruct, typename="trajectory_msgs::msg::dds_::JointTrajectoryPoint_"):
    positions: sequence[float64]
    velocities: sequence[float64]
    accelerations: sequence[float64]
    effort: sequence[float64]
    time_from_start: Duration


@dataclass
class JointTrajectory(IdlStruct, typename="trajectory_msgs::msg::dds_::JointTrajectory_"):
    header: Header
    joint_names: sequence[str]
    points: sequence[Point]


def main():
    participant = DomainParticipant(int(sys.argv[1]))
    qos = Qos(
        Policy.Reliability.Reliable(duration(milliseconds=100)),
        Policy.Durability.Volatile,
        Policy.History.KeepLast(8),
    )
    states = DataReader(participant, Topic(participant, "rt/joint_states", JointState, qos=qos), qos=qos)
    name = "rt/forward_command_controller/commands"
    commands = DataWriter(participant, Topic(participant, name, Float64MultiArray, qos=qos), qos=qos)

    name = "rt/joint_trajectory_controller/joint_trajectory"
    trajectories = DataWriter(participant, Topic(participant, name, JointTrajectory, qos=qos), qos=qos)

    def newest(seconds):
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            taken = [s for s in states.take(64) if isinstance(s, JointState)]
            if taken:
                return taken[-1]
            time.sleep(0.001)
        raise SystemExit("no joint states were heard")

    first = newest(15.0)
    posture = list(first.position)
    head = first.name.index("head_pan")
    target = posture[head] + 0.3
    seen, last = 1, first
    deadline = time.monotonic() + 10.0
    while time.monotonic() < deadline and abs(last.position[head] - target) > 0.05:
        command = list(posture)
        command[head] = target
        commands.write(Float64MultiArray(Layout([], 0), command))
        last = newest(2.0)
        seen += 1
    off = abs(last.position[head] - target)

    # One trajectory of one joint: out in a second, back in the next. Nothing else is said meanwhile. (Robots that are
    # left without commands for half a second give way and fall: this comes at once.)
    start = last.position[head]
    points = [Point([start + way], [], [], [], Duration(k + 1, 0)) for k, way in enumerate([-0.3, 0.0])]
    trajectories.write(JointTrajectory(Header(Time(0, 0), ""), ["head_pan"], points))
    farthest, back = start, start
    deadline = time.monotonic() + 2.3
    while time.monotonic() < deadline:
        back = newest(2.0).position[head]
        farthest = min(farthest, back)
    went, returned = start - farthest, abs(back - start)
    print(
        json.dumps(
            {
                "joints": len(first.name),
                "states": seen,
                "head_pan_off_rad": off,
                "trajectory_went_rad": went,
                "trajectory_back_off_rad": returned,
            }
        )
    )
    good = len(first.name) == 20 and off <= 0.05 and abs(went - 0.3) <= 0.05 and returned <= 0.05
    sys.exit(0 if good else 1)


main()
