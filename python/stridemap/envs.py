"""Gymnasium environments: the robot, and the map learned of it, a stride a step, with the same spaces.

Observations are states at the section in their own units. Actions are normalised, ``[-1, 1]`` for the task's bounds;
with ``physical=True`` they are in the task's units, as ``Policy`` gives them. An action beyond the space is an error.
A fall or a stall terminates, the end of an episode truncates, an aborted stride raises.
"""

from __future__ import annotations

import os
from typing import Any, Callable

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ._native import Map, MapBatch, Plant, Run, Task

__all__ = ["MapEnv", "MapVectorEnv", "StrideEnv", "register"]

Array = NDArray[np.float64]
Bounds = list[tuple[float, float]]

#: No robot's state is beyond this, in whatever unit.
_FAR = 1e6
#: What float32 may add to an action.
_ROUNDING = 1e-5


def _spaces(states: int, bounds: Bounds, physical: bool) -> tuple[gym.Space[Any], gym.Space[Any]]:
    observation = gym.spaces.Box(-_FAR, _FAR, (states,), np.float64)
    if not physical:
        return observation, gym.spaces.Box(-1.0, 1.0, (len(bounds),), np.float32)
    low, high = np.asarray(bounds, np.float64).T
    return observation, gym.spaces.Box(low, high, dtype=np.float64)


def _in_units(action: Any, bounds: Bounds, physical: bool) -> Array:
    """Actions in the task's units."""
    given: Array = np.asarray(action, np.float64)
    low, high = np.asarray(bounds, np.float64).T
    if physical:
        return given
    if not (np.abs(given) <= 1.0 + _ROUNDING).all():
        raise ValueError(
            f"action {given} is beyond [-1, 1]; the environment made with physical=True takes the task's units"
        )
    in_units: Array = np.clip(low + 0.5 * (given + 1.0) * (high - low), low, high)
    return in_units


def _map(given: Map | Run | str | os.PathLike[str] | None) -> Map:
    """A map: itself, that of a run, or (given nothing) that of the first strides of ``stepping``, seed 1."""
    if isinstance(given, Map):
        return given
    if given is None:
        return Map.of_task("stepping", seed=1)
    return (given if isinstance(given, Run) else Run(given)).map


class StrideEnv(gym.Env[Array, Any]):
    """The robot of a task, simulated in this process; one step is one stride.

    ``info`` holds the action as applied, the goal of the next stride (in tasks that have one), how the stride ended,
    why it fell, and what was measured of it.
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(self, task: Task | str | os.PathLike[str] = "stepping", *, physical: bool = False) -> None:
        self.task = task if isinstance(task, Task) else Task.load(task)
        self.physical = physical
        self._bounds = self.task.action_bounds
        self._plant: Plant | None = None
        self.observation_space, self.action_space = _spaces(len(self.task.state_names), self._bounds, physical)

    @property
    def plant(self) -> Plant:
        """The robot, built when it is first needed."""
        if self._plant is None:
            self._plant = Plant(self.task)
        return self._plant

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        begun = self._plant is not None
        super().reset(seed=seed)
        if seed is not None or not begun:
            self.plant.seed(int(self.np_random.integers(2**31)) if seed is None else seed)
        state = self.plant.reset()
        return state, {"applied_action": self.plant.last_action(), "goal": self.plant.goal()}

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        state, reward, end = self.plant.step(_in_units(action, self._bounds, self.physical).tolist())
        info = {
            "applied_action": self.plant.last_action(),
            "goal": self.plant.goal(),
            "end": end,
            "fall": self.plant.fall(),
            "measures": self.plant.measures(),
        }
        return state, reward, end != "crossing", False, info


class MapVectorEnv(VectorEnv[Array, Any, NDArray[Any]]):
    """Thousands of imagined robots in a learned map; one step is one stride of each.

    Robot i draws from a stream of its own, that of a ``MapEnv`` with seed ``seed + i``: results do not depend on the
    number of threads.

    Parameters:
        map: a ``Map``, a ``Run`` or its path; by default the map of the first strides of ``stepping``, seed 1.
        draw: ``"full"`` (function and noise), ``"latent"`` or ``"mean"``.
        reward: ``reward(state, action, next_state, fell) -> (N,)`` instead of the task's, all in the task's units.
        terminated: ``terminated(next_state) -> (N,)`` instead of the task's falls.
        autoreset_mode: as Gymnasium has it.
        max_episode_steps: strides after which an episode is truncated.
        physical: actions in the task's units.

    ``reset(options=)`` takes ``state`` and ``last_action``, a row for all or one for each, and ``reset_mask``.
    """

    def __init__(
        self,
        num_envs: int = 1,
        map: Map | Run | str | os.PathLike[str] | None = None,
        *,
        draw: str = "full",
        reward: Callable[[Array, Array, Array, NDArray[np.bool_]], Any] | None = None,
        terminated: Callable[[Array], Any] | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        physical: bool = False,
    ) -> None:
        self.map = _map(map)
        self.num_envs, self.physical, self.max_episode_steps = num_envs, physical, max_episode_steps
        self.metadata = {"render_modes": [], "autoreset_mode": AutoresetMode(autoreset_mode)}
        self._mode = AutoresetMode(autoreset_mode)
        self._reward, self._terminated, self._bounds = reward, terminated, self.map.action_bounds
        self._batch = MapBatch(self.map, num_envs, draw=draw, falls=terminated is None, rewarded=reward is None)
        self.single_observation_space, self.single_action_space = _spaces(
            len(self.map.state_names), self._bounds, physical
        )
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._begun = False
        self._ended = np.zeros(num_envs, np.bool_)
        self._steps = np.zeros(num_envs, np.int64)
        self._states: Array = np.zeros((num_envs, len(self.map.state_names)))

    def _info(self) -> dict[str, Any]:
        return {"applied_action": self._batch.last_actions(), "_applied_action": np.ones(self.num_envs, np.bool_)}

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        options = dict(options or {})
        mask = options.pop("reset_mask", None)
        super().reset(seed=seed if isinstance(seed, int) else None)
        if isinstance(seed, int):
            self._batch.seed([seed + i for i in range(self.num_envs)])
        elif seed is not None:
            drawn = self.np_random.integers(2**31, size=self.num_envs)
            self._batch.seed([int(d) if s is None else s for s, d in zip(seed, drawn, strict=True)])
        elif not self._begun:
            self._batch.seed(self.np_random.integers(2**31, size=self.num_envs).tolist())
        self._begun = True
        self._states = self._batch.reset(mask, options.pop("state", None), options.pop("last_action", None))
        if options:
            raise ValueError(f"unknown options {sorted(options)}; there are state, last_action, reset_mask")
        again = np.ones(self.num_envs, np.bool_) if mask is None else mask
        self._ended[again], self._steps[again] = False, 0
        return self._states, self._info()

    def step(
        self, actions: Any
    ) -> tuple[Array, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        again, before = self._ended, self._states
        if self._mode is AutoresetMode.DISABLED and again.any():
            raise ValueError("an episode has ended; reset it, with options={'reset_mask': ...}")
        states, rewards, fell = self._batch.step(_in_units(actions, self._bounds, self.physical), again)
        self._states, self._steps = states, np.where(again, 0, self._steps + 1)
        info = self._info()
        if self._reward is not None:
            own = self._reward(before, info["applied_action"], states, fell)
            rewards = np.where(again, 0.0, np.asarray(own, np.float64))
        if self._terminated is not None:
            fell = np.asarray(self._terminated(states), np.bool_) & ~again
        late = np.zeros_like(fell) if self.max_episode_steps is None else self._steps >= self.max_episode_steps
        truncated = late & ~fell & ~again
        self._ended = fell | truncated
        if self._mode is AutoresetMode.SAME_STEP and self._ended.any():
            final = np.full(self.num_envs, None, dtype=object)
            for i in np.flatnonzero(self._ended):
                final[i] = states[i].copy()
            info |= {"final_obs": final, "_final_obs": self._ended.copy()}
            self._states = self._batch.reset(self._ended)
            self._steps[self._ended] = 0
            self._ended = np.zeros_like(self._ended)
        return self._states, rewards, fell, truncated, info


class MapEnv(gym.Env[Array, Any]):
    """One imagined robot: a ``MapVectorEnv`` of one, with its parameters."""

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(self, map: Map | Run | str | os.PathLike[str] | None = None, **settings: Any) -> None:
        self.vector = MapVectorEnv(1, map, autoreset_mode=AutoresetMode.DISABLED, **settings)
        self.observation_space = self.vector.single_observation_space
        self.action_space = self.vector.single_action_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed)
        states, info = self.vector.reset(seed=seed, options=options)
        return states[0], {"applied_action": info["applied_action"][0]}

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        states, rewards, fell, truncated, info = self.vector.step(np.asarray(action)[None])
        applied = {"applied_action": info["applied_action"][0]}
        return states[0], float(rewards[0]), bool(fell[0]), bool(truncated[0]), applied


def register() -> None:
    """Registers the environments; ``import stridemap`` does it."""
    if "stridemap/Map-v0" in gym.registry:
        return
    for name, task, steps in [("Stepping", "stepping", 100), ("Walking", "walking", 100)]:
        gym.register(
            f"stridemap/{name}-v0",
            entry_point="stridemap.envs:StrideEnv",
            max_episode_steps=steps,
            kwargs={"task": task},
        )
    gym.register(
        "stridemap/Map-v0",
        entry_point="stridemap.envs:MapEnv",
        vector_entry_point="stridemap.envs:MapVectorEnv",
        max_episode_steps=100,
    )
