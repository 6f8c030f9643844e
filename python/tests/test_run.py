import json
import os
import signal
from pathlib import Path

import numpy as np
import pytest

import stridemap


def test_a_run_has_tables_as_numpy_and_arrow(run: stridemap.Run):
    strides = run.transitions
    assert len(strides) == len(strides["reward"]) > 20
    assert strides["reward"].dtype == np.float64 and strides["k"].dtype == np.int64
    assert set(strides["end"]) <= {"crossing", "fell", "no_crossing"}
    assert "psi_roll_deg" in strides.columns and "next_psi_roll_deg" in strides.columns
    with pytest.raises(KeyError, match="there are"):
        strides["reword"]
    assert len(run.learning) > 0 and "average_reward" in run.learning.columns
    assert "what" in run.record_strides.columns
    assert len(run.policy_table()) > 0
    pyarrow = pytest.importorskip("pyarrow")
    table = pyarrow.table(strides)
    assert table.column_names == strides.columns
    assert np.array_equal(table["reward"].to_numpy(), strides["reward"])


def test_pandas_and_polars_take_a_table(run: stridemap.Run):
    reward = run.transitions["reward"]
    polars = pytest.importorskip("polars")
    assert np.array_equal(polars.DataFrame(run.transitions)["reward"].to_numpy(), reward)
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame.from_arrow(run.transitions)
    assert np.array_equal(frame["reward"].to_numpy(), reward)


def test_a_run_shows_what_it_achieved(run: stridemap.Run):
    summary = run.summary
    assert summary["seed"] == run.seed == 3 and run.is_complete
    assert run.provenance["command"].startswith("stridemap learn stepping --seed 3 --set")
    assert (run.path / "report.html").exists()
    stems = [figure.stem for figure in run.figures]
    assert len(stems) > 3 and all(figure.svg.startswith("<svg") for figure in run.figures)
    assert run._repr_html_().count("<svg") == len(stems)
    assert run.figures[0].png()[:4] == b"\x89PNG"


def test_a_policy_is_a_function_of_states(run: stridemap.Run):
    policy, n = run.policy, len(run.task.state_names)
    states = np.linspace(0, 3, 5 * n).reshape(5, n)
    actions = policy(states)
    assert actions.shape == (5, 1) and policy(states[0]).shape == (1,)
    assert np.array_equal(actions[2], policy.mean(states[2]))
    assert np.array_equal(policy.sample(states, 7), policy.sample(states, 7))
    assert policy.arrays and policy.to_dict()["kind"] == policy.kind
    assert len(run.policies) == 1
    with pytest.raises(stridemap.RequestError, match="shape"):
        policy(np.zeros(n + 1))


def test_policies_of_ones_own_are_measured_on_the_robot(run: stridemap.Run, tmp_path: Path):
    held = stridemap.Policy.constant(run.task, [1.0])
    by_class = stridemap.evaluate(run, strides=10, policy=held)
    by_function = stridemap.evaluate(run, strides=10, policy=lambda state: [1.0])
    assert by_class == by_function and by_class["strides"] == 10
    held.save(tmp_path / "held.json")
    assert np.array_equal(stridemap.Policy.load(tmp_path / "held.json")([2.0] * len(run.task.state_names)), [1.0])
    with pytest.raises(ZeroDivisionError):
        stridemap.evaluate(run, strides=10, policy=lambda state: [1 / 0])


def test_the_same_seed_gives_the_same_bytes_as_before(run: stridemap.Run, small: dict, tmp_path: Path):
    again = stridemap.learn(stridemap.Task.builtin("stepping").set(small), seed=3, out=tmp_path / "again", report=False)
    for name in ("transitions.csv", "learning.csv", "policy/final.json"):
        assert (again.path / name).read_bytes() == (run.path / name).read_bytes(), name


def test_the_verbs_one_at_a_time(small: dict, tmp_path: Path):
    run = stridemap.collect("stepping", seed=3, out=tmp_path / "run", set=small)
    assert len(run.transitions) == 20 and not run.is_complete
    assert stridemap.fit(run).samples <= 20
    with pytest.raises(stridemap.RequestError, match="improve"):
        stridemap.collect(run)
    stridemap.improve(run)
    assert len(run.policies) == 1
    fitted = stridemap.fit(run.path / "transitions.csv", task="stepping", set=small, seed=3)
    assert fitted.samples == stridemap.fit(run).samples
    pushed = stridemap.push(run, force=20.0, strides=12)
    assert pushed["force_n"] == 20.0 and (run.path / "push.json").exists()
    with pytest.raises(stridemap.RequestError, match="prove|state"):
        stridemap.analyse(run)


def test_a_callback_sees_strides_and_may_end_the_run(small: dict, tmp_path: Path):
    seen: list[dict] = []

    def on_stride(stride: dict) -> bool:
        seen.append(stride)
        return len(seen) < 7

    run = stridemap.learn("stepping", out=tmp_path / "run", set=small, on_stride=on_stride)
    assert len(seen) == 7 and not run.is_complete
    assert seen[0]["what"] == "nominal" and seen[0]["state"].shape == (len(run.task.state_names),)
    assert seen[0]["measures"]["duration_s"] > 0
    whole = stridemap.resume(run, report=False)
    assert whole.is_complete


def test_an_exception_in_a_callback_comes_back(small: dict, tmp_path: Path):
    def on_stride(stride: dict) -> None:
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        stridemap.learn("stepping", out=tmp_path / "run", set=small, on_stride=on_stride)


def test_ctrl_c_ends_a_run_that_can_go_on(small: dict, tmp_path: Path, request: pytest.FixtureRequest):
    # A process that was started in the background ignores it.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    request.addfinalizer(lambda: signal.signal(signal.SIGINT, before))
    strides: list[dict] = []

    def on_stride(stride: dict) -> None:
        strides.append(stride)
        if len(strides) == 3:
            os.kill(os.getpid(), signal.SIGINT)

    many = {**small, "collect.strides": [10_000], "success.strides_at_most": 20_000}
    with pytest.raises(KeyboardInterrupt):
        stridemap.learn("stepping", out=tmp_path / "run", set=many, on_stride=on_stride)
    assert len(strides) < 1000 and (tmp_path / "run/config.toml").exists()


def test_an_occupied_directory_is_refused(run: stridemap.Run):
    with pytest.raises(stridemap.RequestError, match="holds a run already") as caught:
        stridemap.learn("stepping", out=run.path)
    assert caught.value.file == str(run.path)


def test_what_json_cannot_hold_is_none(run: stridemap.Run):
    json.dumps(run.summary)
