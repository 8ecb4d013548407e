"""Track recordings with Ray: python ray_runs.py RUNS RECORDING...

RAY_ADDRESS names a cluster; without it, the processes run on this host.
"""

import sys
from pathlib import Path

import ray

import gepf

if __name__ == "__main__":
    runs, *recordings = [Path(each).resolve() for each in sys.argv[1:]]
    track = ray.remote(gepf.track)  # a task refines on one core
    tasks = [track.remote(path, runs / path.name, quiet=True, workers=None) for path in recordings]
    for run in map(ray.get, tasks):
        print(run.folder, len(run), "frames")
