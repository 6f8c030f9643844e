"""The stubs say what the module is, and the Python half is typed."""

import subprocess
import sys

import pytest

pytest.importorskip("mypy")


def test_stubs_are_fresh():
    call = [sys.executable, "-m", "mypy.stubtest", "stridemap._native", "--ignore-disjoint-bases"]
    done = subprocess.run(call, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-6000:]


def test_the_package_is_typed():
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--ignore-missing-imports", "-p", "stridemap"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout[-6000:]
