"""HyperQueue by its Python package alone: a server and workers on this machine, one task a shard.

    pip install hyperqueue; python examples/sweep/hq.py STUDY.toml DIR SHARDS WORKERS

Where the program `hq` is installed, hq.sh does the same on any number of machines.
"""

import os
import shlex
import subprocess
import sys

from hyperqueue import Job, LocalCluster
from hyperqueue.cluster import WorkerConfig

ATTEMPTS = 20


def main(study, out, shards, workers):
    stridemap = shlex.split(os.environ.get("STRIDEMAP", "stridemap"))
    with LocalCluster() as cluster:
        for _ in range(int(workers)):
            cluster.start_worker(WorkerConfig(cores=1))
        client = cluster.client()
        for attempt in range(ATTEMPTS):
            # A shard that was killed is begun again, and goes on where it ended; one that is whole has nothing to do.
            job = Job(max_fails=None)
            for i in range(1, int(shards) + 1):
                words = ["sweep", os.path.abspath(study), "--shard", f"{i}/{shards}", "--out", os.path.abspath(out)]
                job.program([*stridemap, *words], stdout=None, stderr=None)
            if client.wait_for_jobs([client.submit(job)], raise_on_error=False):
                break
            print(f"attempt {attempt + 1}: a shard was lost; it is begun again", flush=True)
    return subprocess.run([*stridemap, "sweep", "merge", out]).returncode


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
