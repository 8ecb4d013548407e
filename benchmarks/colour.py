"""What colour brings and what wrong keypoints cost, on rendered people: python -m benchmarks.colour.

People in random clothes who move fast, with the noise of a Kinect and exact truth. The rows after the first
two disturb the keypoints that the network finds. A joint is off if its error is above 15 cm; all joints of
a body that is not known are off.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from benchmarks import gestures
from benchmarks.coloured import Film, film
from benchmarks.running import command_line, keep
from benchmarks.tracking import bodies_of, prepare
from gepf.common.arrays import Array, Indices, Mask
from gepf.common.frame import Frame
from gepf.coordinator.colour.finder import KeypointFinder, PeopleInColour
from gepf.coordinator.colour.keypoints import TRUNK
from gepf.coordinator.colour.matching import EXCHANGED, ExpectedBody
from gepf.coordinator.filters.methods import settings_for
from gepf.coordinator.settings import CertaintySettings, ColourSettings
from gepf.coordinator.synthesis.clothes import dress
from gepf.coordinator.synthesis.noise import SensorModel
from gepf.coordinator.synthesis.person_scene import person
from gepf.coordinator.synthesis.scenes import Scene, turn
from gepf.coordinator.tracking.estimate import POSE_UNKNOWN
from gepf.coordinator.tracking.tracker import Tracker
from gepf.refiners import DirectRefiner

SCENES: dict[str, Callable[[int], Scene]] = {"person": person, "turn": lambda _: turn(), **gestures.SCENES}
SENSOR = SensorModel(jump_m=0.1)
"""A Kinect. With gaps at steps of 3 cm, the rows of a floor three metres away would be edges, too."""
LIMBS = ("elbow", "wrist", "knee", "ankle")
FARTHEST_M = 0.5  # error above which a body does not follow a person
SHARE, MOVED_M, LATE_S, MIRRORED_S = 0.15, 0.26, 1.0, (1.0, 4.0)
SHIFTED_M = 0.1  # of colour that is not registered
Seen = NDArray[np.float32]
"""Keypoints (17, 3) of an image."""


class Moment(NamedTuple):
    """Keypoints of a frame, those of all frames until then by time, pixels per metre, and random numbers."""

    frame: Frame
    seen: Seen
    past: dict[float, Seen]
    per_metre: float
    rng: np.random.Generator


class Score(NamedTuple):
    """Of a run: shares of joints off, mean error in metres, and shares of frames."""

    limbs_off: float  # elbows, wrists, knees and ankles
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
    """Finds the keypoints of people in the images of one camera, and disturbs them."""

    def __init__(self, disturb: Disturb, seed: int) -> None:
        super().__init__()
        self._disturb, self._past = disturb, dict[int, dict[float, Seen]]()
        self._rng = np.random.default_rng([seed, 59])

    def submit(
        self, frame: Frame, bodies: Sequence[ExpectedBody | None], settings: ColourSettings
    ) -> Future[PeopleInColour]:
        """Disturbed keypoints."""
        people = super().submit(frame, bodies, settings).result()
        future = Future[PeopleInColour]()
        disturbed = [self._disturbed(frame, n, seen) for n, seen in enumerate(people.keypoints)]
        future.set_result(people._replace(keypoints=disturbed))
        return future

    def _disturbed(self, frame: Frame, person: int, seen: Mapping[str, Seen]) -> dict[str, Seen]:
        """The keypoints of a person by camera."""
        (view,) = frame.views
        if view.camera not in seen:
            return {}
        past = self._past.setdefault(person, {})
        past[frame.time_s] = seen[view.camera]
        places = np.rint(seen[view.camera][TRUNK, :2]).astype(int)
        columns, rows = np.clip(places, 0, np.array(view.depth.shape[::-1]) - 1).T
        depth = view.metres()[rows, columns]
        per_metre = view.intrinsics.fx / float(np.median(depth[depth > 0.0])) if depth.any() else 0.0
        after = self._disturb(Moment(frame, seen[view.camera], past, per_metre, self._rng))
        return {} if after is None else {view.camera: after.astype(np.float32)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Render, track, print a line for each row."""
    parser = command_line("colour", __doc__)
    parser.add_argument("--seeds", nargs=2, type=int, default=[0, 3], metavar=("A", "B"))
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=["person"], metavar="SCENE")
    parser.add_argument("--frames", type=int, default=None, metavar="N")
    parser.add_argument("--only", nargs="+", choices=list(ROWS), default=list(ROWS), metavar="ROW")
    chosen: argparse.Namespace = parser.parse_args(arguments)
    prepare()
    columns = ("limbs off", "joints off", "mean", "known", "tracked and wrong", "keypoints")
    lines = [f"{'':36}" + "".join(f"{column:>19}" for column in columns)]
    print(lines[0], flush=True)
    for scene in chosen.scenes:
        for name in chosen.only:
            runs = (rendered(scene, seed, chosen.frames) for seed in range(*chosen.seeds))
            scores = [score(run, ROWS[name], seed) for seed, run in enumerate(runs, chosen.seeds[0])]
            values = 100.0 * np.mean(scores, axis=0)
            units = [" cm" if field == "error_m" else " %" for field in Score._fields]
            cells = [f"{value:.1f}{unit}" for value, unit in zip(values, units, strict=True)]
            lines.append(f"{scene:10}{name:26}" + "".join(f"{cell:>19}" for cell in cells))
            print(lines[-1], flush=True)
    keep(lines, chosen.out)
    return 0


@cache
def rendered(scene: str, seed: int, frames: int | None) -> Film:
    """The first frames of a scene, in random clothes."""
    shown, rng = SCENES[scene](seed), np.random.default_rng([seed, 7])
    people = [replace(each, poses=each.poses[:frames].copy()) for each in (shown, *shown.others)]
    first = replace(people[0], others=tuple(people[1:]))
    return film(first, [dress(each.model, rng) for each in people], rng, SENSOR)


def without_colours(frame: Frame) -> Frame:
    """The depth of a frame alone."""
    return Frame.of(*(replace(view, colours=None) for view in frame.views))


def score(of: Film, disturb: Disturb | None, seed: int) -> Score:
    """Track the frames, by depth alone without a disturbance."""
    settings = settings_for("gepf", "default", seed=seed)
    finder = None if disturb is None else DisturbedFinder(disturb, seed)
    frames = of.frames if finder is not None else list(map(without_colours, of.frames))
    people, bodies = of.joints.shape[1], bodies_of(settings.preset)
    tracker = Tracker(DirectRefiner(), settings, bodies, people=people, colour=finder)
    reports = [[person.estimate for person in frame.people] for frame in tracker.follow(frames)]
    known = np.array([[each.status not in POSE_UNKNOWN for each in report] for report in reports])
    joints = np.array([[each.joint_positions for each in report] for report in reports])
    order = bodies_in_order(joints, known, of.joints)
    known, apart = known[:, order], np.linalg.norm(joints[:, order] - of.joints, axis=-1)
    off = (apart > CertaintySettings().wrong_m) | ~known[..., None]
    tracked = np.array([[report[n].status == "tracked" for n in order] for report in reports])
    limbs = [any(part in name for part in LIMBS) for name in of.names]
    used = np.mean([[bool(each.keypoints) for each in report] for report in reports])
    return Score(
        float(off[..., limbs].mean()),
        float(off.mean()),
        float(apart[known].mean()),
        float(known.mean()),
        float(np.mean(tracked & off.any(axis=-1))),
        float(used),
    )


def bodies_in_order(joints: Array, known: Mask, truth: Array) -> Indices:
    """For each of N true people (F, N, J, 3), the body (F, N, J, 3) that follows them best in all frames."""
    apart = np.linalg.norm(joints[:, :, None] - truth[:, None], axis=-1).mean(axis=-1)
    costs = np.where(known[:, :, None], np.minimum(apart, FARTHEST_M), FARTHEST_M).sum(axis=0)
    return np.asarray(linear_sum_assignment(costs.T)[1])


if __name__ == "__main__":
    sys.exit(main())
