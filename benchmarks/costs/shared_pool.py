"""A pool that several live coordinators share: python -m benchmarks.costs.shared_pool [--rooms 1 2 4 ...].

Every coordinator, worker and the router is a network host of its own (a namespace, so this needs root), with
the real protocol and bus. What computes is simulated, as all hosts share the cores of one: the lanes of
workers sleep for the time that the kernel takes for a particle, measured at the start, and coordinators sleep
for the time of the tracker around it. A coordinator gets frames at 30 per second, and takes the newest.

By default eight rooms share 16 lanes, and then 8, while all is calm, while workers leave and join, after a
coordinator was killed, and beside one that floods the workers with requests of 1 000 particles. The share of
frames that are known within 67 ms is compared with that of one room that has its share of the lanes alone.
With --rooms, so many coordinators have two lanes each, and what a frame costs is measured.

The protocol itself needs about two cores for eight rooms, and with less all rooms are late. With --slow K all
simulated times are K times as long and frames come K times as rarely: what is not simulated has K times as
much of the processor, as on a machine with K times as many cores. Delays are given without the factor.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import numpy as np
import psutil  # type: ignore[import-untyped]
from rich.table import Table

from benchmarks.costs.service import processor_seconds
from benchmarks.costs.sleeping_rooms import PARTICLES, POINTS, flood, track, work
from benchmarks.running import command_line, keep, screen
from gepf.common.refinement import Particles
from gepf.coordinator.settings import preset
from tests.support.processes.network import Host, Network
from tests.support.processes.warm_processes import CONTEXT, gepf

FPS, IN_TIME_S = 30.0, 0.067
ROOMS, LANES, POOLS = 8, 4, (4, 2)  # coordinators; lanes of a worker; workers
PHASE_S, SETTLE_S = 20.0, 3.0
AWAY_S = 2.0  # for which a worker is away
PORT = 7447


def main() -> int:
    """Measure, print, write the numbers."""
    parser = command_line("costs.shared_pool", __doc__)
    parser.add_argument("--rooms", type=int, nargs="+", metavar="N", help="measure costs with N coordinators")
    parser.add_argument("--fps", type=float, default=FPS, help="frames per second of --rooms")
    parser.add_argument("--slow", type=float, default=1.0, metavar="K", help="slow motion (default: none)")
    parser.add_argument("--particle-ms", type=float, help="of the kernel (default: measured)")
    parser.add_argument("--seconds", type=float, default=PHASE_S, help="of each measurement")
    chosen = parser.parse_args()
    CONTEXT.set_forkserver_preload(["tests.support.processes.bare_gepf", "benchmarks.costs.sleeping_rooms"])
    particle_s = kernel_seconds() if chosen.particle_ms is None else 1e-3 * chosen.particle_ms
    print(f"one particle: {1e3 * particle_s:.2f} ms", flush=True)
    results = costs(chosen, particle_s) if chosen.rooms else fairness(chosen, particle_s)
    keep({"particle_s": particle_s, **results}, chosen.out)
    return 0


def kernel_seconds() -> float:
    """Median time of the kernel for a particle of a live frame, on one lane."""
    from benchmarks.costs.standing import standing
    from gepf.worker.lanes import Lanes

    case, lanes, spent = standing(POINTS), Lanes(1), []
    particles = Particles(np.repeat(case.start, PARTICLES, axis=0), preset("default").refine, covariance=True)
    for _ in range(20):
        began = time.perf_counter()
        lanes.refine(case.model, case.observation, particles)
        spent.append((time.perf_counter() - began) / PARTICLES)
    return float(np.median(spent[3:]))


@dataclass
class Site:
    """Hosts with a router, workers that sleep, and rooms."""

    network: Network
    folder: Path
    particle_s: float
    slow: float
    hosts: dict[str, Host] = field(default_factory=dict)
    processes: dict[str, BaseProcess] = field(default_factory=dict)

    @property
    def endpoint(self) -> str:
        """That of the router."""
        return f"tcp/{self.hosts['router'].address}:{PORT}"

    def start(self, name: str, do: Any, *arguments: object) -> None:
        """Start a process on the host of its name, which is made the first time."""
        if name not in self.hosts:
            self.hosts[name] = self.network.host(name)
        self.processes[name] = self.hosts[name].start(do, *arguments, log=self.folder / f"{name}.txt")

    def start_router(self) -> None:
        """Let all meet."""
        self.hosts["router"] = self.network.host("router")
        self.start("router", gepf, "router", "--listen", self.endpoint, "--insecure")

    def start_worker(self, name: str, lanes: int = LANES) -> None:
        """Start a worker."""
        self.start(name, work, self.endpoint, name, lanes, self.particle_s * self.slow)

    def start_room(self, name: str, fps: float = FPS) -> None:
        """Start a coordinator."""
        file = self.folder / f"{name}.json"
        self.start(name, track, self.endpoint, file, name, fps / self.slow, self.slow)

    def end(self, name: str) -> None:
        """Kill a process."""
        process = self.processes.pop(name)
        process.kill()
        process.join()

    def frames(self, room: str, begin: float, end: float) -> dict[str, float]:
        """The share of a room's frames in a period that were known in time, and the median delay."""
        lines = (self.folder / f"{room}.json").read_text().splitlines()
        entries = [json.loads(line) for line in lines[1:]]
        delays = np.array([delay / self.slow for at, delay in entries if begin <= at < end])
        count = (end - begin) * json.loads(lines[0])
        return {
            "known_percent": 100.0 * float((delays <= IN_TIME_S).sum()) / count,
            "median_ms": 1e3 * float(np.median(delays)) if len(delays) else np.inf,
            "frames": float(len(delays)),
        }


@contextmanager
def site(particle_s: float, slow: float) -> Iterator[Site]:
    """Hosts with a router; all that runs there ends with it."""
    with tempfile.TemporaryDirectory() as folder, Network() as network:
        made = Site(network, Path(folder), particle_s, slow)
        try:
            made.start_router()
            yield made
        finally:
            for name in list(made.processes):
                made.end(name)


def fairness(chosen: argparse.Namespace, particle_s: float) -> dict[str, Any]:
    """The share of each room, beside that of a room alone."""
    results = []
    for workers in POOLS:
        with site(particle_s, chosen.slow) as shared:
            alone = room_alone(shared, workers * LANES // ROOMS, chosen.seconds)
        with site(particle_s, chosen.slow) as shared:
            phases = rooms_together(shared, workers, chosen.seconds)
        results.append({"lanes": workers * LANES, "alone": alone, "phases": phases})
        table = Table(title=f"{ROOMS} rooms, {workers * LANES} lanes; alone {alone['known_percent']:.1f} %")
        for column in ("", "least known %", "mean", "of fair share %", "median ms, largest", "cores busy"):
            table.add_column(column)
        for name, phase in phases.items():
            shares = [room["known_percent"] for room in phase["rooms"].values()]
            slowest = max(room["median_ms"] for room in phase["rooms"].values())
            values = min(shares), np.mean(shares), 100.0 * min(shares) / alone["known_percent"], slowest
            table.add_row(name, *(f"{value:.1f}" for value in (*values, phase["cores"])))
        screen().print(table)
    return {"pools": results}


def room_alone(alone: Site, lanes: int, seconds: float) -> dict[str, float]:
    """One room with its share of the lanes."""
    alone.start_worker("w0", lanes)
    alone.start_room("room0")
    begin = await_frames(alone, ["room0"])
    time.sleep(seconds)
    return alone.frames("room0", begin, begin + seconds)


def rooms_together(shared: Site, workers: int, seconds: float) -> dict[str, Any]:
    """For each disturbance, what the undisturbed rooms get, and how many cores are busy."""
    rooms = [f"room{n}" for n in range(ROOMS)]
    for n in range(workers):
        shared.start_worker(f"w{n}")
    for room in rooms:
        shared.start_room(room)
    await_frames(shared, rooms)
    phases, last = {}, rooms[-1]

    def measure(name: str, begin: float) -> None:
        end = begin + seconds
        time.sleep(max(0.0, end + 1.0 - time.monotonic()))
        busy = 0.01 * psutil.cpu_percent() * psutil.cpu_count()  # since the last phase
        present = [room for room in rooms if room in shared.processes]
        known = {room: shared.frames(room, begin, end) for room in present}
        phases[name] = {"cores": busy, "rooms": known}

    psutil.cpu_percent()
    measure("calm", time.monotonic())
    begin = time.monotonic()
    for n in range(int(seconds / AWAY_S / 2)):
        shared.end(f"w{n % workers}")
        time.sleep(AWAY_S)
        shared.start_worker(f"w{n % workers}")
        time.sleep(AWAY_S)
    measure("workers leave and join", begin)
    begin = time.monotonic()
    shared.end(last)
    measure("a coordinator is killed", begin)
    begin = time.monotonic()
    shared.start("flood", flood, shared.endpoint, "flood0")
    measure("another floods", begin)
    return phases


def await_frames(shared: Site, rooms: Sequence[str]) -> float:
    """Return some time after all rooms have their first frame; the time of now."""
    files = [shared.folder / f"{room}.json" for room in rooms]
    while not all(file.exists() and file.read_text().count("\n") > 1 for file in files):
        for name, process in shared.processes.items():
            if not process.is_alive():
                raise RuntimeError(f"{name}: {(shared.folder / f'{name}.txt').read_text()}")
        time.sleep(0.1)
    time.sleep(SETTLE_S)
    return time.monotonic()


def costs(chosen: argparse.Namespace, particle_s: float) -> dict[str, Any]:
    """What a frame costs of each part, for several numbers of rooms."""
    rows = []
    for count in chosen.rooms:
        with site(particle_s, chosen.slow) as shared:
            rows.append(cost(shared, count, chosen.fps, chosen.seconds))
        print(json.dumps(rows[-1]), flush=True)
    return {"fps": chosen.fps, "costs": rows}


def cost(shared: Site, count: int, fps: float, seconds: float) -> dict[str, float]:
    """Processor time and traffic of one frame, memory, and the share of frames known in time."""
    rooms, workers = [f"room{n}" for n in range(count)], [f"w{n}" for n in range(max(1, count // 2))]
    for worker in workers:
        shared.start_worker(worker, 2 if count == 1 else LANES)
    for room in rooms:
        shared.start_room(room, fps)
    begin = await_frames(shared, rooms)
    before = spent(shared)
    time.sleep(seconds)
    used = {name: now - before[name] for name, now in spent(shared).items()}
    end = time.monotonic()
    results = [shared.frames(room, begin, end) for room in rooms]

    def total(names: Sequence[str], what: str) -> float:
        return sum(used[f"{name} {what}"] for name in names)

    done = sum(room["frames"] for room in results)
    return {
        "rooms": count,
        "workers": len(workers),
        "known_percent_least": min(room["known_percent"] for room in results),
        "known_percent": float(np.mean([room["known_percent"] for room in results])),
        "median_ms": float(np.median([room["median_ms"] for room in results])),
        "frames_per_second": done / (end - begin),
        "coordinator_ms": 1e3 * total(rooms, "cpu") / done,
        "router_ms": 1e3 * total(["router"], "cpu") / done,
        "workers_ms": 1e3 * total(workers, "cpu") / done,
        "cores": total(["router", *rooms, *workers], "cpu") / (end - begin),
        "worker_in_kb": 1e-3 * total(workers, "received") / done,
        "router_in_kb": 1e-3 * total(["router"], "received") / done,
        "router_out_kb": 1e-3 * total(["router"], "sent") / done,
        "room_out_kb": 1e-3 * total(rooms, "sent") / done,
        "coordinator_mb": max(memory(shared.processes[room]) for room in rooms),
        "worker_mb": max(memory(shared.processes[worker]) for worker in workers),
        "router_mb": memory(shared.processes["router"]),
    }


def spent(shared: Site) -> dict[str, float]:
    """Processor seconds of each process, and bytes that its host has received and sent."""
    counters = {}
    for name, process in shared.processes.items():
        counters[f"{name} cpu"] = processor_seconds(process.pid or 0)
        lines = Path(f"/proc/{shared.hosts[name].pid}/net/dev").read_text().splitlines()
        counts = next(line for line in lines if "eth0:" in line).split(":")[1].split()
        counters[f"{name} received"], counters[f"{name} sent"] = float(counts[0]), float(counts[8])
    return counters


def memory(process: BaseProcess) -> float:
    """Megabytes that a process has of its own."""
    lines = Path(f"/proc/{process.pid}/smaps_rollup").read_text().splitlines()
    return sum(float(line.split()[1]) for line in lines if line.startswith("Private_")) / 1024


if __name__ == "__main__":
    sys.exit(main())
