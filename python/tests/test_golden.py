"""A run made in Python is the bytes of the command: those that crates/cli/tests/golden.txt keeps."""

import hashlib
import sys
from pathlib import Path

import pytest

import stridemap


def test_a_run_in_python_has_the_bytes_of_the_command(root: Path, tmp_path: Path):
    golden = (root / "crates/cli/tests/golden.txt").read_text()
    flags = Path("/proc/cpuinfo").read_text() if sys.platform == "linux" else ""
    if not golden.startswith("arithmetic avx512") or "avx512f" not in flags:
        pytest.skip("golden.txt was made where arithmetic rounds differently")
    kept = dict(line.rsplit(" ", 1) for line in golden.splitlines()[1:])
    short = {"record.strides": 4, "record.iteration_strides": 3, "record.pose_seconds": 0.5, "algorithm.iterations": 1}
    run = stridemap.learn("stepping", seed=1, out=tmp_path / "run", set=short, report=False)
    for name in ("transitions.csv", "record.csv", "learning.csv"):
        found = hashlib.sha256((run.path / name).read_bytes()).hexdigest()
        assert found == kept[f"short stepping 1 {name}"], name
