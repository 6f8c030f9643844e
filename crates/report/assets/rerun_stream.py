"""Streams a run into Rerun: robot, feet, sections, actions and predictions on the time lines `step` and `time`.

Reads what `stridemap view` writes on stdin, one JSON message a line: {"topic", "time_s", "step", "value"}.
Usage: python rerun_stream.py [FILE.rrd]     without a file it opens the viewer
"""
import json
import sys

import rerun as rr

rr.init("stridemap", spawn=len(sys.argv) < 2)
if len(sys.argv) > 1:
    rr.save(sys.argv[1])
rr.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)


def at(message):
    rr.reset_time()
    rr.set_time("time", duration=message["time_s"])
    rr.set_time("step", sequence=message["step"])


def frame(name):
    """Where a body stands in the tree of entities: `final/3`."""
    return f"world/{name}"


def quaternion(q):
    return rr.Quaternion(xyzw=[q["x"], q["y"], q["z"], q["w"]])


def xyz(v):
    return [v["x"], v["y"], v["z"]]


def shapes(value):
    for entity in value["entities"]:
        path = f"{frame(entity['frame_id'])}/shape/{entity['id'].split('/')[1]}"
        for kind in ("cubes", "spheres", "cylinders"):
            for shape in entity[kind]:
                rr.log(
                    path,
                    rr.Transform3D(
                        translation=xyz(shape["pose"]["position"]), quaternion=quaternion(shape["pose"]["orientation"])
                    ),
                    static=True,
                )
                color = [round(255 * shape["color"][c]) for c in "rgba"]
                size = xyz(shape["size"])
                half = [0.5 * s for s in size]
                if kind == "cubes":
                    drawn = rr.Boxes3D(half_sizes=[half], colors=[color], fill_mode="solid")
                elif kind == "spheres":
                    drawn = rr.Ellipsoids3D(half_sizes=[half], colors=[color], fill_mode="solid")
                else:
                    drawn = rr.Cylinders3D(lengths=[size[2]], radii=[half[0]], colors=[color], fill_mode="solid")
                rr.log(path, drawn, static=True)


def section(root, value):
    for what in ("state", "action", "next_state"):
        for name, v in value[what].items():
            if v is not None:
                rr.log(f"{root}/{what}/{name}", rr.Scalars(v))
    for name, p in (value["prediction"] or {}).items():
        rr.log(f"{root}/prediction/{name}/mean", rr.Scalars(p["mean"]))
        rr.log(f"{root}/prediction/{name}/std", rr.Scalars(p["std"]))
    if value["reward"] is not None:
        rr.log(f"{root}/reward", rr.Scalars(value["reward"]))
    if value["end"] != "crossing":
        rr.log(f"{root}/end", rr.TextLog(value["end"], level=rr.TextLogLevel.WARN))


def feet(root, value):
    rr.log(f"{root}/load_n/left", rr.Scalars(value["left_load_n"]))
    rr.log(f"{root}/load_n/right", rr.Scalars(value["right_load_n"]))
    cop = value["centre_of_pressure_m"]
    place = f"world/{root}/centre_of_pressure"
    rr.log(place, rr.Points3D([[*cop, 0.0]], radii=0.02, colors=[213, 94, 0]) if cop else rr.Clear(recursive=False))
    push, origin = value["push_n"], value["torso_m"]
    place = f"world/{root}/push"
    # A metre for 100 N.
    rr.log(place, rr.Arrows3D(origins=[origin], vectors=[[0.01 * f for f in push]]) if push else rr.Clear(recursive=False))


for line in sys.stdin:
    message = json.loads(line)
    topic, value = message["topic"], message["value"]
    root, kind = topic.strip("/").split("/", 1)
    at(message)
    if kind == "tf":
        for t in value["transforms"]:
            rr.log(
                frame(t["child_frame_id"]),
                rr.Transform3D(translation=xyz(t["translation"]), quaternion=quaternion(t["rotation"])),
            )
    elif kind == "robot":
        shapes(value)
    elif kind == "feet":
        feet(root, value)
    elif kind == "section":
        section(root, value)
