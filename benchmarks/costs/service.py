"""Cost of the service in addition to the kernel: python -m benchmarks.costs.service.

N particles are sent to a worker with two lanes, which returns them after a kernel's time. The next frame of
512 KB follows them. The time beyond the kernel's is for encoding, dispatch, publication and gathering. The
same is measured, alternately, with a process pool with shared memory and with Ray. Then: two real lanes
compared with one, 8 to 1 024 waiting lanes compared with the ideal, and the start and memory of a worker.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.costs.scatter_peers import Frame, process_pool, ray_tasks
from benchmarks.costs.standing import Case, standing
from benchmarks.running import command_line, keep
from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.camera import Intrinsics
from gepf.common.frame import SubjectFrame, SubjectView, View
from gepf.common.refinement import Particles, Refined
from gepf.common.settings import RefineSettings
from gepf.coordinator.pool.options import WORKER_COMMAND, Pool
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from gepf.coordinator.settings import preset
from gepf.worker.lanes import Lanes

SHAPE = (512, 512)  # of a 16-bit depth image: 512 KB
PARTICLES = (20, 100, 1000)
KERNEL_MS = 30.0  # a frame
ROUNDS = 60
WAITING = (sys.executable, "-m", "benchmarks.costs.waiting_workers")
WAIT = 0.0065  # seconds per particle, about the kernel's time
SHARE = 10  # particles for each waiting lane
CROWDS = ((2, 4), (4, 16), (8, 32), (16, 64))  # workers, lanes of each
STARTS = 5
POINTS = 5_000


def main() -> int:
    """Measure, print, write the numbers."""
    parser = command_line("costs.service", __doc__)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    chosen = parser.parse_args()
    result: dict[str, Any] = {
        "overhead_ms": [overhead(count, chosen.rounds) for count in PARTICLES],
        "two_lanes": two_lanes(max(5, chosen.rounds // 6)),
        "crowds": [crowd(*crew) for crew in CROWDS],
        "worker_start": [worker_start(lanes) for lanes in (1, 2, 16)],
    }
    print(json.dumps(result, indent=2))
    keep(result, chosen.out)
    return 0


def overhead(particles: int, rounds: int) -> dict[str, Any]:
    """Milliseconds per frame beyond the kernel's, measured alternately: medians, and ratios to ours."""
    case = standing(POINTS)
    poses = np.repeat(case.start, particles, axis=0)
    depth = np.full(SHAPE, 2000, np.uint16)
    seconds = 1e-3 * KERNEL_MS / (particles / 2)
    with ExitStack() as stack:
        calls: dict[str, Frame] = {
            "gepf": stack.enter_context(pretending_lanes(case.model, 2, seconds)),
            "process pool": stack.enter_context(process_pool(2, SHAPE, seconds)),
        }
        try:
            calls["ray"] = stack.enter_context(ray_tasks(2, SHAPE, seconds))
        except ImportError:
            sys.stderr.write("service: Ray is not installed and is left out; pip install ray\n")
        except Exception as error:  # noqa: BLE001 - Ray raises a bare one when its processes start too slowly
            sys.stderr.write(f"service: Ray does not start and is left out: {error}\n")
        times = in_turns({name: partial(call, depth, poses) for name, call in calls.items()}, rounds)
    median = {name: float(np.median(spent)) - KERNEL_MS for name, spent in times.items()}
    return {
        "particles": particles,
        "median": median,
        "gepf_over": {name: median["gepf"] / other for name, other in median.items() if name != "gepf"},
    }


def in_turns(calls: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, Array]:
    """Wall time (rounds,) of each call, ms; the calls alternate, the first three rounds do not count."""
    spent: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(3 + rounds):
        for name, call in calls.items():
            began = time.perf_counter()
            call()
            spent[name].append(1e3 * (time.perf_counter() - began))
    return {name: np.array(times[3:]) for name, times in spent.items()}


@contextmanager
def pretending_lanes(model: BodyModel, lanes: int, seconds: float) -> Iterator[Frame]:
    """Refine on lanes that return each pose after a time in seconds; frames are sent ahead."""
    settings = preset("default").refine
    command = (*WAITING, "--seconds", str(seconds))
    with ZenohRefiner(Pool(workers=lanes, worker_command=command)) as refiner:
        refiner.wait_for(lanes)
        numbers = iter(range(10**9))
        coming = [subject_of(np.zeros(SHAPE, np.uint16) + 1, next(numbers))]

        def frame(depth: NDArray[np.uint16], poses: Array) -> Array:
            pending = refiner.submit(coming.pop(), model, Particles(poses, settings))
            coming.append(subject_of(depth, next(numbers)))
            refiner.publish(coming[0])
            return pending.result().poses

        yield frame


def subject_of(depth: NDArray[np.uint16], number: int) -> SubjectFrame:
    """A frame in which every pixel is the subject's, with 10 000 sampled points."""
    height, width = depth.shape
    camera = Intrinsics(width, height, 525.0, 525.0, width / 2, height / 2)
    picked = np.linspace(0, depth.size - 1, 10_000).astype(np.uint32)
    view = SubjectView(View(number, 0.0, depth, 1000.0, camera), picked, (0, 0, width, height))
    return SubjectFrame(number, 0.0, (view,))


def refine_now(refiner: ZenohRefiner, case: Case, poses: Array, settings: RefineSettings) -> Refined:
    """Poses (N, D) after their refinement."""
    return refiner.submit(case.subject, case.model, Particles(poses, settings)).result()


def two_lanes(rounds: int) -> dict[str, Any]:
    """The real kernel, 20 particles: median milliseconds on one lane and on two, and their ratio.

    Over the bus, each in its own worker, and the kernel alone in this process.
    """
    case = standing(POINTS)
    poses = np.repeat(case.start, 20, axis=0)
    settings = preset("default").refine
    with ExitStack() as stack:
        calls: dict[str, Callable[[], object]] = {}
        for count in (1, 2):
            refiner = stack.enter_context(ZenohRefiner(Pool(workers=count, worker_command=WORKER_COMMAND)))
            refiner.wait_for(count)
            calls[f"bus {count}"] = partial(refine_now, refiner, case, poses, settings)
            alone = Lanes(count)
            calls[f"kernel {count}"] = partial(
                alone.refine, case.model, case.observation, Particles(poses, settings)
            )
        times = {name: float(np.median(spent)) for name, spent in in_turns(calls, rounds).items()}
    return {
        "ms": times,
        "speed_up": times["bus 1"] / times["bus 2"],
        "kernel_alone": times["kernel 1"] / times["kernel 2"],
    }


def crowd(workers: int, lanes: int) -> dict[str, Any]:
    """Ten particles per waiting lane: milliseconds per frame, and the share of the ideal rate."""
    case = standing(POINTS)
    poses = np.repeat(case.start, SHARE * workers * lanes, axis=0)
    with tempfile.TemporaryDirectory(prefix="gepf-") as folder, ExitStack() as stack:
        endpoint = f"unixsock-stream/{folder}/bus"
        refiner = stack.enter_context(ZenohRefiner(Pool(workers=0, listen=endpoint)))
        for k in range(workers):
            stack.callback(start_waiting(endpoint, f"crowd{k}", lanes).kill)
        refiner.wait_for(workers * lanes)
        call = {"frame": partial(refine_now, refiner, case, poses, preset("default").refine)}
        spent = float(np.median(in_turns(call, 15)["frame"]))
    ideal = 1e3 * WAIT * SHARE
    return {
        "workers": workers,
        "lanes": workers * lanes,
        "particles": len(poses),
        "ideal_ms": ideal,
        "ms": spent,
        "share": ideal / spent,
    }


def start_waiting(endpoint: str, name: str, lanes: int) -> subprocess.Popen[bytes]:
    """Start a worker with this number of waiting lanes."""
    options = {"connect": endpoint, "name": name, "lanes": lanes, "seconds": WAIT}
    given = [text for option, value in options.items() for text in (f"--{option}", str(value))]
    return subprocess.Popen([*WAITING, *given], stdin=subprocess.PIPE)


def worker_start(lanes: int) -> dict[str, float]:
    """Medians: seconds until a local worker joins, its processor seconds, megabytes after a frame."""
    starts = np.array([start_one(lanes) for _ in range(1 + STARTS)][1:])
    names = ("lanes", "seconds", "processor_seconds", "megabytes")
    return dict(zip(names, (float(lanes), *np.median(starts, axis=0).tolist()), strict=True))


def start_one(lanes: int) -> tuple[float, float, float]:
    """Seconds, processor seconds and megabytes of a new worker."""
    case = standing(POINTS)
    began = time.perf_counter()
    with ZenohRefiner(Pool(workers=lanes)) as refiner:
        refiner.wait_for(lanes)
        seconds = time.perf_counter() - began
        pid = refiner.local_pid
        used = processor_seconds(pid)
        poses = np.repeat(case.start, 4 * lanes, axis=0)
        refine_now(refiner, case, poses, preset("default").refine)
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
        return seconds, used, pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def processor_seconds(pid: int) -> float:
    """Processor time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    sys.exit(main())
