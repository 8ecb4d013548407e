"""The background is learned outside the body, forgets removed objects, and learns objects that stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from gepf.common.arrays import Mask
from gepf.common.frame import SUBJECT
from gepf.coordinator.scene.candidates import find_candidates
from gepf.coordinator.scene.scene import Scene, SceneView
from gepf.coordinator.scene.segmentation import measure_distances, segment_body, slices
from gepf.coordinator.settings import SceneSettings
from tests.support.rooms import CABINET, PERSON, Room

CHAIR = ((0.5, 0.4, 2.3), (0.9, 1.1, 2.7))


def people(view: SceneView, room: Room, person: tuple[float, float] = PERSON) -> Mask:
    """Pixels (H, W) of a person whose body is known."""
    return measure_distances(view, room.surface(person)) < 0.12


def watch(scene: Scene, room: Room, frames: int, person: tuple[float, float] = PERSON) -> None:
    """Frames of a room, in which the body is known."""
    for number in range(frames):
        view = scene.observe(room.see(person, number).view)
        scene.learn(view, people(view, room, person))


def known(scene: Scene) -> NDArray[np.float32]:
    """The background (H, W), metres."""
    return scene.observe(Room().see(None).view).background.copy()


def test_what_is_outside_the_body_is_known_at_once_and_the_body_never() -> None:
    """After many frames of a person who stands still, the background has the room and not the person."""
    scene, room = Scene(SceneSettings()), Room((CABINET,))
    watch(scene, room, 35)
    truth = room.see(PERSON)
    empty = room.see(None).view.metres()
    background = known(scene)
    learned = background > 0.0
    assert learned[~truth.mask].mean() > 0.95
    np.testing.assert_allclose(background[learned], empty[learned], atol=0.03)


def test_what_goes_away_is_forgotten_at_once() -> None:
    """Where an object was removed, the wall behind it is known as soon as it is visible."""
    scene = Scene(SceneSettings())
    watch(scene, Room((CHAIR,)), 2)
    before = known(scene)
    watch(scene, Room(), 1)
    changed = known(scene) > before + 0.2
    shown = Room((CHAIR,)).see(None).view.metres() < Room().see(None).view.metres() - 0.2
    assert changed[shown].mean() > 0.95


def test_what_comes_to_stay_is_taken_in_after_a_while() -> None:
    """A chair that is put down is foreground for half a second, and background after two seconds."""
    scene = Scene(SceneSettings())
    watch(scene, Room(), 5)
    watch(scene, Room((CHAIR,)), 15)
    shown = Room((CHAIR,)).see(None).view.metres() < Room().see(None).view.metres() - 0.2
    chair, empty = (Room(boxes).see(None).view.metres()[shown] for boxes in ((CHAIR,), ()))
    np.testing.assert_allclose(known(scene)[shown], empty, atol=0.03)
    watch(scene, Room((CHAIR,)), 45)
    assert np.mean(np.abs(known(scene)[shown] - chair) < 0.03) > 0.95


@pytest.mark.parametrize("up", [None, (0.1, -0.9, 0.4), (1.0, 0.0, 0.0)])
def test_changes_alone_lead_to_the_same_knowledge(up: tuple[float, ...] | None) -> None:
    """A scene that recalls the changes, one by one or at once, continues as the original one.

    A camera may measure which direction is up. The log and a resumed run have it from the changes alone.
    """
    measured = None if up is None else np.array(up) / np.linalg.norm(up)
    first, second, third = Scene(SceneSettings(), up=measured), Scene(SceneSettings()), Scene(SceneSettings())
    room = Room((CABINET,), noise=0.002)
    for number in range(8):
        person = (PERSON[0] + 0.05 * number, PERSON[1])
        view = first.observe(room.see(person, number).view)
        second.restore(first.learn(view, people(view, room, person)))
    third.restore(second.whole_change())
    frame = room.see(PERSON, 9).view
    views = [scene.observe(frame) for scene in (first, second, third)]
    for view in views[1:]:
        np.testing.assert_array_equal(view.background, views[0].background)
        np.testing.assert_array_equal(view.planes.coefficients, views[0].planes.coefficients)
        np.testing.assert_array_equal(view.planes.up, views[0].planes.up)
        assert view.noise == views[0].noise
    changes = [scene.learn(view) for scene, view in zip((first, second, third), views, strict=True)]
    for change in changes[1:]:
        for name in ("pixels", "depth", "nearer_steps"):
            np.testing.assert_array_equal(getattr(change.learned, name), getattr(changes[0].learned, name))


def test_a_part_of_the_room_that_is_given_is_kept_with_the_rest() -> None:
    """If only a cabinet is known before, a first frame with the whole room does not discard it."""
    room = Room((CABINET,), noise=0.001)
    empty = room.see(None).view.metres()
    cabinet = empty < Room().see(None).view.metres() - 0.2
    leg = cabinet & (np.arange(empty.shape[1]) == np.median(np.nonzero(cabinet)[1]))
    shown = np.where(leg, empty - np.float32(0.3), empty)
    scene = Scene(SceneSettings(), np.where(cabinet, empty, np.float32(0.0)))
    frame = room.see(None).view
    for number in range(3):
        units = np.rint(1000.0 * shown).astype(np.uint16)
        view = scene.observe(replace(frame, number=number, depth=units))
        scene.learn(view, people(view, room))
    np.testing.assert_array_equal(known(scene)[leg], empty[leg])
    assert np.mean(known(scene) > 0.0) > 0.8


def test_a_camera_that_was_moved_forgets() -> None:
    """If most of the image has changed, the background is that of the new image at once."""
    scene = Scene(SceneSettings())
    watch(scene, Room((CABINET,)), 5)
    turned = Room((CABINET,), pitch=0.5)
    watch(scene, turned, 1)
    truth = turned.see(PERSON)
    background = scene.observe(turned.see(None).view).background
    learned = background > 0.0
    assert learned[~truth.mask].mean() > 0.9
    np.testing.assert_allclose(background[learned], turned.see(None).view.metres()[learned], atol=0.03)


def test_who_comes_through_a_door_is_seen() -> None:
    """A person behind the former background is the subject, as long as the person stands there."""
    door = ((-0.9, -0.9, 2.2), (0.1, 1.1, 2.25))
    scene, behind = Scene(SceneSettings()), (PERSON[0], 2.9)
    watch(scene, Room((door,)), 3, (1.2, 2.4))
    for number in range(6):
        frame, truth = Room().see(behind, number)
        view = scene.observe(frame)
        surface = Room().surface(behind)
        found = segment_body(view, surface, measure_distances(view, surface))
        scene.learn(view, people(view, Room(), behind))
    mine = np.zeros_like(truth)
    mine[slices(found.window)] = found.labels == SUBJECT
    assert np.sum(mine & truth) / truth.sum() > 0.95
    assert np.sum(mine & truth) / mine.sum() > 0.95


def test_a_person_who_is_not_found_yet_is_not_learned_as_the_room() -> None:
    """A possible person stays a candidate for any time, while a touching box becomes background."""
    room, scene = Room((CABINET,), noise=0.0015), Scene(SceneSettings())
    for number in range(40):
        frame, truth = room.see(PERSON, number)
        view = scene.observe(frame)
        found = find_candidates(view)
        scene.learn(view, np.logical_or.reduce([each.mask for each in found]))
        assert np.sum(found[0].mask & truth) / truth.sum() > 0.95
    assert np.mean(view.background[~truth] > 0.0) > 0.9
    assert np.mean(view.background[truth] > 0.0) < 0.02


@pytest.mark.parametrize("background", [False, True])
def test_a_frame_of_another_size_begins_a_new_scene(*, background: bool) -> None:
    """The scene is then the same as one with frames of that size only; also in a resumed run."""
    room = Room((CABINET,), noise=0.002)
    scene, recorded = (
        Scene(SceneSettings(), room.see(None).view.metres() if background else None) for _ in range(2)
    )
    fresh = Scene(SceneSettings())
    large = room.see(PERSON).view
    camera = large.intrinsics.crop(10, 5, 120, 90)
    small = replace(large, depth=np.ascontiguousarray(large.depth[5:95, 10:130]), intrinsics=camera)
    for frame in (large, large, small, small, small):
        view = scene.observe(frame)
        recorded.restore(scene.learn(view, people(view, room)))
        if frame is small:
            fresh.learn(fresh.observe(frame), people(view, room))
    for other in (fresh, recorded):
        seen = other.observe(small)
        np.testing.assert_array_equal(seen.background, scene.observe(small).background)
        np.testing.assert_array_equal(seen.planes.coefficients, scene.observe(small).planes.coefficients)
        assert seen.background.shape == (90, 120)
    resumed = Scene(SceneSettings(), room.see(None).view.metres() if background else None)
    resumed.restore(scene.whole_change())
    np.testing.assert_array_equal(resumed.observe(small).background, scene.observe(small).background)


@pytest.mark.parametrize("pitch", [0.0, 0.5])
def test_a_log_knows_the_background_that_was_given(pitch: float) -> None:
    """The recorded changes give the background, also if the given one does not fit."""
    given = Room((CABINET,), pitch=pitch).see(None).view.metres()
    frame = Room((CABINET,)).see(None).view
    dark = np.where(np.arange(frame.depth.shape[1]) < 20, 0, frame.depth).astype(np.uint16)
    watching, recorded, resumed = (
        Scene(SceneSettings(), given),
        Scene(SceneSettings()),
        Scene(SceneSettings(), given),
    )
    recorded.restore(watching.learn(watching.observe(replace(frame, depth=dark))))
    resumed.restore(recorded.whole_change())
    assert known(watching)[:, :20].any() == (pitch == 0.0)
    np.testing.assert_array_equal(known(resumed), known(watching))


@pytest.mark.parametrize("fps", [4.0, 15.0, 30.0, 60.0, 90.0])
def test_what_comes_to_stay_is_taken_in_after_the_same_time_at_any_rate(fps: float) -> None:
    """A chair is background after a second, and not before, however many frames show it."""
    scene, empty, furnished = Scene(SceneSettings()), Room().see(None).view, Room((CHAIR,)).see(None).view
    shown = furnished.metres() < empty.metres() - 0.2
    for number in range(4):
        scene.learn(scene.observe(replace(empty, time_s=number / fps)))
    taken_in = []
    for number in range(4, 4 + round(1.5 * fps)):
        view = scene.observe(replace(furnished, time_s=number / fps))
        scene.learn(view)
        taken_in.append(np.mean(np.abs(view.background - view.depth)[shown] < 0.03) > 0.95)
    first_s = (taken_in.index(True) + 1) / fps
    assert first_s == pytest.approx(1.0, abs=1 / 30)
    assert all(taken_in[taken_in.index(True) :])


def test_what_has_come_during_a_gap_is_not_taken_in_at_once() -> None:
    """A chair in the first frame after a minute without any."""
    scene, empty, furnished = Scene(SceneSettings()), Room().see(None).view, Room((CHAIR,)).see(None).view
    shown = furnished.metres() < empty.metres() - 0.2
    scene.learn(scene.observe(empty))
    scene.learn(scene.observe(replace(furnished, time_s=60.0)))
    np.testing.assert_allclose(known(scene)[shown], empty.metres()[shown], atol=0.03)
