"""Stridemap: improves an existing walking controller from a few dozen real steps.

>>> import stridemap
>>> run = stridemap.learn("stepping")
>>> run.policy([2.5])
"""

from __future__ import annotations


def _load_mujoco() -> None:
    """Loads MuJoCo's library from the wheel ``mujoco``, without its Python half, so that our own finds it."""
    import ctypes
    import importlib.util
    import pathlib

    spec = importlib.util.find_spec("mujoco")
    for place in (spec.submodule_search_locations if spec else None) or ():
        for library in pathlib.Path(place).glob("libmujoco.so.*"):
            ctypes.CDLL(str(library))


_load_mujoco()

from . import errors  # noqa: E402
from ._native import (  # noqa: E402
    Figure,
    Map,
    MapBatch,
    Plant,
    Policy,
    Run,
    Table,
    Task,
    __version__,
    analyse,
    collect,
    evaluate,
    fit,
    improve,
    learn,
    push,
    register_gait,
    register_learner,
    register_reward,
    resume,
    sweep,
    sweep_merge,
)
from .envs import MapEnv, MapVectorEnv, StrideEnv, register  # noqa: E402
from .sweeps import sweep_ray  # noqa: E402
from .errors import RequestError, StridemapError, WorkingError  # noqa: E402

register()

__all__ = [
    "Figure",
    "Map",
    "MapBatch",
    "MapEnv",
    "MapVectorEnv",
    "Plant",
    "Policy",
    "RequestError",
    "Run",
    "StrideEnv",
    "StridemapError",
    "Table",
    "Task",
    "WorkingError",
    "__version__",
    "analyse",
    "collect",
    "errors",
    "evaluate",
    "fit",
    "improve",
    "learn",
    "push",
    "register_gait",
    "register_learner",
    "register_reward",
    "resume",
    "sweep",
    "sweep_merge",
    "sweep_ray",
]
