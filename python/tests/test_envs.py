import subprocess
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv

import stridemap


def make(name: str, map: stridemap.Map, **settings: object) -> gym.Env:
    return gym.make(f"stridemap/{name}-v0", **({"map": map} if name == "Map" else {}), **settings)


@pytest.mark.parametrize("name", ["Stepping", "Walking", "Map"])
def test_check_env_is_clean(name: str, map: stridemap.Map):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(make(name, map).unwrapped)


def check_vector_env(env: VectorEnv) -> None:
    """What Gymnasium asks of a `VectorEnv`: it has no checker of its own for them."""
    n = env.num_envs
    assert isinstance(env.metadata["autoreset_mode"], AutoresetMode)
    assert env.observation_space.shape == (n, *env.single_observation_space.shape)
    assert env.action_space.shape == (n, *env.single_action_space.shape)
    first, info = env.reset(seed=11)
    assert first in env.observation_space and isinstance(info, dict)
    again, _ = env.reset(seed=11)
    assert np.array_equal(first, again)
    env.action_space.seed(3)
    kept = first.copy()
    for _ in range(30):
        states, rewards, terminated, truncated, info = env.step(env.action_space.sample())
        assert states in env.observation_space
        for values, kind in [(rewards, np.float64), (terminated, np.bool_), (truncated, np.bool_)]:
            assert values.shape == (n,) and values.dtype == kind
        assert not np.any(terminated & truncated)
        assert all(len(value) == n for value in info.values())
    assert np.array_equal(first, kept), "observations that were handed out change"
    env.close()


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_check_vector_env_is_clean(map: stridemap.Map, mode: str):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gym.make_vec("stridemap/Map-v0", num_envs=40, map=map, autoreset_mode=mode, max_episode_steps=7)
        check_vector_env(env)


def test_robots_in_a_batch_are_those_that_stride_alone(map: stridemap.Map):
    """Bit for bit, episode ends and new starts among them."""
    batch = stridemap.MapVectorEnv(40, map, max_episode_steps=5)
    alone = SyncVectorEnv([lambda: stridemap.MapEnv(map, max_episode_steps=5) for _ in range(40)])
    assert np.array_equal(batch.reset(seed=8)[0], alone.reset(seed=8)[0])
    batch.action_space.seed(1)
    for _ in range(17):
        action = batch.action_space.sample()
        for ours, theirs in zip(batch.step(action)[:4], alone.step(action)[:4]):
            assert np.array_equal(ours, theirs)


def test_steps_of_the_vector_are_draws_of_the_map(map: stridemap.Map):
    env = stridemap.MapVectorEnv(50, map, draw="mean", physical=True)
    x0 = np.tile(env.reset(seed=1)[0][:1], (50, 1))
    low, high = np.array(map.action_bounds).T
    u = low + (high - low) * np.linspace(0, 1, 50)[:, None]
    env.reset(options={"state": x0, "last_action": u})
    states, *_, info = env.step(u)
    assert np.array_equal(info["applied_action"], u)
    assert np.allclose(states, map.predict(x0, u)[0], rtol=0, atol=0)


def test_reward_and_termination_can_be_ones_own(map: stridemap.Map):
    env = stridemap.MapVectorEnv(
        64,
        map,
        reward=lambda state, action, next_state, fell: next_state[:, 0] - state[:, 0],
        terminated=lambda next_state: next_state[:, 0] > 2.0,
        autoreset_mode=AutoresetMode.DISABLED,
    )
    before, _ = env.reset(seed=2)
    after, rewards, terminated, _, _ = env.step(np.zeros((64, 1)))
    assert np.array_equal(rewards, after[:, 0] - before[:, 0])
    assert np.array_equal(terminated, after[:, 0] > 2.0) and 0 < terminated.sum() < 64
    with pytest.raises(ValueError, match="reset"):
        env.step(np.zeros((64, 1)))
    again, _ = env.reset(options={"reset_mask": terminated})
    assert np.array_equal(again[~terminated], after[~terminated])
    env.step(np.zeros((64, 1)))


def test_a_fall_terminates_and_the_end_of_an_episode_truncates(map: stridemap.Map):
    env = gym.make("stridemap/Map-v0", map=map, max_episode_steps=4)
    env.reset(seed=1)
    ends = [env.step(np.zeros(1))[2:4] for _ in range(4)]
    assert ends[:3] == [(False, False)] * 3 and ends[3] == (False, True)
    failing = stridemap.MapVectorEnv(8, map, terminated=lambda x: np.ones(len(x), bool))
    failing.reset(seed=1)
    assert failing.step(np.zeros((8, 1)))[2].all()


def test_the_robot_strides_as_a_run_does(run: stridemap.Run, small: dict):
    env = stridemap.StrideEnv(run.task, physical=True)
    state, _ = env.reset(seed=4)
    rewards = []
    for _ in range(5):
        state, reward, terminated, truncated, info = env.step(run.policy(state))
        rewards.append(reward)
        assert not terminated and info["measures"]["duration_s"] > 0.2 and info["end"] == "crossing"
    env.reset(seed=4)
    again = env.step(run.policy(env.reset(seed=4)[0]))
    assert again[1] == rewards[0]


def test_actions_beyond_the_space_are_refused(map: stridemap.Map):
    env = stridemap.MapVectorEnv(4, map)
    env.reset(seed=1)
    with pytest.raises(ValueError, match="physical=True"):
        env.step(np.full((4, 1), 2.0))
    with pytest.raises(stridemap.RequestError, match="row for each"):
        env.step(np.zeros((3, 1)))
    with pytest.raises(ValueError, match="unknown options"):
        env.reset(options={"stat": 1})


def test_seeds_are_the_same_in_another_process(run: stridemap.Run):
    code = (
        "import stridemap, gymnasium, numpy as np, sys, hashlib\n"
        "h = hashlib.sha256()\n"
        "for env in (gymnasium.make('stridemap/Stepping-v0'), gymnasium.make('stridemap/Map-v0', map=sys.argv[1])):\n"
        "    h.update(env.reset(seed=5)[0].tobytes())\n"
        "    for u in (-0.5, 0.1, 0.7): h.update(env.step(np.array([u]))[0].tobytes())\n"
        "print(h.hexdigest())"
    )
    call = [sys.executable, "-c", code, str(run.path)]
    said = {subprocess.run(call, capture_output=True, text=True, check=True).stdout for _ in range(2)}
    assert len(said) == 1
