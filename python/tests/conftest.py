"""Small runs that several tests look at."""

from __future__ import annotations

from pathlib import Path

import pytest

import stridemap

#: Stepping with few strides: a second or two.
SMALL = {
    "algorithm.iterations": 1,
    "collect.strides": [20],
    "record.strides": 20,
    "record.iteration_strides": 20,
    "record.pose_seconds": 0.0,
}


@pytest.fixture(scope="session")
def small() -> dict[str, object]:
    return dict(SMALL)


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> stridemap.Run:
    return stridemap.learn("stepping", seed=3, out=tmp_path_factory.mktemp("run") / "stepping-3", set=SMALL)


@pytest.fixture(scope="session")
def map(run: stridemap.Run) -> stridemap.Map:
    return run.map


@pytest.fixture(scope="session")
def root() -> Path:
    return Path(__file__).resolve().parents[2]
