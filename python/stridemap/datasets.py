"""Strides of a run as a Minari dataset, and back as a table of strides. Needs minari (with h5py)."""

from __future__ import annotations

import csv
import os
from typing import Any

import numpy as np

from ._native import Run, Task
from .envs import StrideEnv

__all__ = ["from_minari", "to_minari"]


def _columns(task: Task) -> list[list[str]]:
    """State, last action, action and next state, as the tables name them."""
    states, actions = task.state_names, task.action_names
    return [states, [f"last_{name}" for name in actions], actions, [f"next_{name}" for name in states]]


def to_minari(run: Run, dataset_id: str, **settings: Any) -> Any:
    """Writes the training and evaluation strides of a run as a Minari dataset: an episode from each fresh start.

    Observations and actions are in the task's units, those of ``StrideEnv(task, physical=True)``.
    """
    from minari import create_dataset_from_buffers
    from minari.data_collector.episode_buffer import EpisodeBuffer

    table, task = run.transitions, run.task
    rows = table.to_dict()
    states, last, actions, following = (np.stack([rows[n] for n in names], 1) for names in _columns(task))
    fell = (rows["end"] == "fell") | (rows["end"] == "no_crossing")
    begins = [*np.flatnonzero(rows["k"] == 0), len(table)]
    buffers: list[Any] = []
    for at, end in zip(begins, begins[1:]):
        own = slice(at, end)
        over = np.arange(at, end) == end - 1
        buffers.append(
            EpisodeBuffer(
                id=len(buffers),
                observations=[*states[own], following[end - 1]],
                actions=list(actions[own]),
                rewards=rows["reward"][own].tolist(),
                terminations=fell[own].tolist(),
                truncations=(over & ~fell[own]).tolist(),
                infos={"last_action": [*last[own], actions[end - 1]]},
            )
        )
    env = StrideEnv(task, physical=True)
    spaces = {"observation_space": env.observation_space, "action_space": env.action_space}
    return create_dataset_from_buffers(dataset_id, buffers, **spaces, **settings)


def from_minari(dataset: Any, task: Task, file: str | os.PathLike[str]) -> None:
    """Writes a Minari dataset of a task's strides as a table that ``stridemap.fit(file, task=task)`` takes."""
    names = _columns(task)
    head = ["iteration", "phase", "role", "episode", "k", "time_s", "stance"]
    with open(file, "w", newline="") as out:
        rows = csv.writer(out)
        rows.writerow([*head, *names[0], *names[1], *names[2], *names[3], "reward", "end"])
        for episode in dataset.iterate_episodes():
            last = episode.infos["last_action"]
            for k, action in enumerate(episode.actions):
                end = "fell" if episode.terminations[k] else "crossing"
                x, following = episode.observations[k], episode.observations[k + 1]
                numbers = [float(v) for part in (x, last[k], action, following, [episode.rewards[k]]) for v in part]
                rows.writerow([1, "collect", "training", episode.id, k, 0.0, "", *numbers, end])
