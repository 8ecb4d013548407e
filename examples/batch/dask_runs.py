"""Track recordings on a cluster of Dask: python dask_runs.py RUNS RECORDING...

DASK_SCHEDULER_ADDRESS names the scheduler; without it, the processes run on this host.
"""

import sys
from pathlib import Path

from dask.distributed import Client, as_completed

import gepf

if __name__ == "__main__":
    runs, *recordings = map(Path, sys.argv[1:])
    with Client(threads_per_worker=1) as client:  # a tracker per process; it refines in it, on one core
        tasks = [
            client.submit(gepf.track, path.resolve(), runs.resolve() / path.name, quiet=True, workers=None)
            for path in recordings
        ]
        for _, run in as_completed(tasks, with_results=True):
            print(run.folder, len(run), "frames")
