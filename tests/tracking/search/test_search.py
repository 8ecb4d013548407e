"""The search for a body in a single frame: its library, its signatures, and what it finds."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from common.body import BodyModel
from common.camera import Intrinsics
from common.frame import DepthFrame
from common.kinematics import joint_positions, pose_vertices
from common.settings import preset
from coordinator.bodies.human.shape_space import person_of_size
from coordinator.bodies.human.template import DEFAULT_ACTIVE, human
from coordinator.bodies.tracked import Bodies, OneBody, name_pose
from coordinator.bodies.urdf import read_urdf
from coordinator.synthesis.rendering import DepthRenderer
from coordinator.tracking.observing.subject import isolate
from coordinator.tracking.search.candidates import least, look_straight, most_alike
from coordinator.tracking.search.library import Library, any_turns, draw_any, draw_people, look_at
from coordinator.tracking.search.search import QUICK, THOROUGH, Effort, Found, Search
from coordinator.tracking.search.signature import BOUND, CELL, COLUMNS, EMPTY, ROWS, compare, sign
from coordinator.tracking.search.sizes import Size, taller_and_shorter, vary
from coordinator.tracking.search.stages import Standing, thin
from coordinator.tracking.single import SingleTracker as Tracker
from gepf.direct import DirectRefiner
from tests.support.people import SETTINGS, shown
from tests.support.stand_ins import Listening

Array = NDArray[np.float64]

CAMERA = Intrinsics(320, 240, 290.0, 290.0, 159.5, 119.5)
BRACKET = Path(__file__).parents[3] / "examples" / "bracket.urdf"
NOISELESS = preset("default").refine
KNEELING = {
    "root_tz": 2.6, "root_ty": 0.2, "root_ry": 2.6, "r_shoulder_flexion": 2.7, "l_shoulder_abduct": 1.3,
    "l_knee_flexion": 1.6, "r_knee_flexion": 1.6,
}  # fmt: skip


@cache
def person() -> BodyModel:
    """A person of the usual degrees of freedom."""
    return people().for_start(1.75, 1.05)


@cache
def people() -> Bodies:
    """People of any size."""
    return Bodies(human, DEFAULT_ACTIVE, DEFAULT_ACTIVE)


def frame_of(model: BodyModel, pose: Array) -> DepthFrame:
    """A frame that shows a body in a pose, in millimetres."""
    with DepthRenderer(CAMERA) as renderer:
        depth = renderer.depth(pose_vertices(model, pose[None])[0], model.triangles)
    return DepthFrame(0, 0.0, np.rint(depth * 1000.0).astype(np.uint16), 1000.0, CAMERA)


def signature(points: Array) -> tuple[NDArray[np.float32], Array, int]:
    """The image, the middle and the number of cells of points."""
    image, middle = np.empty((ROWS, COLUMNS), dtype=np.float32), np.empty(3)
    return image, middle, sign(points, CELL, image, middle)


def test_a_signature_is_the_same_wherever_the_body_is() -> None:
    """Moved by whole cells and any depth, a cloud has the same image; its middle moves along."""
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (400, 3))
    image, middle, cells = signature(points)
    moved, other, count = signature(points + np.array([3 * CELL, -2 * CELL, 2.5]))
    assert cells == count == np.count_nonzero(image < EMPTY)
    np.testing.assert_allclose(other - middle, [3 * CELL, -2 * CELL, 2.5], atol=1e-9)
    same = np.isclose(image, moved, atol=1e-5)
    assert same.mean() > 0.99  # a point on a cell's edge may change sides by rounding


def test_signatures_are_compared_as_the_definition_says() -> None:
    """The sum over cells of min(|dz|, bound)^2; a cell that only one of two fills counts the bound."""
    rng, bound = np.random.default_rng(1), BOUND * CELL
    images = rng.normal(0.0, 0.2, (5, ROWS, COLUMNS)).astype(np.float32)
    images[rng.random(images.shape) < 0.7] = EMPTY
    seen, out = images[0], np.empty(4)
    others = images[1:]
    cells = np.ascontiguousarray(others.reshape(4, -1).T)
    compare(cells, (others < EMPTY).sum(axis=(1, 2)).astype(np.float64), seen, bound, out)
    apart = np.minimum(np.abs(others.astype(np.float64) - seen), bound) ** 2
    np.testing.assert_allclose(out, apart.sum(axis=(1, 2)), rtol=1e-9)


def test_the_library_is_the_same_every_time_and_keeps_to_the_joints() -> None:
    """People are drawn within their limits, seen from all sides, from a generator of its own."""
    poses = draw_people(person(), 500, np.random.default_rng(3))
    np.testing.assert_array_equal(poses, draw_people(person(), 500, np.random.default_rng(3)))
    low, high = person().limits.T
    assert np.all((poses >= low) & (poses <= high))
    assert np.histogram(poses[:, 4], bins=4, range=(-np.pi, np.pi))[0].min() > 60


def test_rotations_are_spread_over_all_there_are() -> None:
    """Their mean is no rotation at all, and none is a reflection."""
    angles = any_turns(2_000, np.random.default_rng(0))
    assert np.abs(np.mean([np.cos(a[1]) * np.cos(a[2]) for a in angles])) < 0.05


@pytest.mark.parametrize("roll", [0.0, 0.5 * np.pi])
def test_a_pose_of_the_library_is_the_one_most_like_itself(roll: float) -> None:
    """Seen at any place, turned by the roll that is asked for, it comes first, at its place and its size."""
    model = person()
    library = look_at(model, draw_people(model, 200, np.random.default_rng(5)), CELL)
    for n in (0, 17, 101):
        visible = visible_points(model, library, n)
        turn = look_straight(np.array([0.3, -0.2, 3.0]), roll)
        found = most_alike(visible @ turn + [0.3, -0.2, 3.0], library, [0.9, 1.0], roll, 3)
        joints = joint_positions(model, found.poses[:1])[0]
        np.testing.assert_allclose(joints, library.joints[n] @ turn + [0.3, -0.2, 3.0], atol=0.08)
        assert found.sizes[0] == 1


def visible_points(model: BodyModel, library: Library, n: int) -> Array:
    """The vertices of a pose of a library that lie in front."""
    points = pose_vertices(model, library.poses[n : n + 1])[0]
    keys = np.floor(points[:, :2] / 0.03).astype(int)
    nearest = {tuple(key): np.inf for key in keys.tolist()}
    for key, z in zip(map(tuple, keys.tolist()), points[:, 2], strict=True):
        nearest[key] = min(nearest[key], z)
    front = [z < nearest[tuple(key)] + 0.03 for key, z in zip(keys.tolist(), points[:, 2], strict=True)]
    return np.asarray(points[front])


@pytest.mark.parametrize("values", [[3.0, 1.0, np.nan, 1.0, 2.0], [np.nan, np.nan, 5.0, np.nan, np.nan]])
def test_the_least_come_in_their_order_and_what_is_no_number_last(values: list[float]) -> None:
    """So many as are asked for, as a stable sort of all gives them."""
    for count in range(1, 7):
        expected = np.argsort(values, kind="stable")[:count]
        np.testing.assert_array_equal(least(np.array(values), count), expected)


def test_only_candidates_that_differ_go_on() -> None:
    """The likeliest first; whoever is nearer than the distance to a likelier one is left out."""
    joints = np.array([0.0, 0.01, 0.2, 0.21, 0.5])[:, None, None] * np.ones((5, 2, 3))
    order = np.arange(5.0)
    standing = Standing(order[:, None], np.zeros(5, dtype=np.int64), -order, np.ones(5), joints)
    assert standing.take(standing.differing(9, 0.05)).poses.ravel().tolist() == [0.0, 2.0, 4.0]
    assert standing.take(standing.differing(2, 0.05)).poses.ravel().tolist() == [0.0, 2.0]


def test_points_are_thinned_evenly() -> None:
    """As many as asked for, of all parts of the picture; never more than there are."""
    subject = isolate(frame_of(person(), name_pose(person(), {"root_tz": 2.5})), None, 2_000)
    assert subject is not None
    few = thin(subject, 300)
    assert len(few.picked) == 300
    assert np.isin(few.picked, subject.picked).all()
    assert len(thin(subject, 10**6).picked) == len(subject.picked)


def test_sizes_that_several_candidates_try_are_built_once() -> None:
    """Each candidate gets its sizes, and equal ones share a body."""
    tried = [taller_and_shorter(Size(1.7, 1.05)), taller_and_shorter(Size(1.7, 1.05))]
    sizes, place, candidate = vary(tried)
    assert len(sizes) == 5
    assert place.tolist() == [0, 1, 2, 3, 4] * 2
    assert candidate.tolist() == [0] * 5 + [1] * 5


def find(bodies: Bodies, model: BodyModel, pose: Array, effort: Effort, size: Size | None = None) -> Found:
    """What the search finds in a frame that shows a pose. It never asks how sure a pose is."""
    subject = isolate(frame_of(model, pose), None, 2_000)
    assert subject is not None
    refiner = Listening()
    found = Search(bodies, refiner).find(subject, NOISELESS, effort, size)
    assert refiner.asked == {False}
    return found


@pytest.mark.parametrize(("effort", "size"), [(THOROUGH, None), (QUICK, Size(1.75, 1.05))])
def test_a_person_is_found_in_an_unusual_pose(effort: Effort, size: Size | None) -> None:
    """Kneeling with the back to the camera, an arm overhead and one to the side, of unknown or known size."""
    pose = name_pose(person(), KNEELING)
    found = find(people(), person(), pose, effort, size)
    off = joint_positions(found.model, found.poses[:1])[0] - joint_positions(person(), pose[None])[0]
    assert np.median(np.linalg.norm(off, axis=-1)) < 0.05
    assert found.size.stature == pytest.approx(1.75, rel=0.1)
    assert np.all(np.diff(found.log_likelihood) <= 0.0)


def test_a_person_is_found_upside_down() -> None:
    """Whichever way up the camera is held, the body is where it is."""
    pose = name_pose(person(), {"root_tz": 2.6, "root_rz": np.pi, "r_shoulder_abduct": 1.0})
    found = find(people(), person(), pose, THOROUGH)
    off = joint_positions(found.model, found.poses[:1])[0] - joint_positions(person(), pose[None])[0]
    assert np.linalg.norm(off, axis=-1).mean() < 0.02


def test_any_other_body_is_found_however_it_is_turned() -> None:
    """A bracket of a URDF file: its whole surface lies where it is shown."""
    model = read_urdf(BRACKET)
    body = OneBody(model, model.dof_names, model.dof_names)
    poses = draw_any(model, 3, np.random.default_rng(4))
    poses[:, 2] = 0.8
    for pose in poses:
        found = find(body, model, pose, THOROUGH)
        off = pose_vertices(found.model, found.poses[:1])[0] - pose_vertices(model, pose[None])[0]
        assert np.linalg.norm(off, axis=-1).max() < 0.01


def test_what_a_start_needs_is_made_before_the_first_frame() -> None:
    """No body is made while somebody waits for it: that takes longer than the search on two cores."""
    made = list[float]()

    def build(stature: float, girth: float) -> BodyModel:
        made.append(girth)
        return person_of_size(stature, girth)

    tracker = Tracker(DirectRefiner(), SETTINGS, Bodies(build, DEFAULT_ACTIVE, DEFAULT_ACTIVE))
    tracker.prepare()
    before = len(made)
    assert before > 1
    assert tracker.track(shown("standing").frames[0]).status in ("tracked", "ambiguous")
    assert len(made) == before
