"""What colour brings and what wrong keypoints cost, on rendered people: python -m benchmarks.colour.

People in random clothes who move fast, with the noise of a Kinect and exact truth. Each row disturbs the
keypoints that the network finds. A joint is off if its error is above 15 cm.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.running import command_line, keep
from benchmarks.tracking import bodies_of, follow, prepare
from gepf.common.arrays import Array
from gepf.common.frame import Frame, View
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.coordinator.colour.finder import KeypointFinder, PeopleInColour
from gepf.coordinator.colour.matching import EXCHANGED, ExpectedBody
from gepf.coordinator.filters.methods import settings_for
from gepf.coordinator.scene.noise import SensorNoise
from gepf.coordinator.settings import CertaintySettings, ColourSettings
from gepf.coordinator.sources.source import to_units
from gepf.coordinator.synthesis.clothes import dress
from gepf.coordinator.synthesis.noise import add_noise
from gepf.coordinator.synthesis.person_scene import person
from gepf.coordinator.synthesis.rendering import ColouredSurface, DepthRenderer
from gepf.coordinator.synthesis.scenes import Scene, turn
from gepf.coordinator.tracking.estimate import POSE_UNKNOWN
from gepf.coordinator.tracking.tracker import Tracker
from gepf.refiners import DirectRefiner

SCENES: dict[str, Callable[[int], Scene]] = {"person": person, "turn": lambda _: turn()}
BACKGROUND, LIGHT = np.array([0.6, 0.6, 0.5]), np.array([0.3, -0.5, -1.0])
IMAGE_NOISE = 4.0  # of 255
SHARE, MOVED_M, LATE_S, MIRRORED_S = 0.15, 0.26, 1.0, (1.0, 4.0)
SHIFTED_M = 0.1  # of colour that is not registered
Seen = NDArray[np.float32]
"""Keypoints (17, 3) of an image."""


@dataclass(frozen=True, eq=False)
class Rendered:
    """Frames of a person with colour, and the true joints (F, J, 3)."""

    frames: list[Frame]
    joints: Array


class Moment(NamedTuple):
    """Keypoints of a frame, those of all frames until then by time, pixels per metre, and random numbers."""

    frame: Frame
    seen: Seen
    past: dict[float, Seen]
    per_metre: float
    rng: np.random.Generator


class Score(NamedTuple):
    """Of a run: shares of joints off, mean error in metres, and shares of frames."""

    off: float
    error_m: float
    known: float
    wrong: float  # tracked, with a joint off
    used: float  # keypoints


Disturb = Callable[[Moment], Seen | None]


def shifted(seen: Seen, columns: float) -> Seen:
    """All keypoints moved to the right by some pixels."""
    return seen + np.array([columns, 0.0, 0.0], np.float32)


def of_another(moment: Moment) -> Seen:
    """Those of a person beside, in another pose."""
    other = moment.past[float(moment.rng.choice(list(moment.past)))]
    return shifted(other, 0.6 * moment.per_metre)


def late(moment: Moment) -> Seen:
    """Those of a second ago."""
    return moment.past[min(moment.past, key=lambda time_s: abs(moment.frame.time_s - LATE_S - time_s))]


def sometimes(disturb: Disturb) -> Disturb:
    """In a share of the frames."""
    return lambda moment: disturb(moment) if moment.rng.random() < SHARE else moment.seen


def mirrored_for_a_while(moment: Moment) -> Seen:
    """Left and right are exchanged for three seconds."""
    return moment.seen[EXCHANGED] if MIRRORED_S[0] <= moment.frame.time_s < MIRRORED_S[1] else moment.seen


ROWS: dict[str, Disturb | None] = {
    "depth alone": None,
    "with colour": lambda moment: moment.seen,
    "15 % mirrored": sometimes(lambda moment: moment.seen[EXCHANGED]),
    "15 % moved by 26 cm": sometimes(lambda moment: shifted(moment.seen, MOVED_M * moment.per_metre)),
    "15 % missing": sometimes(lambda _: None),
    "15 % of another person": sometimes(of_another),
    "15 % late by 1 s": sometimes(late),
    "mirrored for 3 s": mirrored_for_a_while,
    "all late by 1 s": late,
    "all moved by 10 cm": lambda moment: shifted(moment.seen, SHIFTED_M * moment.per_metre),
    "all moved by 26 cm": lambda moment: shifted(moment.seen, MOVED_M * moment.per_metre),
}


class DisturbedFinder(KeypointFinder):
    """Finds keypoints of one person, and disturbs them."""

    def __init__(self, disturb: Disturb, seed: int) -> None:
        super().__init__()
        self._disturb, self._past = disturb, dict[float, Seen]()
        self._rng = np.random.default_rng([seed, 59])

    def submit(
        self, frame: Frame, bodies: Sequence[ExpectedBody | None], settings: ColourSettings
    ) -> Future[PeopleInColour]:
        """Disturbed keypoints."""
        people = super().submit(frame, bodies, settings).result()
        (found,) = people.keypoints
        future = Future[PeopleInColour]()
        if "" in found:
            self._past[frame.time_s] = found[""]
            (view,) = frame.views
            per_metre = view.intrinsics.fx / float(np.median(view.metres()[view.depth > 0]))
            seen = self._disturb(Moment(frame, found[""], self._past, per_metre, self._rng))
            found = {} if seen is None else {"": seen.astype(np.float32)}
        future.set_result(people._replace(keypoints=[found]))
        return future


def main(arguments: Sequence[str] | None = None) -> int:
    """Render, track, print a line for each row."""
    parser = command_line("colour", __doc__)
    parser.add_argument("--seeds", nargs=2, type=int, default=[0, 3], metavar=("A", "B"))
    parser.add_argument("--scene", choices=list(SCENES), default="person")
    parser.add_argument("--frames", type=int, default=None, metavar="N")
    parser.add_argument("--only", nargs="+", choices=list(ROWS), default=list(ROWS), metavar="ROW")
    chosen: argparse.Namespace = parser.parse_args(arguments)
    prepare()
    lines = [f"{'':26}{'joints off':>12}{'mean':>9}{'known':>8}{'tracked and wrong':>19}{'keypoints':>11}"]
    print(lines[0], flush=True)
    for name in chosen.only:
        runs = (rendered(chosen.scene, seed, chosen.frames) for seed in range(*chosen.seeds))
        scores = [score(run, ROWS[name], seed) for seed, run in enumerate(runs, chosen.seeds[0])]
        mean = Score(*np.mean(scores, axis=0))
        line = f"{name:26}{100 * mean.off:10.1f} %{100 * mean.error_m:6.1f} cm{100 * mean.known:6.0f} %"
        line += f"{100 * mean.wrong:17.1f} %{100 * mean.used:9.0f} %"
        lines.append(line)
        print(line, flush=True)
    keep(lines, chosen.out)
    return 0


@cache
def rendered(scene: str, seed: int, frames: int | None) -> Rendered:
    """The first frames of a scene, in random clothes."""
    shown, rng = SCENES[scene](seed), np.random.default_rng([seed, 7])
    model, camera, poses = shown.model, shown.camera, shown.poses[:frames]
    clothes, images, vertices = dress(model, rng), list[Frame](), pose_vertices(model, poses)
    with DepthRenderer(camera) as renderer:
        for number, surface in enumerate(vertices):
            clean = renderer.depth(surface, model.triangles).astype(np.float64)
            depth = to_units(add_noise(clean, camera, SensorNoise(0.0, 0.0), rng, kinect=True), 1000.0)
            seen = renderer.colours(ColouredSurface(surface, model.triangles, clothes), BACKGROUND, LIGHT)
            noisy = seen + rng.normal(0.0, IMAGE_NOISE, seen.shape)
            colours = np.clip(noisy, 0, 255).astype(np.uint8)
            view = View(number, number / shown.fps, depth, 1000.0, camera, colours=colours)
            images.append(Frame.of(view))
    return Rendered(images, joint_positions(model, poses))


def without_colours(frame: Frame) -> Frame:
    """The depth of a frame alone."""
    return Frame.of(*(replace(view, colours=None) for view in frame.views))


def score(of: Rendered, disturb: Disturb | None, seed: int) -> Score:
    """Track the frames, by depth alone without a disturbance."""
    settings = settings_for("gepf", "default", seed=seed)
    finder = None if disturb is None else DisturbedFinder(disturb, seed)
    frames = of.frames if finder is not None else list(map(without_colours, of.frames))
    tracker = Tracker(DirectRefiner(), settings, bodies_of(settings.preset), colour=finder)
    estimates = [person.estimate for person in follow(tracker, frames)[0]]
    known = np.array([each.status not in POSE_UNKNOWN for each in estimates])
    apart = np.linalg.norm(np.array([each.joint_positions for each in estimates]) - of.joints, axis=-1)
    off = (apart > CertaintySettings().wrong_m) | ~known[:, None]
    tracked = np.array([each.status == "tracked" for each in estimates])
    used = float(np.mean([bool(each.keypoints) for each in estimates]))
    wrong = float(np.mean(tracked & off.any(axis=1)))
    return Score(float(off.mean()), float(apart[known].mean()), float(known.mean()), wrong, used)


if __name__ == "__main__":
    sys.exit(main())
