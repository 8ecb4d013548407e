"""Keypoints in colour images on the way of a frame: found, used, recorded."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import msgspec
import numpy as np
import pytest

from gepf.common.camera import project
from gepf.common.frame import DepthFrame
from gepf.common.kinematics import keypoint_positions, pose_vertices
from gepf.common.protocol.frames import decode_frame, encode_frame
from gepf.common.refinement import Particles
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.colour.finder import (
    ExpectedBody,
    KeypointFinder,
    crop_of,
    in_image,
    keypoint_cost,
    with_keypoints,
)
from gepf.coordinator.pool.options import PoolStatistics
from gepf.coordinator.results.log import Entry, Opening, append_records, assemble, read_log
from gepf.coordinator.synthesis.clothes import dress
from gepf.coordinator.synthesis.rendering import ColouredSurface, DepthRenderer
from gepf.coordinator.tracking.observation import isolate
from gepf.refiners import DirectRefiner
from tests.support.people import (
    CAMERA,
    FRAMES,
    SETTINGS,
    STANDING,
    OnePerson,
    as_bytes,
    known,
    raised,
    shown,
    tracker,
)

pytest.importorskip("ai_edge_litert", reason="the extra color is not installed")


@cache
def coloured() -> list[DepthFrame]:
    """The frames of a person who raises the left arm, with colour."""
    model, frames = human(1.82), list[DepthFrame]()
    clothes = dress(model, np.random.default_rng(0))
    with DepthRenderer(CAMERA) as renderer:
        for number, frame in enumerate(shown("standing").frames):
            pose = name_pose(model, raised(STANDING, number))
            surface = ColouredSurface(pose_vertices(model, pose[None])[0], model.triangles, clothes)
            image = renderer.colours(surface, np.array([0.6, 0.6, 0.5]), np.array([0.3, -0.5, -1.0]))
            frames.append(replace(frame, colours=image))
    return frames


def looking(**others: object) -> OnePerson:
    """A tracker of the known person, which looks at colour."""
    start = {} if others else {"start": STANDING}
    return OnePerson(DirectRefiner(), SETTINGS, known(), colour=KeypointFinder(), **start, **others)  # type: ignore[arg-type]


def test_without_colour_the_bytes_are_those_of_depth() -> None:
    """Whether keypoints could be found or not."""
    alone, whole = tracker(), looking()
    for frame in shown("standing").frames:
        assert as_bytes(whole.track(frame)) == as_bytes(alone.track(frame))


def test_keypoints_are_used_recorded_and_the_same_after_a_restart(tmp_path: Path) -> None:
    """They are those of the person, in pixels of the image, and change the estimate.

    From the recorded state after any frame, a new tracker gives the same bytes.
    """
    frames, alone = coloured(), tracker()
    said = [tracked.people[0].estimate for tracked in looking().follow(frames)]
    model, following = human(1.82), looking()
    with (tmp_path / "log").open("ab") as file:
        for number, frame in enumerate(frames):
            estimate = following.track(frame)
            assert as_bytes(estimate) == as_bytes(said[number])
            assert as_bytes(estimate) != as_bytes(alone.track(frame))
            pose = name_pose(model, raised(STANDING, number))[None]
            off = estimate.keypoints[""][:, :2] - project(keypoint_positions(model, pose)[0], CAMERA)
            assert np.median(np.linalg.norm(off, axis=1)) < 6.0  # pixels
            state = following.state
            (person,) = state.people
            entry = Entry(state.frame, [person.start], [person.checkpoint], [estimate], PoolStatistics(), 0.0)
            append_records(file.fileno(), [Opening({}), entry])
            recorded = read_log(Path(file.name))
            assert recorded is not None
            following = looking(state=recorded.state)
    assert recorded is not None
    track = assemble(following.model, recorded.people[0].estimates)
    assert track.keypoint is not None
    assert track.keypoint.shape == (FRAMES, 1, 17, 3)
    assert np.array_equal(track.keypoint[-1, 0], said[-1].keypoints[""])


def test_workers_weigh_what_the_coordinator_says() -> None:
    """The log likelihood changes by the cost of the keypoints, which go over the wire with the frame."""
    frame, whole = coloured()[0], known().tracked(known().usual_size, STANDING)
    subject = isolate(frame, 500)
    (found,) = KeypointFinder().submit(frame, [ExpectedBody(*whole)]).result()
    seen = with_keypoints(subject, found)
    assert subject is not None
    assert seen is not None
    assert seen.frame.colours is None  # workers and searches do not keep it
    np.testing.assert_allclose(in_image(seen)[""], found[""], atol=1e-4)
    still = msgspec.structs.replace(SETTINGS.refine, icp_iterations=0)
    poses = whole[1] + 0.1 * np.random.default_rng(0).normal(size=(5, len(whole[1])))
    without, weighed = (
        DirectRefiner().refine(each, whole[0], Particles(poses, still))
        for each in (subject, decode_frame(encode_frame(seen)))
    )
    costs = [keypoint_cost(whole[0], pose, seen) for pose in weighed.poses]  # within the joints' limits
    assert min(costs) > 1.0
    np.testing.assert_allclose(without.log_likelihood - weighed.log_likelihood, costs, rtol=1e-6)


def test_nobody_is_looked_for_outside_the_image() -> None:
    """A body beside the image or behind the camera has no crop."""
    model, pose = known().tracked(known().usual_size, STANDING)
    assert crop_of(ExpectedBody(model, pose), coloured()[0]) is not None
    for name, value in (("root_tx", 9.0), ("root_tz", -3.0)):
        away = pose.copy()
        away[model.dof(name)] = value
        assert crop_of(ExpectedBody(model, away), coloured()[0]) is None


def test_a_person_in_the_image_is_one_body() -> None:
    """Of two bodies around whom the network sees the same person, the nearer one keeps the keypoints."""
    model, pose = known().tracked(known().usual_size, STANDING)
    beside = pose.copy()
    beside[model.dof("root_tx")] += 0.3
    bodies, frame = [ExpectedBody(model, each) for each in (pose, beside)], coloured()[0]
    finder = KeypointFinder()
    for body in bodies:
        (alone,) = finder.submit(frame, [body]).result()
        assert alone
    for pair, holder in ((bodies, 0), (bodies[::-1], 1)):
        found = finder.submit(frame, pair).result()
        assert [bool(keypoints) for keypoints in found] == [place == holder for place in range(2)]
