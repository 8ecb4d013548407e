"""Live input as a camera sends it: python -m benchmarks.live [--colour | --entries N | --minutes M].

A camera of its own publishes recorded frames at their rate, and a listener notes when each result comes. By
default each sequence is shown once; a frame is known if its result is tracked or ambiguous; errors of known
frames are compared with those of a recorded run. With --colour a rendered person is shown by depth alone
and with colour, alternately. With --entries
each room of --only is shown without people, which costs processor time, and then with N people who appear in
it, each in another pose, at another place, and to a tracker that starts again. With --minutes the first
sequence is shown for so long, through a router and two workers, while the camera stalls, restarts,
changes its rate and sends frames that do not fit, the router and a worker are killed, and a worker stops.
"""

from __future__ import annotations

import argparse
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from io import BytesIO
from itertools import chain, cycle
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import psutil  # type: ignore[import-untyped]
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from benchmarks.colour import rendered
from benchmarks.costs.service import processor_seconds
from benchmarks.running import add_data, command_line, keep
from gepf.common.arrays import Array
from gepf.common.camera import Intrinsics
from gepf.common.frame import View
from gepf.common.protocol.frames import LIVE_END, encode_colour, encode_live
from gepf.common.transport.bus import Bus
from gepf.common.transport.opening import open_worker
from gepf.coordinator.results.track import read_track
from gepf.coordinator.sources import open_source
from gepf.coordinator.sources.live_stream import colour_key
from gepf.coordinator.sources.picture_folders import read_depth

KEY, RESULTS = "camera/depth", "camera/results"
SEQUENCES = ("skinned/dance", "skinned/turn", "rooms/table", "rooms/second", "real_rooms/ist_um")
IN_TIME_S, READY_S = 0.067, 5.0
VISITOR = "skinned/dance"
FPS, EMPTY, SETTLED, INSIDE = 30.0, 400, 250, 30  # frames without people, of these before it counts; with one
SMALL = Intrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)


@dataclass
class Log:
    """When frames were sent, and what came back of each person, by the monotonic clock."""

    people: int = 1
    sent: list[tuple[float, int]] = field(default_factory=list)  # time, number
    came: list[tuple[float, int, bool]] = field(default_factory=list)  # time, number, known

    def receive(self, _: str, payload: bytes) -> None:
        """Note a result."""
        result = msgspec.msgpack.decode(payload)
        if result["kind"] == "estimate":
            known = result["status"] in {"tracked", "ambiguous"}
            self.came.append((time.monotonic(), result["frame"], known))

    def answers(self) -> list[tuple[float, float, bool]]:
        """Of each frame: when it was sent, how long all its results took (infinite: for ever), all known."""
        found = []
        for place, (at, number) in enumerate(self.sent):
            until = next((t for t, n in self.sent[place + 1 :] if n == number), np.inf)
            mine = [(t, known) for t, n, known in self.came if n == number and at <= t < until]
            whole = len(mine) >= self.people
            delay = max(t for t, _ in mine) - at if whole else np.inf
            found.append((at, delay, whole and all(known for _, known in mine)))
        return found


@dataclass
class Camera:
    """Publishes frames, renumbered, at a rate."""

    bus: Bus
    frames: Sequence[View]
    log: Log
    number: int = 0
    time_s: float = 0.0
    pictures: Mapping[int, bytes] = field(default_factory=dict)  # JPEG files by number

    def restart(self) -> None:
        """Begin a new stream: number and time start from zero."""
        self.number, self.time_s = 0, 0.0

    def show(self, count: int, fps: float, shown: Iterator[View] | None = None) -> None:
        """Publish so many frames; each is dropped if the link is busy."""
        publisher, coloured = self.bus.publish(KEY), self.bus.publish(colour_key(KEY))
        began = time.monotonic()
        of = iter(self.frames) if shown is None else shown
        for k in range(count):
            time.sleep(max(0.0, began + k / fps - time.monotonic()))
            frame = replace(next(of), number=self.number, time_s=self.time_s)
            if frame.number in self.pictures:
                coloured.put(encode_colour(frame.number, self.pictures[frame.number]))
            self.log.sent.append((time.monotonic(), self.number))
            publisher.put(encode_live(frame))
            self.number, self.time_s = self.number + 1, self.time_s + 1.0 / fps

    def end(self) -> None:
        """End the stream."""
        self.bus.publish(KEY).put_blocking(LIVE_END)


def main() -> int:
    """Show sequences, or one for a long time; print a table and keep the numbers."""
    parser = command_line("live", __doc__)
    add_data(parser)
    parser.add_argument("--only", nargs="+", default=list(SEQUENCES), metavar="SEQ")
    parser.add_argument("--runs", type=int, default=1, metavar="N")
    parser.add_argument("--busy", action="store_true", help="one busy loop runs beside")
    parser.add_argument("--colour", action="store_true", help="a rendered person by depth and with colour")
    parser.add_argument("--entries", type=int, metavar="N", help="people who enter each room of --only")
    parser.add_argument("--minutes", type=float, help="show the first sequence so long, with disturbances")
    parser.add_argument(
        "--picture", type=Path, metavar="FILE", help="draw latency and memory of --minutes here"
    )
    chosen = parser.parse_args()
    with ExitStack() as stack:
        if chosen.busy:
            stack.callback(subprocess.Popen([sys.executable, "-c", "while True: pass"]).kill)
        if chosen.minutes:
            return endure(chosen)
        if chosen.colour:
            whole = [frame.views[0] for frame in rendered("turn", 0, None).frames]
            pictures = {frame.number: as_jpeg(frame) for frame in whole}
            frames = [replace(frame, colours=None) for frame in whole]
            keep(
                [
                    show_frames(f"turn {name}", frames, 30.0, pictures=seen)[0]
                    for _ in range(chosen.runs)
                    for name, seen in (("by depth", {}), ("with colour", pictures))
                ],
                chosen.out,
            )
            return 0
        if chosen.entries:
            rooms = [name for name in chosen.only if name.startswith("rooms/")]
            keep([enter(chosen.data, name, chosen.entries) for name in rooms], chosen.out)
            return 0
        results = [show(chosen.data, name) for name in chosen.only for _ in range(chosen.runs)]
    keep(results, chosen.out)
    return int(any(result["exit"] not in {0, 3} for result in results))


def show(data: Path, name: str) -> dict[str, Any]:
    """How many frames of a sequence are known, and how soon; errors live and recorded."""
    frames, people = images_of(data / name), 2 if name == "rooms/second" else 1
    fps = 4.0 if name.startswith("real_rooms") else 30.0
    with tempfile.TemporaryDirectory() as folder:
        result, live = show_frames(name, frames, fps, Path(folder), people)
        given = "--people", str(people), "--no-pictures", "--no-color"
        start("track", str(data / name), "--out", f"{folder}/recorded", *given).wait()
        person = Path("person1" if people > 1 else "")
        result["errors_cm"] = errors_of(live / person, Path(folder, "recorded", person), data / name)
    return result


def images_of(path: Path) -> list[View]:
    """All images of a recording of one camera."""
    source = open_source(path)
    return list(map(source.view, source.numbers))


def show_frames(
    name: str,
    frames: Sequence[View],
    fps: float,
    kept: Path | None = None,
    people: int = 1,
    pictures: Mapping[int, bytes] | None = None,
) -> tuple[dict[str, Any], Path]:
    """Show frames once, with colour if there are `pictures`: what came of them, and the folder of the run."""
    with tempfile.TemporaryDirectory() as folder:
        endpoint, log = f"unixsock-stream/{folder}/bus", Log(people)
        run_folder = (kept or Path(folder)) / "run"
        given = "--out", str(run_folder), "--listen", endpoint, "--people", str(people)
        run = start("track", f"zenoh:{KEY}", *given, *TRACKED)
        bus = open_worker([endpoint])
        bus.subscribe(f"{RESULTS}/**", log.receive)
        time.sleep(READY_S)
        camera = Camera(bus, frames, log, pictures=pictures or {})
        camera.show(len(frames), fps)
        time.sleep(2.0)
        camera.end()
        code = run.wait(60.0)
        bus.close()
        seen = read_track(run_folder / ("person1" if people > 1 else "")).keypoint
    answers = log.answers()
    late = [1e3 * delay for _, delay, _ in answers if delay < np.inf]
    first = next((k for k, (_, _, known) in enumerate(answers) if known), len(frames))
    result = {
        "sequence": name,
        "frames": len(frames),
        "answered": len(late),
        "first_known_s": sum(answers[first][:2]) - answers[0][0] if first < len(frames) else None,
        "known_in_time_percent": share(answers[first:], IN_TIME_S),
        "within_100_ms_percent": share(answers[first:], 0.1),
        "with_keypoints": 0 if seen is None else int(np.isfinite(seen).all(axis=(1, 2, 3)).sum()),
        "median_ms": float(np.median(late)) if late else None,
        "exit": code,
    }
    print(result, flush=True)
    return result, run_folder


def as_jpeg(frame: View) -> bytes:
    """The file of a frame's colour."""
    assert frame.colours is not None
    file = BytesIO()
    assert frame.colours is not None
    Image.fromarray(frame.colours).save(file, "JPEG", quality=90)
    return file.getvalue()


def share(answers: Sequence[tuple[float, float, bool]], seconds: float) -> float:
    """Percentage of the frames that are known within a time."""
    return 100.0 * sum(known and delay <= seconds for _, delay, known in answers) / max(1, len(answers))


def errors_of(live: Path, recorded: Path, sequence: Path) -> list[float] | None:
    """Mean error (cm) of all joints in the frames that are known live: live, and recorded."""
    if not (sequence / "truth.npz").exists():
        return None
    truth, runs = np.load(sequence / "truth.npz"), [read_track(live), read_track(recorded)]
    known = np.isin(runs[0].status, ["tracked", "ambiguous"])
    errors = []
    for run in runs:
        places = np.searchsorted(run.frame, runs[0].frame[known])
        names = [list(run.joint_names).index(name) for name in truth["joint_names"]]
        mine, theirs = run.joint_positions[places][:, names], truth["joint_positions"][run.frame[places]]
        errors.append(100.0 * float(np.linalg.norm(mine - theirs, axis=-1).mean()))
    return errors


def enter(data: Path, name: str, entries: int) -> dict[str, Any]:
    """What a room without people costs, and how soon people who appear in it are known."""
    source = open_source(data / name)
    room = source.view(source.numbers[0])
    empty = read_depth(data / name / "empty.png") / room.depth_scale
    visitor, rng = images_of(data / VISITOR), np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        endpoint, log = f"unixsock-stream/{folder}/bus", Log()
        run = start("track", f"zenoh:{KEY}", "--out", f"{folder}/run", "--listen", endpoint, *TRACKED)
        bus = open_worker([endpoint])
        bus.subscribe(f"{RESULTS}/**", log.receive)
        time.sleep(READY_S)
        camera = Camera(bus, [replace(room, depth=noisy(empty, rng)) for _ in range(EMPTY)], log)
        camera.show(SETTLED, FPS)
        before = processor_seconds_of_all(run.pid)
        camera.show(EMPTY - SETTLED, FPS)
        cost, soon = 1e3 * (processor_seconds_of_all(run.pid) - before) / (EMPTY - SETTLED), list[float]()
        for k in range(entries):
            shift, first = int(rng.integers(-80, 80)), int(rng.integers(len(visitor) - INSIDE))
            people = [np.roll(view.depth, shift, axis=1) for view in visitor[first : first + INSIDE]]
            rooms = [noisy(empty, rng) for _ in people]
            seen = [(p > 0) & (p < 1e3 * empty) for p in people]  # with the noise of their camera
            inside = [np.where(s, p, r) for s, p, r in zip(seen, people, rooms, strict=True)]
            camera.restart()  # so that nothing is known of the person before
            camera.show(SETTLED, FPS)
            began = time.monotonic()
            camera.show(INSIDE, FPS, (replace(room, depth=each) for each in inside))
            time.sleep(1.0)
            soon.append(recovery(log, began))
            print(f"{name}, entry {k}: known after {soon[-1]:.2f} s", flush=True)
        camera.end()
        run.wait(60.0)
        bus.close()
    found = {"room": name, "empty_ms_per_frame": cost, "median_s": float(np.median(soon)), "known_s": soon}
    print({key: found[key] for key in ("room", "empty_ms_per_frame", "median_s")}, flush=True)
    return found


def processor_seconds_of_all(pid: int) -> float:
    """Processor time of a process and its children."""
    children = psutil.Process(pid).children(recursive=True)
    return sum(processor_seconds(each) for each in (pid, *(child.pid for child in children)))


def noisy(depth_m: Array, rng: np.random.Generator) -> NDArray[np.uint16]:
    """A depth image (H, W) in metres with the noise of a time-of-flight camera, in millimetres."""
    sigma = 0.0012 + 0.0019 * (depth_m - 0.4) ** 2
    noise = sigma * rng.standard_normal(depth_m.shape)
    return np.where(depth_m > 0.0, np.rint(1e3 * (depth_m + noise)), 0.0).astype(np.uint16)


TRACKED = ("--publish", RESULTS, "--no-pictures", "--idle-timeout", "120")


def start(*arguments: str) -> subprocess.Popen[bytes]:
    """A `gepf` process."""
    return subprocess.Popen(
        [sys.executable, "-m", "gepf.coordinator.cli", *arguments], stdout=subprocess.DEVNULL
    )


def start_worker(endpoint: str) -> subprocess.Popen[bytes]:
    """A worker of one lane."""
    return subprocess.Popen([sys.executable, "-m", "gepf.worker.cli", "--lanes", "1", "--connect", endpoint])


def kill(processes: dict[str, subprocess.Popen[bytes]]) -> None:
    """End all processes."""
    for each in processes.values():
        each.kill()


def endure(chosen: argparse.Namespace) -> int:
    """Show one sequence, forth and back, while things go wrong; what each disturbance cost."""
    frames = images_of(chosen.data / chosen.only[0])
    shown, log, memory = cycle(chain(frames, frames[-2:0:-1])), Log(), list[tuple[float, float]]()
    ends = time.monotonic() + 60.0 * chosen.minutes
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        endpoint, done = f"unixsock-stream/{folder}/bus", threading.Event()
        processes = {"router": start("router", "--listen", endpoint)}
        stack.callback(kill, processes)
        processes |= {name: start_worker(endpoint) for name in ("worker", "second worker")}
        run = start(
            "track",
            f"zenoh:{KEY}",
            "--out",
            f"{folder}/run",
            "--workers",
            "0",
            "--connect",
            endpoint,
            *TRACKED,
        )
        processes["coordinator"] = run
        bus = open_worker([endpoint])
        stack.callback(bus.close)
        bus.subscribe(RESULTS, log.receive)
        stack.callback(done.set)
        threading.Thread(target=watch_memory, args=(run.pid, memory, done), daemon=True).start()
        time.sleep(READY_S)
        camera, costs = Camera(bus, frames, log), list[tuple[str, float]]()
        camera.show(300, 30.0, shown)
        while time.monotonic() < ends and run.poll() is None:
            for name in DISTURBANCES:
                disturb(name, camera, shown, processes, endpoint)
                began = time.monotonic()
                camera.show(300, 30.0, shown)
                costs.append((name, recovery(log, began)))
                print(f"{name}: known again after {costs[-1][1]:.2f} s", flush=True)
        held = [mb for _, mb in memory]  # before the files are written
        camera.end()
        code = run.wait(60.0)
    keep({"exit": code, "recovery_s": costs, "memory_mb": memory}, chosen.out)
    if chosen.picture:
        draw(log, memory, chosen.picture)
    print(f"exit {code}; memory from {held[len(held) // 10]:.0f} to {held[-1]:.0f} MB")
    return int(code != 0)


DISTURBANCES = (
    *("the camera stalls", "the camera restarts", "15 frames a second", "60 frames a second"),
    *("a frame of another size", "a frame from the past", "the router restarts", "a worker is killed"),
    *("a worker stops for a while", "a gap of a minute"),
)


def disturb(
    name: str,
    camera: Camera,
    shown: Iterator[View],
    processes: dict[str, subprocess.Popen[bytes]],
    endpoint: str,
) -> None:
    """Make something go wrong; what is killed is started again."""
    match name:
        case "the camera stalls":
            time.sleep(5.0)
        case "the camera restarts":
            camera.restart()
            camera.show(5, 30.0, shown)  # that fit each other begin a stream
        case "15 frames a second":
            camera.show(150, 15.0, shown)
        case "60 frames a second":
            camera.show(300, 60.0, shown)
        case "a frame of another size":
            odd = View(0, 0.0, np.full((48, 64), 2000, np.uint16), 1000.0, SMALL)
            camera.show(1, 30.0, iter([odd]))
        case "a frame from the past":
            past = replace(camera, number=camera.number - 100, time_s=camera.time_s - 3.0)
            past.show(1, 30.0, shown)
        case "the router restarts":
            processes["router"].kill()
            time.sleep(1.0)
            Path(endpoint.split("/", 1)[1]).unlink(missing_ok=True)
            processes["router"] = start("router", "--listen", endpoint)
            time.sleep(5.0)
        case "a worker is killed":
            processes["worker"].kill()
            processes["worker"] = start_worker(endpoint)
        case "a worker stops for a while":
            processes["second worker"].send_signal(signal.SIGSTOP)
            camera.show(60, 30.0, shown)
            processes["second worker"].send_signal(signal.SIGCONT)
        case _:
            time.sleep(60.0)


def recovery(log: Log, began: float) -> float:
    """Seconds from the first frame after a time to the first known result of a frame from then on."""
    known = [at + delay for at, delay, known in log.answers() if at >= began and known]
    return min(known, default=np.inf) - began


def watch_memory(pid: int, memory: list[tuple[float, float]], done: threading.Event) -> None:
    """Note the memory of a process (MB) every second."""
    while not done.wait(1.0):
        with suppress(OSError, StopIteration):
            lines = Path(f"/proc/{pid}/status").read_text().splitlines()
            held = next(int(line.split()[1]) for line in lines if line.startswith("VmRSS"))
            memory.append((time.monotonic(), held / 1024.0))


def draw(log: Log, memory: Sequence[tuple[float, float]], file: Path) -> None:
    """Latency and memory over time."""
    figure = Figure((10.0, 6.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    began = log.sent[0][0]
    delays = np.array([(at - began, 1e3 * delay) for at, delay, _ in log.answers() if delay < np.inf])
    above.semilogy(*delays.T, ".", markersize=2)
    above.set_ylabel("latency, ms")
    below.plot(*(np.array(memory) - [began, 0.0]).T)
    below.set(xlabel="seconds", ylabel="memory of the coordinator, MB", ylim=(0.0, None))
    figure.savefig(file, dpi=120)


if __name__ == "__main__":
    sys.exit(main())
