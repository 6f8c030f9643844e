"""Reads the MCAP that `stridemap view` writes with the independent package `mcap` and says what is in it.

Usage: python read_view.py view.mcap RUN
"""
import csv
import json
import sys

from mcap.reader import make_reader

path, run = sys.argv[1:3]
topics, schemas, last = {}, {}, 0
with open(path, "rb") as file:
    reader = make_reader(file, validate_crcs=True)
    for schema, channel, message in reader.iter_messages():
        assert channel.message_encoding == "json", channel
        assert message.log_time >= last, "messages are in the order of time"
        last = message.log_time
        topics.setdefault(channel.topic, []).append((message.log_time, json.loads(message.data)))
        schemas[channel.topic] = schema.name

rows = list(csv.DictReader(open(f"{run}/transitions.csv")))
columns = json.load(open(f"{run}/columns.json"))
learning = topics["/learning/section"]
assert len(learning) == len(rows), (len(learning), len(rows))
predicted = 0
for step, ((time_ns, value), row) in enumerate(zip(learning, rows)):
    assert value["step"] == step and time_ns == step * 1_000_000_000
    for name in columns["state"]:
        assert value["state"][name] == float(row[name]) and value["next_state"][name] == float(row[f"next_{name}"])
    for name in columns["action"]:
        assert value["action"][name] == float(row[name])
    predicted += bool(value["prediction"])
assert predicted > 0, "predictions of the map"
for what in ("nominal", "final"):
    frames = topics[f"/{what}/tf"]
    assert schemas[f"/{what}/tf"] == "foxglove.FrameTransforms" and len(frames) > 100
    children = {t["child_frame_id"] for t in frames[0][1]["transforms"]}
    first, later = frames[0][1]["transforms"], frames[len(frames) // 3][1]["transforms"]
    moving = sum(a["translation"] != b["translation"] for a, b in zip(first, later))
    assert len(children) > 5 and moving > 5, f"{moving} bodies move"
    locked = {e["frame_id"] for e in topics[f"/{what}/robot"][0][1]["entities"]}
    assert locked <= children, "every shape has its frame"
    steps = [v["step"] for _, v in topics[f"/{what}/feet"]]
    assert steps == sorted(steps) and steps[-1] > 5, "steps are counted"
    sections = topics[f"/{what}/section"]
    assert all(v["action"] and v["state"] for _, v in sections) and len(sections) > 50
pushes = [v["push_n"] for _, v in topics.get("/push/feet", []) if v["push_n"]]
print(json.dumps({topic: len(messages) for topic, messages in sorted(topics.items())} | {"predicted": predicted, "pushed": len(pushes)}))
