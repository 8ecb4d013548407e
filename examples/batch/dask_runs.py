"""Track recordings with Dask: python dask_runs.py RUNS RECORDING...

DASK_SCHEDULER_ADDRESS names a cluster's scheduler; without it, the processes run on this host.
"""

import sys
from pathlib import Path

from dask.distributed import Client, as_completed

import gepf

if __name__ == "__main__":
    runs, *recordings = [Path(each).resolve() for each in sys.argv[1:]]
    with Client() as client:  # type: ignore[no-untyped-call]
        out = [runs / path.name for path in recordings]
        tasks = client.map(gepf.track, recordings, out, quiet=True, workers=None)  # on one core each
        for task in as_completed(tasks):  # type: ignore[no-untyped-call]
            print(task.result().folder, len(task.result()), "frames")
