"""Several rendered people who walk past each other: python -m benchmarks.crowd.

Each seed is a group of other people in other clothes. They walk to and fro in lanes that are a metre apart,
two in each lane; people in neighbouring lanes walk in opposite directions. The depth has the noise of a
Kinect. A person is in view if a third of them is not hidden by others. Bodies are matched one-to-one to
people within half a metre.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from benchmarks.coloured import Film, film
from benchmarks.running import add_changes, command_line, keep, measured, settings_with
from benchmarks.tracking import bodies_of, prepare
from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.camera import points_of
from gepf.common.kinematics import pose_vertices
from gepf.coordinator.colour.finder import KeypointFinder
from gepf.coordinator.synthesis.clothes import dress
from gepf.coordinator.synthesis.person_scene import SHOT, grounded, random_person, swing_limbs
from gepf.coordinator.synthesis.scenes import Scene
from gepf.coordinator.synthesis.surround import Room, furnished
from gepf.coordinator.tracking.estimate import POSE_UNKNOWN
from gepf.coordinator.tracking.reporting import TrackedFrame, TrackedPerson
from gepf.coordinator.tracking.track_state import Body
from gepf.coordinator.tracking.tracker import Tracker
from gepf.refiners import DirectRefiner

FPS = 30.0
NEAREST_M, LANE_M, ASIDE_M = 2.4, 1.0, 0.6  # of the lanes; of the people of a lane from its middle
REACH, PERIOD_S = 0.36, 8.0  # of a walk, as a share of the lane's distance; to and fro
SAME_PERSON_M = 0.5  # largest distance of a body from the person whom it follows
EXPLAINED_M = 0.08  # largest distance of a point from the body that explains it
IN_VIEW, MAX_OF_OTHERS = 1.0 / 3.0, 0.05  # shares of a person's pixels


class Score(NamedTuple):
    """Of a run: shares in percent, and processor time."""

    recall: float  # of people in view: those with a body
    identity_switches: int  # a body goes over to another person
    error_cm: float
    tracked: float  # of people in view: those whose body is `tracked`
    wrong: float  # of `tracked` bodies: those with a joint off, and false positives
    explained_by_others: float  # of frames: those in which another body explains a part of a person
    false_positives: float  # of bodies: those at nobody, or at a person who has another body
    ms: float  # per frame


def main(arguments: Sequence[str] | None = None) -> int:
    """Render, track, print a line for each row."""
    parser = command_line("crowd", __doc__)
    parser.add_argument("--seeds", nargs=2, type=int, default=[0, 3], metavar=("A", "B"))
    parser.add_argument("--people", type=int, default=6, metavar="N")
    parser.add_argument("--frames", type=int, default=300, metavar="N")
    parser.add_argument("--every", nargs="+", type=int, default=[1, 3], metavar="N")
    parser.add_argument("--room", action="store_true")
    parser.add_argument("--only", nargs="+", choices=("depth", "colour"), default=("depth", "colour"))
    add_changes(parser)
    return measured(measure, parser.parse_args(arguments))


def measure(chosen: argparse.Namespace) -> int:
    """Exit code."""
    prepare()
    scores = dict[tuple[int, str], list[Score]]()
    for seed in range(*chosen.seeds):
        crowd = rendered(chosen.people, seed, chosen.frames, chosen.room)
        for every in chosen.every:
            for row in chosen.only:
                result = score(crowd, every, seed, chosen.changes, in_colour=row == "colour")
                scores.setdefault((every, row), []).append(result)
    lines = [f"{'':18}" + "".join(f"{name:>20}" for name in Score._fields)]
    for (every, row), of_seeds in scores.items():
        values = "".join(f"{value:20.2f}" for value in np.mean(of_seeds, axis=0))
        lines.append(f"{row:8}{FPS / every:6.1f}/s  {values}")
    print("\n".join(lines))
    keep({"lines": lines, "scores": {f"{every} {row}": s for (every, row), s in scores.items()}}, chosen.out)
    return 0


def rendered(people: int, seed: int, frames: int, in_room: bool) -> Film:
    """Frames of people who walk past each other."""
    rng = np.random.default_rng([seed, 58])
    scenes = [walk(n, random_person(rng), frames, rng) for n in range(people)]
    clothes = [dress(scene.model, rng) for scene in scenes]
    crowd = replace(scenes[0], others=tuple(scenes[1:]))
    if in_room:
        middle = replace(scenes[len(scenes) // 2], others=tuple(scenes))
        crowd = replace(crowd, room=furnished(middle, Room(wall_m=4.0)).room)
    return film(crowd, clothes, rng)


def walk(number: int, model: BodyModel, frames: int, rng: np.random.Generator) -> Scene:
    """A person who walks to and fro in a lane."""
    lane, side = divmod(number, 2)
    z_m, times = NEAREST_M + LANE_M * lane, np.arange(frames) / FPS
    begun, direction = rng.uniform(-0.5, 0.5), 1.0 if lane % 2 else -1.0
    phase = 2.0 * np.pi * times / PERIOD_S + begun
    reach = REACH * z_m
    speed = direction * reach * 2.0 * np.pi / PERIOD_S * np.cos(phase)
    poses = np.zeros((frames, len(model.dof_names)))
    poses[:, model.dof("root_tx")] = direction * reach * np.sin(phase) + ASIDE_M * (2 * side - 1)
    poses[:, model.dof("root_tz")] = z_m
    poses[:, model.dof("root_ry")] = -np.radians(80.0) * np.clip(speed / 0.4, -1.0, 1.0)
    travelled = np.cumsum(np.abs(speed)) / FPS
    swing = np.radians(SHOT.step_deg) * np.clip(np.abs(speed) / 0.5, 0.0, 1.0)
    swing *= np.sin(np.pi * travelled / 0.6 + rng.uniform(0.0, 6.0))
    swing_limbs(model, poses, swing)
    return Scene(model, SHOT.camera, FPS, grounded(model, poses), None)


def score(crowd: Film, every: int, seed: int, changes: Sequence[str], *, in_colour: bool) -> Score:
    """Track every n-th frame."""
    settings, finder = settings_with(changes, seed=seed), KeypointFinder() if in_colour else None
    tracker = Tracker(
        DirectRefiner(), settings, bodies_of(settings.preset), people=crowd.in_view.shape[1], colour=finder
    )
    began = time.process_time()
    numbers = range(0, len(crowd.frames), every)
    frames = list(tracker.follow(crowd.frames[n] for n in numbers))
    ms = 1000.0 * (time.process_time() - began) / len(frames)
    followed, in_view, wrong, tracked, false, known, foreign = 0, 0, 0, 0, 0, 0, list[bool]()
    errors, switches, last, seen_tracked = list[float](), 0, dict[int, int](), 0
    for number, frame in zip(numbers, frames, strict=True):
        bodies = known_bodies(frame)
        last = {body: person for body, person in last.items() if is_body(frame, body)}
        pairs = dict(matched(frame, bodies, crowd.joints[number]))
        visible = crowd.in_view[number] > IN_VIEW
        known, in_view, false = (
            known + len(bodies),
            in_view + int(visible.sum()),
            false + len(bodies) - len(pairs),
        )
        for body in bodies:
            is_tracked, person = frame.people[body].estimate.status == "tracked", pairs.get(body)
            tracked += is_tracked
            if person is None:
                wrong += is_tracked
                continue
            apart = joint_errors(frame, body, crowd.joints[number, person])
            switches += last.get(body, person) != person
            last[body] = person
            wrong += is_tracked and float(apart.max()) > settings.certainty.wrong_m
            if visible[person]:
                followed, seen_tracked = followed + 1, seen_tracked + is_tracked
                errors.append(float(apart.mean()))
        foreign.append(any(explained_by_others(crowd, number, frame, pairs)))
    return Score(
        100.0 * followed / max(1, in_view),
        switches,
        100.0 * float(np.mean(errors or [np.nan])),
        100.0 * seen_tracked / max(1, in_view),
        100.0 * wrong / max(1, tracked),
        100.0 * float(np.mean(foreign)),
        100.0 * false / max(1, known),
        ms,
    )


def known_bodies(frame: TrackedFrame) -> list[int]:
    """The indices of the bodies whose pose is known."""
    return [n for n, p in enumerate(frame.people) if p.estimate.status not in POSE_UNKNOWN]


def is_body(frame: TrackedFrame, person: int) -> bool:
    """Whether a number still belongs to the same body."""
    return isinstance(frame.people[person].state.track, Body)


def joint_errors(frame: TrackedFrame, body: int, joints: Array) -> Array:
    """Errors (J,) in metres of a body."""
    return np.asarray(np.linalg.norm(frame.people[body].estimate.joint_positions - joints, axis=-1))


def matched(frame: TrackedFrame, bodies: Sequence[int], joints: Array) -> Iterator[tuple[int, int]]:
    """Pairs of a body and the person whom it follows."""
    if not bodies:
        return
    costs = np.array([[joint_errors(frame, body, one).mean() for one in joints] for body in bodies])
    for row, person in zip(*linear_sum_assignment(np.minimum(costs, 2.0 * SAME_PERSON_M)), strict=True):
        if costs[row, person] < SAME_PERSON_M:
            yield bodies[row], int(person)


def explained_by_others(
    crowd: Film, number: int, frame: TrackedFrame, pairs: dict[int, int]
) -> Iterator[bool]:
    """Whether too many points of each followed person are explained by another body than its own."""
    (view,), bodies = crowd.frames[number].views, known_bodies(frame)
    depth = view.metres()
    if not pairs:
        return
    surfaces = [surface_of(frame.people[body]) for body in bodies]
    tree, owners = cKDTree(np.concatenate(surfaces)), np.repeat(bodies, [len(one) for one in surfaces])
    for body, person in pairs.items():
        points = points_of(depth, view.intrinsics, (crowd.owners[number] == person) & (depth > 0.0))[::7]
        if len(points):
            distances, nearest = tree.query(points)
            others = (distances < EXPLAINED_M) & (owners[nearest] != body)
            yield bool(np.mean(others) > MAX_OF_OTHERS)


def surface_of(person: TrackedPerson) -> Array:
    """Vertices (V, 3) of a body in its estimated pose, metres."""
    return np.asarray(pose_vertices(person.state.body, person.estimate.pose[None])[0])


if __name__ == "__main__":
    sys.exit(main())
