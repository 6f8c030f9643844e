"""A run as a Minari dataset, and back: the same map comes of it."""

from pathlib import Path

import numpy as np
import pytest

import stridemap


def test_a_run_goes_to_minari_and_back(run: stridemap.Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("minari")
    pytest.importorskip("h5py")
    from stridemap.datasets import from_minari, to_minari

    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    dataset = to_minari(run, "stridemap/test-v0")
    strides = run.transitions
    assert dataset.total_steps == len(strides) and dataset.total_episodes == (strides["k"] == 0).sum()
    from_minari(dataset, run.task, tmp_path / "strides.csv")
    back = stridemap.fit(tmp_path / "strides.csv", task=run.task, seed=run.seed)
    here = stridemap.fit(run)
    # Evaluation strides, which are no data of the map here, are data of the table.
    training = (strides["role"] == "training") & (strides["end"] == "crossing")
    assert here.samples == training.sum() and back.samples == (strides["end"] == "crossing").sum()
    if here.samples == back.samples:
        assert np.array_equal(here.log_marginal_likelihoods, back.log_marginal_likelihoods)
