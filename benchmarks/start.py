"""Accuracy of detection: python -m benchmarks.start.

A start at every 15th frame of rendered and real people, the same after a gap of 15 frames, and a table of
situations: other poses, rotated cameras, empty frames first, a wrong scale, things that are not people, two
people. All in this process, on one core. Progress on stderr, tables on stdout.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from rich.table import Table

from benchmarks.recordings import Recording, choose, find_people, read_frames, read_reference
from benchmarks.running import add_data, command_line, keep, measured, screen
from benchmarks.tracking import follow, prepare
from gepf.common.arrays import Array
from gepf.common.camera import Intrinsics
from gepf.common.frame import Frame, View
from gepf.coordinator.bodies.family import Bodies
from gepf.coordinator.results.evaluation import positions
from gepf.coordinator.settings import preset
from gepf.coordinator.tracking.estimate import Estimate
from gepf.coordinator.tracking.tracker import Tracker
from gepf.refiners import DirectRefiner

PARTS = ("starts", "gaps", "real", "situations")
RENDERED = (
    "three_cameras/dance_cam0", "three_cameras/dance_cam100", "three_cameras/dance_cam220",
    "skinned/dance", "skinned/turn",
)  # fmt: skip
EVERY = 15  # frames between two starts
AFTER = 10  # frames after which a start must be right
GAP = (10, 25)  # first and last empty frame
SITUATION = 30  # frames
EXACT_M, VENDORS_M = 0.10, 0.14  # largest mean joint error that is right; a vendor's joints have offsets


@dataclass(frozen=True, slots=True, eq=False)
class Footage:
    """Frames to track, and joints (J, 3) by frame number; no joints if there is no person."""

    name: str
    frames: list[Frame]
    joints: dict[int, Array]
    names: tuple[str, ...]
    near: float = EXACT_M

    def cut(self, first: int, count: int = SITUATION, name: str | None = None) -> Footage:
        """At most `count` frames from one on."""
        return replace(self, name=name or f"{self.name} {first}", frames=self.frames[first : first + count])


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """The result of a case."""

    name: str
    status: Sequence[str]  # by frame
    right: Sequence[bool | None]  # by frame; None if not known
    seconds: float  # processor time of the slowest frame
    why: str  # why the last frame is in doubt
    error_cm: float  # mean joint error in the last frame; NaN if not known

    @property
    def deceives(self) -> int:
        """Number of frames that are wrong and `tracked`."""
        return sum(s == "tracked" and r is False for s, r in zip(self.status, self.right, strict=True))


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure the selected parts, and print their tables."""
    parser = command_line("start", __doc__)
    add_data(parser)
    parser.add_argument("--only", nargs="+", default=PARTS, choices=PARTS)
    parser.add_argument("--subjects", nargs="+", type=int, default=(1, 2), metavar="N")
    return measured(measure, parser.parse_args(arguments))


def measure(chosen: argparse.Namespace) -> int:
    """Measure and print."""
    bodies, data = prepare(), chosen.data
    rendered = [read(Recording(name, data / name, data / name / "truth.npz")) for name in RENDERED]
    real = find_people(data, chosen.subjects)
    made: dict[str, Callable[[], Iterator[Footage]]] = {
        "starts": lambda: (case for footage in rendered for case in starts(footage)),
        "gaps": lambda: (case for footage in rendered for case in gaps(footage)),
        "real": lambda: (case for recording in real for case in starts(read(recording))),
        "situations": lambda: iter(situations(rendered[-2], rendered[-1], read(choose(real, ["a25_s1"])[0]))),
    }
    kept: dict[str, list[Outcome]] = {}
    for part in chosen.only:
        outcomes = kept[part] = [play(case, bodies) for case in made[part]()]
        screen().print(table_of_each(outcomes) if part == "situations" else table_of_all(part, outcomes))
    keep(kept, chosen.out)
    return 0


def read(recording: Recording) -> Footage:
    """A recording with its joints."""
    frames = read_frames(recording)
    reference = read_reference(recording, frames)
    joints = dict(zip(reference.frame.tolist(), reference.joints, strict=True))
    near = EXACT_M if recording.action is None else VENDORS_M
    return Footage(recording.name, frames, joints, reference.names, near)


def starts(footage: Footage) -> Iterator[Footage]:
    """Cases that start at every 15th frame."""
    for first in range(0, len(footage.frames) - AFTER // 2, EVERY):
        yield footage.cut(first, AFTER + 1)


def gaps(footage: Footage) -> Iterator[Footage]:
    """Cases of ten frames, fifteen empty ones, and ten in which the body must be found again."""
    for first in range(0, len(footage.frames) - GAP[1] - AFTER, EVERY):
        case = footage.cut(first, GAP[1] + AFTER + 1)
        frames = [blank(f) if GAP[0] <= n < GAP[1] else f for n, f in enumerate(case.frames)]
        yield replace(case, frames=frames)


def blank(frame: Frame) -> Frame:
    """The frame without depth."""
    (view,) = frame.views
    return Frame.of(replace(view, depth=np.zeros_like(view.depth)))


def situations(dance: Footage, turn: Footage, sits: Footage) -> list[Footage]:
    """Difficult starts, thirty frames each."""
    front, back = dance.cut(0, name="front"), turn.cut(75, name="back")
    pelvis = dance.names.index("pelvis")
    lowest = max(dance.joints, key=lambda n: float(dance.joints[n][pelvis, 1]))
    kneeling = max(0, min(lowest - 10, len(dance.frames) - SITUATION))
    return [
        front,
        back,
        turn.cut(30, name="side"),
        dance.cut(kneeling, name="kneeling"),
        sits.cut(40, name="sitting"),
        turned(turn.cut(0), 1, "lying, head to the left"),
        turned(front, 3, "portrait"),
        turned(front, 2, "upside down"),
        turned(back, 2, "upside down, back"),
        empty_first(front, 5),
        empty_first(front, 50),
        rescaled(front, 0.1),
        rescaled(front, 10.0),
        replace(front, name="two people", frames=[double(frame, 130, 200) for frame in front.frames]),
        *things(front.frames[0].views[0].intrinsics),
    ]


def turned(case: Footage, quarters: int, name: str) -> Footage:
    """A case with all frames turned left by a number of quarter turns."""
    frames, joints = case.frames, case.joints
    for _ in range(quarters):
        frames = [turn_left(frame) for frame in frames]
        joints = {n: each[:, [1, 0, 2]] * [1.0, -1.0, 1.0] for n, each in joints.items()}
    return replace(case, name=name, frames=frames, joints=joints)


def turn_left(frame: Frame) -> Frame:
    """A frame turned left by a quarter turn."""
    (view,) = frame.views
    camera = view.intrinsics
    lens = (camera.fy, camera.fx, camera.cy, camera.width - 1 - camera.cx)
    depth = np.ascontiguousarray(np.rot90(view.depth))
    turned = Intrinsics(camera.height, camera.width, *lens)
    return Frame.of(replace(view, depth=depth, intrinsics=turned))


def empty_first(case: Footage, count: int) -> Footage:
    """A case after a number of empty frames, with numbers below its own."""
    first = case.frames[0]
    before = [replace(blank(first), number=first.number - n) for n in range(count, 0, -1)]
    return replace(case, name=f"{count} empty frames first", frames=[*before, *case.frames])


def rescaled(case: Footage, factor: float) -> Footage:
    """A case with a wrong depth scale: no pose is right."""
    views = (frame.views[0] for frame in case.frames)
    frames = [Frame.of(replace(view, depth_scale=view.depth_scale * factor)) for view in views]
    return replace(case, name=f"depth scale times {factor:g}", frames=frames, joints={})


def double(frame: Frame, columns: int, behind_mm: int) -> Frame:
    """A frame with a second copy of its person, to the right and farther away."""
    (view,) = frame.views
    other = np.roll(view.depth, columns, axis=1)
    other = np.where(other > 0, other + behind_mm, 0).astype(np.uint16)
    return Frame.of(replace(view, depth=np.where(view.depth > 0, view.depth, other)))


def things(camera: Intrinsics) -> list[Footage]:
    """Things that are not people: boards, a box, a ball, a wall, a floor, a coat stand; with noise."""
    v, u = np.indices((camera.height, camera.width))
    board = (np.abs(u - 256) < 55) & (np.abs(v - 212) < 115)
    disc = ((u - 256) / 70.0) ** 2 + ((v - 212) / 110.0) ** 2
    ground = np.where(v > camera.cy + 3, 1.2 * camera.fy / np.maximum(v - camera.cy, 1.0), 0.0)
    shapes = {
        "board": np.where(board, 2.8, 0.0),
        "slanting board": np.where(board, 2.8 + 0.002 * (u - 200), 0.0),
        "box": np.where((np.abs(u - 256) < 75) & (np.abs(v - 260) < 65), 2.8, 0.0),
        "ball": np.where(disc < 1.0, 2.9 - 0.3 * np.sqrt(np.maximum(0.0, 1.0 - disc)), 0.0),
        "wall": np.full(v.shape, 3.0),
        "floor": np.where(ground < 6.0, ground, 0.0),
        "coat stand": np.where((np.abs(u - 251) < 11) & (np.abs(v - 225) < 105), 2.5, 0.0),
    }
    return [Footage(name, noisy(shape, camera), {}, ()) for name, shape in shapes.items()]


def noisy(depth_m: Array, camera: Intrinsics) -> list[Frame]:
    """Frames of a depth image (H, W) in metres with a time-of-flight camera's noise."""
    rng, frames = np.random.default_rng(0), []
    sigma = 0.0012 + 0.0019 * (depth_m - 0.4) ** 2
    for n in range(SITUATION):
        noised = np.rint(1000.0 * (depth_m + sigma * rng.standard_normal(depth_m.shape)))
        depth = np.where(depth_m > 0.0, noised, 0.0).astype(np.uint16)
        frames.append(Frame.of(View(n, n / 30.0, depth, 1000.0, camera)))
    return frames


def play(case: Footage, bodies: Bodies) -> Outcome:
    """Track a case from its first frame; print a line if it ends wrong."""
    tracker = Tracker(DirectRefiner(), preset("default"), bodies)
    tracker.prepare()
    found, seconds = follow(tracker, case.frames)
    estimates, names = [one.estimate for one in found], found[-1].state.start.model.joint_names
    errors = [distance(case, names, estimate) for estimate in estimates]
    right = [judge(case, *each) for each in zip(estimates, errors, strict=True)]
    last, error_cm = estimates[-1], 100.0 * errors[-1]
    if case.joints and right[-1] is not True:
        sys.stderr.write(f"{case.name}: {last.status}, {error_cm:.0f} cm off; {last.why}\n")
    return Outcome(case.name, [e.status for e in estimates], right, float(seconds.max()), last.why, error_cm)


def distance(case: Footage, names: tuple[str, ...], estimate: Estimate) -> float:
    """Mean error of the joints in metres; NaN if it is not known."""
    truth = case.joints.get(estimate.frame)
    if truth is None:
        return float("nan")
    mine: Array = estimate.joint_positions[positions(names, case.names)]
    return float(np.linalg.norm(mine - truth, axis=-1).mean())


def judge(case: Footage, estimate: Estimate, error: float) -> bool | None:
    """Whether an estimate is right; if there is no person, none is."""
    if not case.joints:
        return False
    return None if estimate.frame not in case.joints else error < case.near


def table_of_all(part: str, outcomes: Sequence[Outcome]) -> Table:
    """The table: one line for many starts."""
    known = [outcome for outcome in outcomes if outcome.right[-1] is not None]
    wrong = [outcome for outcome in known if not outcome.right[-1]]
    seconds = [outcome.seconds for outcome in outcomes]
    columns = ("starts", "right at the end", "wrong and called tracked", "frames so", "s of one core")
    table = Table(*columns, title=part)
    table.add_row(
        str(len(known)),
        str(len(known) - len(wrong)),
        str(sum(outcome.status[-1] == "tracked" for outcome in wrong)),
        f"{sum(one.deceives for one in outcomes)} of {sum(len(one.status) for one in outcomes)}",
        f"{np.median(seconds):.2f}, at most {max(seconds):.2f}",
    )
    return table


def table_of_each(outcomes: Sequence[Outcome]) -> Table:
    """The table: a line for each situation."""
    table = Table("situation", "frames", "wrong and called tracked", "last", "why", title="situations")
    for one in outcomes:
        frames = ", ".join(f"{n} {status}" for status, n in Counter(one.status).items())
        share = 100.0 * one.deceives / len(one.status)
        error = "" if np.isnan(one.error_cm) else f"{one.error_cm:.1f} cm"
        table.add_row(one.name, frames, f"{share:.0f} %", error, one.why)
    return table


if __name__ == "__main__":
    sys.exit(main())
