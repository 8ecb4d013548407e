"""Track recordings on a cluster of Ray: python ray_runs.py RUNS RECORDING...

RAY_ADDRESS names the cluster; without it, the processes run on this host.
"""

import sys
from pathlib import Path

import ray

import gepf

if __name__ == "__main__":
    runs, *recordings = map(Path, sys.argv[1:])
    tracked = ray.remote(num_cpus=1)(gepf.track)  # refines in its process, on one core
    tasks = [
        tracked.remote(path.resolve(), runs.resolve() / path.name, quiet=True, workers=None)
        for path in recordings
    ]
    for run in map(ray.get, tasks):
        print(run.folder, len(run), "frames")
