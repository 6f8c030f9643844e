"""A gait, a reward, a learner and a policy of one's own: the examples of docs/python.md."""

import sys
from pathlib import Path

import numpy as np
import pytest

import stridemap

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
sys.path.insert(0, str(EXAMPLES))

import own_gait  # noqa: E402
import own_learner  # noqa: E402
import own_reward  # noqa: E402


def test_a_gait_in_python_steps_and_its_cost_is_told(capsys: pytest.CaptureFixture[str]):
    cost_s = own_gait.main(strides=6)
    assert 0 < cost_s < 1
    assert "of a stride" in capsys.readouterr().out


def test_a_reward_in_python_is_learned(small: dict, tmp_path: Path):
    run = own_reward.main(tmp_path / "run", small)
    strides = run.transitions
    done = strides["end"] == "crossing"
    expected = -0.1 * np.abs(strides["next_psi_roll_deg"][done] - 2.0)
    assert np.allclose(strides["reward"][done], expected, atol=1e-12)


def test_a_learner_in_python_improves(small: dict, tmp_path: Path):
    run = own_learner.main(tmp_path / "run", small)
    assert run.summary["improved"] is not None and run.policies[0].kind == "constant"


def test_what_a_part_raises_comes_back(small: dict, tmp_path: Path):
    class Broken:
        modulations = [("step_amplitude_deg", 0.0, -20.0, 20.0)]

        def __init__(self, robot, own):
            pass

        def targets(self, state, dt):
            raise LookupError("a gait that fails")

    stridemap.register_gait("broken", Broken)
    env = stridemap.StrideEnv(stridemap.Task.builtin("stepping").set({"gait.kind": "broken"}))
    with pytest.raises(LookupError, match="a gait that fails"):
        env.reset(seed=1)
    with pytest.raises(stridemap.RequestError, match="no gait"):
        stridemap.Task.builtin("stepping").set({"gait.kind": "brokn"})
