"""The background is learned outside the body, forgets what goes away, and takes in what stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from common.frame import SUBJECT
from coordinator.scene.cutting import cut_out
from coordinator.scene.room.background import DEEPER, FIRST, NEARER
from coordinator.scene.scene import Scene
from tests.support.rooms import CABINET, Room

PERSON = (-0.4, 2.6)
CHAIR = ((0.5, 0.4, 2.3), (0.9, 1.1, 2.7))


def watch(scene: Scene, room: Room, frames: int, person: tuple[float, float] = PERSON) -> None:
    """Frames of a room, in which the body is known."""
    for number in range(frames):
        view = scene.see(room.see(person, number).frame)
        scene.learn(view, cut_out(view, room.surface(person)))


def known(scene: Scene) -> NDArray[np.float32]:
    """The background (H, W), metres."""
    return scene.see(Room().see(None).frame).background.copy()


def test_what_is_outside_the_body_is_known_at_once_and_the_body_never() -> None:
    """After many frames of somebody who stands still, the background holds the room and not the person."""
    scene, room = Scene(), Room((CABINET,))
    watch(scene, room, NEARER + 5)
    truth = room.see(PERSON)
    empty = room.see(None).frame.metres()
    background = known(scene)
    learned = background > 0.0
    assert learned[~truth.mask].mean() > 0.95
    np.testing.assert_allclose(background[learned], empty[learned], atol=0.03)


def test_who_goes_away_is_forgotten_in_three_frames() -> None:
    """Where a thing stood, the wall behind it is known after three frames of it."""
    scene = Scene()
    watch(scene, Room((CHAIR,)), 2)
    before = known(scene)
    watch(scene, Room(), DEEPER - 1)
    np.testing.assert_array_equal(known(scene), before)
    watch(scene, Room(), 1)
    changed = known(scene) > before + 0.2
    shown = Room((CHAIR,)).see(None).frame.metres() < Room().see(None).frame.metres() - 0.2
    assert changed[shown].mean() > 0.95


def test_what_comes_to_stay_is_taken_in_after_thirty_frames() -> None:
    """A chair that is put down is foreground until then, and background after it."""
    scene = Scene()
    watch(scene, Room(), FIRST)
    watch(scene, Room((CHAIR,)), NEARER - 1)
    shown = Room((CHAIR,)).see(None).frame.metres() < Room().see(None).frame.metres() - 0.2
    chair, empty = (Room(boxes).see(None).frame.metres()[shown] for boxes in ((CHAIR,), ()))
    np.testing.assert_allclose(known(scene)[shown], empty, atol=0.03)
    watch(scene, Room((CHAIR,)), 1)
    assert np.mean(np.abs(known(scene)[shown] - chair) < 0.03) > 0.95


def test_changes_alone_lead_to_the_same_knowledge() -> None:
    """A scene that recalls what every frame changed, or all at once, goes on as the one that watched."""
    first, second, third = Scene(), Scene(), Scene()
    room = Room((CABINET,), noise=0.002)
    for number in range(8):
        person = (PERSON[0] + 0.05 * number, PERSON[1])
        view = first.see(room.see(person, number).frame)
        second.recall(first.learn(view, cut_out(view, room.surface(person))))
    third.recall(second.all())
    frame = room.see(PERSON, 9).frame
    views = [scene.see(frame) for scene in (first, second, third)]
    for view in views[1:]:
        np.testing.assert_array_equal(view.background, views[0].background)
        np.testing.assert_array_equal(view.planes.coefficients, views[0].planes.coefficients)
        assert view.noise == views[0].noise
    changes = [scene.learn(view, None) for scene, view in zip((first, second, third), views, strict=True)]
    for change in changes[1:]:
        for name in ("pixels", "depth", "rival", "frames"):
            np.testing.assert_array_equal(getattr(change.learned, name), getattr(changes[0].learned, name))


def test_an_empty_room_that_is_given_is_known() -> None:
    """With a picture of the empty room, a chair in it is no candidate's and the person is what came."""
    room = Room((CHAIR,))
    scene = Scene(room.see(None).frame.metres())
    view = scene.see(room.see(PERSON).frame)
    assert view.furnished
    np.testing.assert_array_equal(view.background, room.see(None).frame.metres())


def test_a_part_of_the_room_that_is_given_is_kept_with_the_rest() -> None:
    """Where only a cabinet is known before, a first frame that shows all the room does not void that."""
    room = Room((CABINET,), noise=0.001)
    empty = room.see(None).frame.metres()
    cabinet = empty < Room().see(None).frame.metres() - 0.2
    leg = cabinet & (np.arange(empty.shape[1]) == np.median(np.nonzero(cabinet)[1]))
    shown = np.where(leg, empty - np.float32(0.3), empty)
    scene = Scene(np.where(cabinet, empty, np.float32(0.0)))
    frame = room.see(None).frame
    for number in range(3):
        units = np.rint(1000.0 * shown).astype(np.uint16)
        view = scene.see(replace(frame, number=number, depth=units))
        scene.learn(view, cut_out(view, room.surface(PERSON)))
    np.testing.assert_array_equal(known(scene)[leg], empty[leg])
    assert np.mean(known(scene) > 0.0) > 0.8


def test_a_camera_that_was_moved_forgets() -> None:
    """When most of the picture is another, the background is that of the new picture at once."""
    scene = Scene()
    watch(scene, Room((CABINET,)), 5)
    turned = Room((CABINET,), pitch=0.5)
    watch(scene, turned, 1)
    truth = turned.see(PERSON)
    background = scene.see(turned.see(None).frame).background
    learned = background > 0.0
    assert learned[~truth.mask].mean() > 0.9
    np.testing.assert_allclose(background[learned], turned.see(None).frame.metres()[learned], atol=0.03)


def test_a_given_background_that_is_void_stays_so() -> None:
    """A scene that recalls, over the same background, that it does not fit knows nothing of it either."""
    given = Room((CABINET,), pitch=0.5).see(None).frame.metres()
    frame = Room((CABINET,)).see(None).frame
    dark = np.where(np.arange(frame.depth.shape[1]) < 20, 0, frame.depth).astype(np.uint16)
    watching, recorded, resumed = Scene(given), Scene(), Scene(given)
    recorded.recall(watching.learn(watching.see(replace(frame, depth=dark)), None))
    resumed.recall(recorded.all())
    assert not known(watching)[:, :20].any()
    np.testing.assert_array_equal(known(resumed), known(watching))


def test_who_comes_through_a_door_is_seen() -> None:
    """Somebody deeper than the background was is the subject, for as long as he stands there."""
    door = ((-0.9, -0.9, 2.2), (0.1, 1.1, 2.25))
    scene, behind = Scene(), (PERSON[0], 2.9)
    watch(scene, Room((door,)), 3, (1.2, 2.4))
    for number in range(6):
        frame, truth = Room().see(behind, number)
        view = scene.see(frame)
        cut = cut_out(view, Room().surface(behind))
        scene.learn(view, cut)
    left, top, right, bottom = cut.window
    mine = np.zeros_like(truth)
    mine[top:bottom, left:right] = cut.kinds == SUBJECT
    assert np.sum(mine & truth) / truth.sum() > 0.95
    assert np.sum(mine & truth) / mine.sum() > 0.95
