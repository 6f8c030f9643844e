import csv
import os
import subprocess
import sys

import numpy as np
import pytest

import stridemap


def states_of(run: stridemap.Run) -> np.ndarray:
    return np.stack([run.transitions[name] for name in run.task.state_names], axis=1)


def actions_of(run: stridemap.Run) -> np.ndarray:
    return np.stack([run.transitions[name] for name in run.task.action_names], axis=1)


def test_the_map_of_a_run_is_the_one_it_learned_in(run: stridemap.Run, map: stridemap.Map):
    import json

    saved = json.loads((run.path / "map/1.json").read_text())
    assert map.log_marginal_likelihoods == [o["log_marginal_likelihood"] for o in saved["outputs"]]
    assert map.samples == saved["samples"]


def test_predictions_are_rusts_own_to_the_bit(run: stridemap.Run, map: stridemap.Map):
    """`figures/data/map-1.csv` is what Rust wrote of the same map."""
    with open(run.path / "figures/data/map-1.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    states, actions = run.task.state_names, run.task.action_names
    name = states[0]
    x = np.array([[float(row[n]) for n in states] for row in rows])
    u = np.array([[float(row[n]) for n in actions] for row in rows])
    mean, covariance = map.predict(x, u)
    assert np.array_equal(mean[:, 0], [float(row[f"mean_{name}"]) for row in rows])
    assert np.array_equal(np.sqrt(covariance[:, 0, 0]), [float(row[f"latent_std_{name}"]) for row in rows])


def test_rows_are_worked_on_together_as_one_by_one(run: stridemap.Run, map: stridemap.Map):
    x, u = states_of(run), actions_of(run)
    mean, covariance = map.predict(x, u)
    n = x.shape[1]
    assert mean.shape == x.shape and covariance.shape == (len(x), n, n)
    for i in (0, 7):
        one, variance = map.predict(x[i], u[i])
        assert np.array_equal(one, mean[i]) and np.array_equal(variance, covariance[i])
    # A single action goes with every row.
    assert np.array_equal(map.predict(x, u[0])[0][3], map.predict(x[3], u[0])[0])
    assert np.all(np.linalg.eigvalsh(map.predict(x, u, noise=True)[1] - covariance) > 0)
    with pytest.raises(stridemap.RequestError, match="rows"):
        map.predict(x[:3], u[:2])


def test_draws_have_the_predicted_moments(run: stridemap.Run, map: stridemap.Map):
    x, u = states_of(run)[3], actions_of(run)[3]
    mean, covariance = map.predict(x, u, noise=True)
    draws = map.sample(np.tile(x, (4000, 1)), u, rng=5)
    std = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(draws.mean(0) - mean) < 5 * std / np.sqrt(4000))
    assert np.all(np.abs(draws.std(0) / std - 1) < 0.06)
    assert np.array_equal(draws, map.sample(np.tile(x, (4000, 1)), u, rng=5))
    assert map.sample(x, u, np.random.default_rng(1)).shape == x.shape


def test_the_jacobian_is_that_of_the_mean(run: stridemap.Run, map: stridemap.Map):
    x, u = states_of(run)[:4], actions_of(run)[:4]
    by_state, by_action = map.jacobian(x, u)
    h = 1e-4
    for i in range(x.shape[1]):
        step = h * np.eye(x.shape[1])[i]
        slope = (map.predict(x + step, u)[0] - map.predict(x - step, u)[0]) / (2 * h)
        assert np.allclose(by_state[:, :, i], slope, rtol=1e-4, atol=1e-6)
    slope = (map.predict(x, u + h)[0] - map.predict(x, u - h)[0]) / (2 * h)
    assert np.allclose(by_action[:, :, 0], slope, rtol=1e-4, atol=1e-6)


def test_roll_outs_of_a_policy_and_of_its_function_agree(run: stridemap.Run, map: stridemap.Map):
    x0 = states_of(run)[:6]
    ours = map.rollout(run.policy, x0, n=8, particles=5, rng=3)
    theirs = map.rollout(run.policy.mean, x0, n=8, particles=5, rng=3)
    assert ours["states"].shape == (6, 5, 9, x0.shape[1]) and ours["actions"].shape == (6, 5, 8, 1)
    for name in ours:
        assert np.array_equal(ours[name], theirs[name], equal_nan=True), name
    assert np.array_equal(ours["states"][:, :, 0], np.repeat(x0[:, None], 5, axis=1))
    still = map.rollout(run.policy, x0[0], n=8, particles=3, draw="mean")
    assert still["states"].shape == (3, 9, x0.shape[1])
    assert np.array_equal(still["states"][0], still["states"][1], equal_nan=True)
    for row, fell in zip(ours["lengths"].ravel(), ours["fell"].ravel()):
        assert row == 8 or fell


def test_the_number_of_threads_changes_nothing(run: stridemap.Run):
    code = (
        "import stridemap, numpy as np, hashlib, sys; run = stridemap.Run(sys.argv[1]); "
        "x = np.linspace(1, 3, 40)[:, None] * np.ones(len(run.task.state_names)); "
        "out = run.map.rollout(run.policy, x, n=20, particles=8, rng=1); "
        "print(hashlib.sha256(out['states'].tobytes()).hexdigest())"
    )
    said = {
        subprocess.run(
            [sys.executable, "-c", code, str(run.path)],
            env={**os.environ, "RAYON_NUM_THREADS": threads},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for threads in ("1", "2")
    }
    assert len(said) == 1
