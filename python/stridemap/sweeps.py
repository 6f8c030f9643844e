"""A sweep as Ray tasks, one a shard. Needs ray."""

from __future__ import annotations

import os
from typing import Any

from ._native import sweep, sweep_merge

__all__ = ["sweep_ray"]


def sweep_ray(study: str | os.PathLike[str], out: str | os.PathLike[str], shards: int | None = None) -> dict[str, Any]:
    """Makes the runs of a study on a Ray cluster whose nodes share ``out``, and returns its merged results.

    Parameters:
        study: the study's file.
        out: the directory of the results.
        shards: tasks, of one processor each; by default four for each processor of the cluster.
    """
    import ray

    if not ray.is_initialized():
        ray.init()
    count = shards or 4 * max(1, int(ray.cluster_resources().get("CPU", 1)))
    # A shard that is lost with its worker is begun again, and goes on where it ended.
    make = ray.remote(num_cpus=1, max_retries=20)(sweep)
    study, out = os.path.abspath(study), os.path.abspath(out)
    ray.get([make.remote(study, out, f"{i}/{count}") for i in range(1, count + 1)])
    return sweep_merge(out)
