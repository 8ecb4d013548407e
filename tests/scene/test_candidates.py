"""Candidates in a room: people are found whole, ranked before furniture, and chosen by the options."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from gepf.common.arrays import Mask
from gepf.common.camera import Intrinsics, back_project
from gepf.common.frame import UNKNOWN, View
from gepf.coordinator.scene.candidates import BodyPixels, Candidate, find_candidates, has_moved
from gepf.coordinator.scene.flatness import find_flat_part
from gepf.coordinator.scene.noise import noise_of
from gepf.coordinator.scene.scene import Scene, SceneView
from gepf.coordinator.scene.scope import Scope
from gepf.coordinator.scene.segmentation import measure_distances, segment_body
from gepf.coordinator.settings import SceneSettings
from tests.support import rooms
from tests.support.rooms import CABINET, HEIGHT, PERSON, TABLE, Room, of_ellipsoid


def found_in(room: Room, person: tuple[float, float] | None) -> list[Candidate]:
    """Candidates of a first frame."""
    return find_candidates(Scene(SceneSettings()).observe(room.see(person).view))


def overlap(mask: Mask, truth: Mask) -> tuple[float, float]:
    """Precision and recall."""
    both = np.sum(mask & truth)
    return float(both / mask.sum()), float(both / truth.sum())


@pytest.mark.parametrize("person", [PERSON, (0.35, 2.6)])
def test_a_person_is_found_and_not_the_cabinet(person: tuple[float, float]) -> None:
    """The only candidate beside a cabinet, or touching it, is the person, whole and hardly anything else."""
    room = Room((CABINET,), noise=0.002)
    (found,) = found_in(room, person)
    precision, recall = overlap(found.mask, room.see(person).mask)
    assert precision > 0.93
    assert recall > 0.95
    assert "m high" in found.description


def test_a_small_box_at_the_legs_is_cut_off() -> None:
    """Its front is smaller than a person's visible area, and it touches a leg."""
    room = Room((((-0.5, 0.8, 2.5), (-0.22, HEIGHT, 2.7)),), noise=0.001)
    (found,) = found_in(room, (-0.15, 2.6))
    assert min(overlap(found.mask, truth := room.see((-0.15, 2.6)).mask)) > 0.95
    assert np.sum(found.wider[-1] & ~truth) > 0.2 * np.sum(truth)  # it may also be a part of the person


def test_a_leg_that_is_separated_in_depth_is_in_a_wider_mask() -> None:
    """A body must tell whether it is the person's."""
    frame, truth = Room(noise=0.001).see(PERSON)
    rows, columns = np.nonzero(truth)
    leg = truth.copy()
    leg[: int(np.median(rows)) + 15] = leg[:, : int(np.median(columns))] = False
    depth = np.where(leg, frame.depth - 600, frame.depth).astype(np.uint16)
    (found,) = find_candidates(Scene(SceneSettings()).observe(replace(frame, depth=depth)))
    assert overlap(found.mask, leg)[1] < 0.1
    assert overlap(found.wider[0], truth)[1] > 0.95


@pytest.mark.parametrize(
    ("scale", "nearer"),
    [(0.7, 0.0), (0.7, 0.1), (1.0, 0.1)],
    ids=["a row was not measured", "small and one nearer", "legs nearer"],
)
def test_halves_that_are_separated_in_depth_are_one_candidate(scale: float, nearer: float) -> None:
    """Each may be too small for a person. They are separated by a row, or one is nearer (metres)."""
    frame, truth = Room(noise=0.001).see(PERSON)
    rows = np.arange(len(truth))[:, None]
    middle = int(np.median(np.nonzero(truth)[0]))
    depth = scale * frame.depth
    depth[truth & (rows > middle)] -= 1000.0 * nearer
    if not nearer:
        depth[truth & (rows == middle)] = 0.0
    (found,) = find_candidates(Scene(SceneSettings()).observe(replace(frame, depth=depth.astype(np.uint16))))
    assert overlap(found.mask, truth)[1] > 0.95


def test_a_child_before_an_adult_is_another_candidate(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is seen of the adult is above the child, as a trunk is above legs."""
    adult = Room(noise=0.001).see(PERSON).view
    monkeypatch.setattr(rooms, "PARTS", 0.72 * np.array(rooms.PARTS))
    child = Room(noise=0.001).see((PERSON[0], PERSON[1] - 0.3)).view
    both = replace(adult, depth=np.minimum(adult.depth, child.depth))
    assert len(find_candidates(Scene(SceneSettings()).observe(both))) == 2


def test_a_person_behind_a_table_comes_before_the_table() -> None:
    """The visible part of a person behind a table has a higher score than the table."""
    table = ((-0.7, 0.3, 1.7), (0.7, 0.42, 1.9))
    room = Room((table,), noise=0.001)
    best = found_in(room, PERSON)[0]
    truth = room.see(PERSON).mask
    assert truth[: len(truth) // 2].any()
    precision, recall = overlap(best.mask, truth)
    assert precision > 0.95
    assert recall > 0.6


def test_nobody_is_found_in_an_empty_room() -> None:
    """Floor, wall and cabinet are no person, and a table hardly one."""
    assert all(each.score < 0.3 for each in found_in(Room((CABINET, TABLE), noise=0.002), None))
    assert found_in(Room((CABINET,), noise=0.002), None) == []


def known_to_be(people: Mask, probability: float) -> BodyPixels:
    """The pixels of people probably show a body, all others do not."""

    def body_pixels(view: SceneView, mask: Mask) -> NDArray[np.float32]:
        assert (view.depth[mask] > 0.0).all()
        return np.where(mask & people, np.float32(probability), np.float32(0.1 * mask))

    return body_pixels


def children_on_a_bed(*places: float) -> tuple[View, list[Mask]]:
    """An image of children of 80 cm who lie side by side on a large bed, and the pixels (H, W) of each."""
    room = Room((((-1.1, 0.6, 1.6), (1.1, HEIGHT, 3.2)),), pitch=0.3, noise=0.001)
    image = room.see(None).view
    rays = back_project(np.ones(image.depth.shape), image.intrinsics) @ room.tilt.T
    parts = (0.0, 0.17, 0.08), (-0.24, 0.1, 0.1), (0.3, 0.18, 0.06)  # trunk, head, legs: place, half axes
    depths = [
        np.min(
            [of_ellipsoid(rays, np.array((x + off, 0.5, 2.3)), np.array((a, 0.1, b))) for off, a, b in parts],
            axis=0,
        )
        for x in places
    ]
    nearest = np.min([image.metres(), *depths], axis=0)
    shown = replace(image, depth=np.rint(1000.0 * nearest).astype(np.uint16))
    return shown, [depth < image.metres() for depth in depths]


@pytest.mark.parametrize("probability", [0.97, 0.7])
def test_where_flat_parts_leave_nobody_what_surely_is_a_body_is_a_candidate(probability: float) -> None:
    """A child on a bed is shorter than what is left of a person, and most of the component is flat."""
    shown, (truth,) = children_on_a_bed(0.0)
    view = Scene(SceneSettings()).observe(shown)
    assert find_candidates(view) == []
    found = find_candidates(view, body_pixels=known_to_be(truth, probability))
    assert len(found) == (probability > 0.9)
    for child in found:
        assert overlap(child.mask, truth) == pytest.approx((1.0, 1.0), abs=0.03)
        assert np.sum(child.widest & ~truth) > np.sum(truth)  # the bed may be a part of the child


def test_two_on_the_same_bed_are_two_candidates() -> None:
    """Half a metre lies between them."""
    shown, (left, right) = children_on_a_bed(-0.65, 0.65)
    view = Scene(SceneSettings()).observe(shown)
    found = find_candidates(view, body_pixels=known_to_be(left | right, 0.97))
    assert len(found) == 2
    for child in (left, right):
        assert max(min(overlap(one.mask, child)) for one in found) > 0.95


def test_a_line_of_pixels_has_no_flat_part() -> None:
    """No three of its points define a plane."""
    depth = np.zeros((20, 40))
    depth[10] = 6.0
    settings = SceneSettings()
    camera, noise = Intrinsics(40, 20, 65.0, 65.0, 19.5, 9.5), noise_of(0.002, settings.noise)
    flat = find_flat_part(depth, depth > 0.0, camera, noise, settings)
    assert flat.share == 0.0
    assert not flat.patch_areas.any()
    assert not flat.grow(flat.patch_areas > 0.0).any()


def test_one_of_two_is_chosen_as_asked() -> None:
    """The nearest, the one at a pixel, or the moving one, is first."""
    near, far = Room(noise=0.001).see((-0.5, 2.2)), Room(noise=0.001).see((0.7, 3.0))
    both = np.where(near.mask, near.view.depth, far.view.depth)
    frame = type(near.view)(0, 0.0, both, 1000.0, near.view.intrinsics)
    view = Scene(SceneSettings()).observe(frame)
    found = find_candidates(view)
    assert len(found) == 2
    row, column = np.argwhere(far.mask & ~near.mask).mean(axis=0).astype(int).tolist()
    assert Scope(person="nearest").choose(view, found)[0].mask[near.mask].mean() > 0.9
    assert Scope(person=(column, row)).choose(view, found)[0].mask[far.mask].mean() > 0.9
    assert Scope(person="moving").choose(view, found) == []
    scene = Scene(SceneSettings(), Room(noise=0.001).see(None).view.metres())
    view = scene.observe(near.view)
    assert len(Scope(person="moving").choose(view, find_candidates(view))) == 1


def test_limits_leave_nothing_else() -> None:
    """Outside near, far and region there is no depth; without limits the frame is unchanged."""
    frame = Room().see(PERSON).view
    kept = Scope(near=2.4, far=2.8, region=(10, 20, 90, 100)).limit(frame)[0]
    rows, columns = np.nonzero(kept.depth)
    assert kept.metres()[kept.depth > 0].min() >= 2.4
    assert kept.metres().max() <= 2.8
    assert (columns.min(), rows.min()) >= (10, 20)
    assert columns.max() < 90
    assert rows.max() < 100
    assert Scope().limit(frame)[0] is frame


def test_what_limits_leave_out_says_nothing_of_the_body() -> None:
    """It is neither empty nor unmeasured, so an arm that leaves the region is still possible."""
    room, scope = Room(), Scope(region=(0, 0, 66, 120))
    frame = room.see(PERSON).view
    frame, excluded = scope.limit(frame)
    view = Scene(SceneSettings()).observe(frame, excluded)
    surface = room.surface(PERSON, 2000)
    cut = segment_body(view, surface, measure_distances(view, surface))
    left, top, right, bottom = cut.window
    assert excluded is not None
    outside = excluded[top:bottom, left:right]
    assert outside.any()
    assert (cut.labels[outside] == UNKNOWN).all()


@pytest.mark.parametrize("moves", [False, True])
def test_who_moves_is_told_from_what_stands_still(moves: bool) -> None:
    """Of somebody who stands still, with noise at the outline, and of somebody who sways."""
    scene, moved = Scene(SceneSettings()), []
    for number in range(20):
        place = (PERSON[0] + 0.05 * np.sin(0.5 * number) * moves, PERSON[1])
        view = scene.observe(Room(noise=0.002).see(place, number).view)
        (person,) = find_candidates(view)
        scene.learn(view, person.widest)
        moved.append(has_moved(view, person))
    assert moved[-1] == moves
    assert not moved[0]


def test_somebody_lying_is_told_from_the_bed() -> None:
    """A candidate is as long as a person, and hardly has pixels of the bed, which is larger than a person."""
    bed = ((-1.1, 0.6, 1.6), (1.1, HEIGHT, 3.2))
    room = Room((bed,), pitch=0.3, noise=0.001)
    image = room.see(None).view
    rays = back_project(np.ones(image.depth.shape), image.intrinsics) @ room.tilt.T
    lying = [
        ((0.0, 0.5, 2.3), (0.42, 0.14, 0.2)),
        ((-0.6, 0.5, 2.3), (0.13, 0.1, 0.1)),
        ((0.75, 0.5, 2.2), (0.45, 0.09, 0.08)),
    ]
    depth = np.min([of_ellipsoid(rays, np.array(m), np.array(axes)) for m, axes in lying], axis=0)
    mask = depth < image.metres()
    shown = replace(image, depth=np.where(mask, np.rint(1000.0 * depth), image.depth).astype(np.uint16))
    best = find_candidates(Scene(SceneSettings()).observe(shown))[0]
    precision, recall = overlap(best.mask, mask)
    assert precision > 0.8
    assert recall > 0.8
