"""Sweeps: the same results by one process, by HyperQueue with a worker killed, by Ray."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import stridemap

STUDY = """
name = "small"
task = "stepping"
seeds = {{ first = 1, count = {seeds} }}
[set]
algorithm.iterations = 1
collect.strides = [12]
record.strides = 12
record.iteration_strides = 12
record.pose_seconds = 0.0
[grid]
robot.friction = [0.6, 1.0]
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("study") / "study.toml"
    file.write_text(STUDY.format(seeds=4))
    return file


@pytest.fixture(scope="module")
def alone(study: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Made by one process."""
    out = tmp_path_factory.mktemp("alone")
    assert stridemap.sweep(study, out) == 8
    assert stridemap.sweep(study, out) == 0
    return out


def test_shards_make_what_one_process_makes(study: Path, alone: Path, tmp_path: Path):
    made = [stridemap.sweep(study, tmp_path, shard=f"{i}/3") for i in range(3)]
    assert sum(made) == 8
    one, three = stridemap.sweep_merge(alone), stridemap.sweep_merge(tmp_path)
    assert one == three and one["made"] == one["planned"] == 8 and not one["missing"]
    for name in ("results.ndjson", "results.csv", "table.csv"):
        assert (alone / name).read_bytes() == (tmp_path / name).read_bytes()
    lines = [json.loads(line) for line in (alone / "results.ndjson").read_text().splitlines()]
    assert [line["run"] for line in lines] == list(range(8))
    assert {line["set"]["robot.friction"] for line in lines} == {0.6, 1.0}
    cell = one["rows"][0]["values"]["mean_reward"]
    assert cell["n"] == 4 and cell["least"] <= cell["mean"] <= cell["most"]


def test_a_line_that_was_cut_off_is_made_again(study: Path, alone: Path, tmp_path: Path):
    shutil.copytree(alone, tmp_path / "cut")
    (lines,) = (tmp_path / "cut/shards").glob("*/results.ndjson")
    whole = lines.read_bytes()
    lines.write_bytes(whole[:-20])
    assert stridemap.sweep_merge(tmp_path / "cut")["missing"] == [7]
    assert stridemap.sweep(study, tmp_path / "cut") == 1
    assert lines.read_bytes() == whole


def test_another_study_is_refused(study: Path, alone: Path, tmp_path: Path):
    other = tmp_path / "other.toml"
    other.write_text(STUDY.format(seeds=5))
    with pytest.raises(stridemap.RequestError, match="another study"):
        stridemap.sweep(other, alone)
    with pytest.raises(stridemap.RequestError, match="no shard"):
        stridemap.sweep(study, alone, shard="5/2")
    with pytest.raises(stridemap.RequestError, match="no results"):
        stridemap.sweep_merge(tmp_path)


def test_ten_thousand_lines_are_merged_quickly(study: Path, alone: Path, tmp_path: Path):
    file = tmp_path / "study.toml"
    file.write_text(STUDY.format(seeds=5000))
    line = json.loads((alone / "results.ndjson").read_text().splitlines()[0])
    stridemap_study = json.loads((alone / "study.json").read_text())
    stridemap_study["seeds"]["count"] = 5000
    out = tmp_path / "out"
    (out / "shards/0-of-1").mkdir(parents=True)
    (out / "study.json").write_text(json.dumps(stridemap_study))
    with open(out / "shards/0-of-1/results.ndjson", "w") as lines:
        for run in range(10_000):
            friction = [0.6, 1.0][run // 5000]
            own = {**line, "run": run, "seed": 1 + run % 5000, "set": {"robot.friction": friction}}
            lines.write(json.dumps(own) + "\n")
    started = time.process_time()
    merged = stridemap.sweep_merge(out)
    print(f"10000 lines merged in {time.process_time() - started:.2f} s")
    assert merged["made"] == 10_000 and merged["rows"][1]["values"]["mean_reward"]["n"] == 5000


@pytest.fixture(scope="module")
def command(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The command as a Python program, so that the tests need no binary."""
    sweep = tmp_path_factory.mktemp("bin") / "stridemap"
    sweep.write_text(
        f"#!{sys.executable}\nimport sys, stridemap\n_, verb, *words = sys.argv\n"
        "if words[0] == 'merge':\n    stridemap.sweep_merge(words[1])\nelse:\n"
        "    study, _, shard, _, out = words\n    stridemap.sweep(study, out, shard=shard)\n"
    )
    sweep.chmod(0o755)
    return sweep


def runs_of(out: Path) -> list[int]:
    """Processes that are at a shard of a sweep."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                words = (entry / "cmdline").read_bytes().split(b"\0")
            except OSError:
                continue
            if str(out).encode() in words and b"--shard" in words:
                found.append(int(entry.name))
    return found


def lines_of(out: Path) -> int:
    return sum(len(file.read_bytes().splitlines()) for file in out.glob("shards/*/results.ndjson"))


def kill_one(out: Path) -> None:
    """Kills a run as soon as there is a result and a run at work."""
    for _ in range(1200):
        at_work = runs_of(out)
        if lines_of(out) > 0 and at_work:
            os.kill(at_work[0], signal.SIGKILL)
            return
        time.sleep(0.05)
    raise AssertionError("no run was at work")


def test_hyperqueue_loses_no_run_and_counts_none_twice(
    study: Path, alone: Path, command: Path, tmp_path: Path, root: Path
):
    """Two workers, and the run of one of them killed in the middle."""
    pytest.importorskip("hyperqueue")
    out = tmp_path / "out"
    call = [sys.executable, root / "examples/sweep/hq.py", study, out, "2", "2"]
    env = {**os.environ, "STRIDEMAP": str(command)}
    job = subprocess.Popen(call, env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        kill_one(out)
        said, _ = job.communicate(timeout=300)
    finally:
        job.kill()
    assert job.returncode == 0 and "begun again" in said, said
    assert (out / "results.ndjson").read_bytes() == (alone / "results.ndjson").read_bytes()
    assert lines_of(out) == 8


@pytest.mark.parametrize("script", ["xargs.sh", "parallel.sh", "hq.sh"])
def test_the_scripts_make_the_same(script: str, study: Path, alone: Path, command: Path, tmp_path: Path, root: Path):
    tool = script.removesuffix(".sh")
    if shutil.which(tool) is None:
        pytest.skip(f"{tool} is not installed")
    env = {**os.environ, "STRIDEMAP": str(command)}
    subprocess.run([root / "examples/sweep" / script, study, tmp_path / "out", "3"], env=env, check=True, timeout=300)
    assert (tmp_path / "out/results.ndjson").read_bytes() == (alone / "results.ndjson").read_bytes()


def test_ray_makes_the_same(study: Path, alone: Path, tmp_path: Path):
    ray = pytest.importorskip("ray")
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    try:
        merged = stridemap.sweep_ray(study, tmp_path / "out", shards=4)
    finally:
        ray.shutdown()
    assert merged["made"] == 8
    assert (tmp_path / "out/results.ndjson").read_bytes() == (alone / "results.ndjson").read_bytes()
