"""Reads a log with a reader that none of us wrote. Usage: read_log.py LOG.mcap. Prints counts as JSON."""

import json
import sys
from collections import Counter

from mcap_ros2.reader import read_ros2_messages

counts = Counter()
joints = 0
for message in read_ros2_messages(sys.argv[1]):
    counts[message.channel.topic] += 1
    if message.channel.topic == "/joint_states":
        joints = len(message.ros_msg.position)
        assert len(message.ros_msg.name) == joints
    if message.channel.topic == "/imu":
        q = message.ros_msg.orientation
        assert abs(q.x**2 + q.y**2 + q.z**2 + q.w**2 - 1) < 0.01
print(json.dumps({"joints": joints, "messages": dict(counts)}))
states = counts["/joint_states"]
sys.exit(0 if joints == 20 and states > 100 and counts["/imu"] == states and counts["/stridemap/section"] > 0 else 1)
