"""The segmenter: the subject is cut out of frame after frame, or found among people."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gepf.common.frame import HIDDEN, SUBJECT, Frame
from gepf.common.kinematics import pose_vertices
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.scene.scene import BACKGROUND, FOREGROUND
from gepf.coordinator.settings import SceneSettings
from gepf.coordinator.tracking.observation import pick
from gepf.coordinator.tracking.segmenter import DetectedBody, ExpectedSurface, Segmenter
from tests.support.people import CAMERA, STANDING, frame_of, rendered
from tests.support.rooms import HEIGHT, PERSON, TABLE, Room, along


def test_a_person_is_found_whose_body_is_not_known() -> None:
    """In a room it is the best candidate, with what hides it; the points are the subject's."""
    room = Room((TABLE,), noise=0.001)
    image, truth = room.see(PERSON)
    segmenter = Segmenter(300, SceneSettings())
    segmented = segmenter.segment(Frame.of(image), [ExpectedSurface()])
    (person,) = segmented.candidates
    (view,) = person.subject.views
    assert view.labels is not None
    assert len(view.picked) == 300
    assert np.all(view.labels.ravel()[view.picked] == SUBJECT)
    assert np.any(view.labels == HIDDEN)
    assert np.sum(view.labels == SUBJECT) / truth.sum() > 0.9
    assert segmenter.learn(segmented)[""].shows_room


def test_what_is_no_person_is_learned_as_room_at_once() -> None:
    """A box that touches a leg was searched too; the changes of the frame contain it."""
    room = Room((((-0.5, 0.8, 2.5), (-0.22, HEIGHT, 2.7)),), noise=0.001)
    seen = room.see((-0.15, 2.6))
    segmenter, again = Segmenter(300, SceneSettings()), Segmenter(300, SceneSettings())
    segmented = segmenter.segment(Frame.of(seen.view), [ExpectedSurface()])
    (person,) = segmented.candidates
    again.restore(
        segmenter.learn(segmented, [DetectedBody(person, person.subject, room.surface((-0.15, 2.6)))])
    )
    following = Frame.of(room.see((-0.15, 2.6), 1).view)
    views = [each.segment(following, [ExpectedSurface()]).views[0].scene for each in (segmenter, again)]
    box = (Room().see(None).view.depth > room.see(None).view.depth + 60) & ~seen.mask
    assert np.mean(views[0].marks[box] == BACKGROUND) > 0.85
    np.testing.assert_array_equal(views[0].marks, views[1].marks)


def test_what_was_taken_for_a_thing_is_not_learned_as_room_if_the_body_covers_it() -> None:
    """Half of a person did not look like one; the body that was detected in the other half covers both."""
    room = Room(noise=0.001)
    seen = room.see(PERSON)
    segmenter = Segmenter(300, SceneSettings())
    segmented = segmenter.segment(Frame.of(seen.view), [ExpectedSurface()])
    (person,) = segmented.candidates
    (view,) = person.subject.views
    upper = view.image.depth.copy()
    upper[len(upper) // 2 :] = 0
    half = replace(person.subject, views=(replace(view, image=replace(view.image, depth=upper)),))
    segmenter.learn(segmented, [DetectedBody(person, half, room.surface(PERSON, 2_000))])
    following = Frame.of(room.see(PERSON, 1).view)
    marks = segmenter.segment(following, [ExpectedSurface()]).views[0].scene.marks
    assert np.mean(marks[seen.mask] == FOREGROUND) > 0.9


@pytest.mark.parametrize("measured", ["head alone", "one frame of holes"])
def test_a_body_of_which_little_is_measured_is_not_learned_as_room(measured: str) -> None:
    """Dark clothes, or holes in a frame: unmeasured pixels are no evidence that the person is absent."""
    model, pose = human(1.82), name_pose(human(1.82), STANDING)
    (person,) = rendered(model, pose[None])
    v, u = np.indices(person.shape)
    room = along(1.15, np.asarray((v - CAMERA.cy) / CAMERA.fy))
    room[room > 3.9] = 4.0 if measured == "head alone" else 0.0  # a wall, or one beyond the camera's range
    whole = np.where(person > 0.0, person, room)
    rows = np.flatnonzero((person > 0.0).any(axis=1))
    holes = v > rows[0] + 0.3 * len(rows) if measured == "head alone" else (3 * u + 5 * v) % 8 > 0
    poor = np.where((person > 0.0) & holes, 0.0, whole)
    frames = [poor] * 8 if measured == "head alone" else [*[whole] * 5, poor, *[whole] * 3]
    segmenter, body = Segmenter(1_500, SceneSettings()), pose_vertices(model, pose[None])[0]
    subjects = []
    for number, depth in enumerate(frames):
        segmented = segmenter.segment(frame_of(number, depth), [ExpectedSurface(body)])
        segmenter.learn(segmented)
        subjects.append(segmented.subjects[0])
    assert subjects[-1] is not None
    assert subjects[-1].pixels > 0.95 * np.count_nonzero((person > 0.0) & (frames[-1] > 0.0))


def test_points_that_have_moved_are_picked_more_densely() -> None:
    """Something thin comes beside a trunk that did not move: all of it is picked, and a tenth of the rest."""
    place = (-0.2, 1.6)
    held = ((place[0] + 0.2, -0.3, place[1] - 0.1), (place[0] + 0.27, 0.4, place[1]))
    segmenter, surface = Segmenter(10_000, SceneSettings()), Room().surface(place)
    for number in range(20):
        room = Room((held,) if number == 19 else (), noise=0.001)
        segmented = segmenter.segment(Frame.of(room.see(place, number).view), [ExpectedSurface(surface)])
        segmenter.learn(segmented)
    (subject,) = segmented.subjects
    assert subject is not None
    view, picked = subject.largest, np.zeros(subject.largest.image.depth.size, np.bool_)
    picked[view.picked] = True
    left, top, _, _ = view.extent
    new = Room((held,)).see(None).view.depth < Room().see(None).view.depth - 100
    new = new[-top : -top + view.image.depth.shape[0], -left : -left + view.image.depth.shape[1]]
    density = [picked[(view.image.depth.ravel() > 0) & mask.ravel()].mean() for mask in (new, ~new)]
    assert density[0] > 0.9
    assert density[1] < 0.2


def test_points_are_picked_evenly_by_weight() -> None:
    """Half of the pixels have a tenth of the weight of the others; all are used if the weights are equal."""
    measured, weights = np.arange(10_000, dtype=np.uint32), np.ones(10_000, np.float32)
    assert np.array_equal(pick(measured, 50_000, weights), measured)
    weights[:5_000] = 0.1
    picked = pick(measured, 2_200, weights)
    assert len(picked) == 2_200
    assert np.count_nonzero(picked < 5_000) == 200
    assert np.ptp(np.diff(picked[:200])) <= 1
    assert len(pick(measured, 50_000, weights)) == 5_500
    assert len(pick(measured[:0], 100, weights)) == 0


@pytest.mark.parametrize("heavy", [0, 1, 40])
def test_a_small_body_loses_no_points(heavy: int) -> None:
    """Somebody far away who stands still has all points, and a few more pixels do not halve them."""
    weights = np.full(1_100, 0.1, np.float32)
    weights[:heavy] = 1.0
    counts = [len(pick(np.arange(n, dtype=np.uint32), 3_000, weights)) for n in (160, 1_000, 1_100)]
    assert counts[:2] == [160, 1_000]
    assert counts[2] > 700
