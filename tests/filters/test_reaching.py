"""Limbs that reach for what nothing explains: on a puppet whose arm is elsewhere than believed."""

from __future__ import annotations

import numpy as np
import pytest

from common.kinematics import pose_vertices
from coordinator.filters.limbs.explaining import NEAR
from coordinator.filters.limbs.layout import layout_of, view_limbs
from coordinator.filters.limbs.reaching import find_reaches
from tests.support.bodies import hinges, puppet

MODEL = puppet()


def raised(name: str = "l_arm_1", angle: float = 1.2) -> np.ndarray:
    """The puppet's pose with one arm raised."""
    pose = np.zeros(len(MODEL.dof_names))
    pose[MODEL.dof(name)] = angle
    return pose


def seen(pose: np.ndarray) -> np.ndarray:
    """Points all over the puppet."""
    vertices: np.ndarray = pose_vertices(MODEL, pose[None])[0]
    return vertices


def explained(pose: np.ndarray, points: np.ndarray) -> float:
    """Share of points that are near the model."""
    apart = np.linalg.norm(points[:, None] - seen(pose)[None], axis=-1).min(axis=1)
    return float(np.mean(apart <= NEAR))


def test_a_lost_arm_reaches_for_what_is_seen_of_it() -> None:
    """The believed pose has the arm down; most of the ways that are found explain more than it does."""
    believed, points = np.zeros(len(MODEL.dof_names)), seen(raised())
    reaches = find_reaches(view_limbs(MODEL, believed, points), believed, 8, np.random.default_rng(0))
    assert reaches is not None
    assert len(reaches.dofs) == len(reaches.angles) == 8
    before, after = explained(believed, points), []
    for dofs, angles in zip(reaches.dofs, reaches.angles, strict=True):
        held = believed.copy()
        held[dofs] = angles
        assert np.all(angles >= MODEL.limits[dofs, 0])
        assert np.all(angles <= MODEL.limits[dofs, 1])
        after.append(explained(held, points))
    assert np.mean(np.array(after) > before) > 0.5


def test_where_all_is_explained_nothing_reaches() -> None:
    """The true pose leaves no point over, so there is nothing to reach for."""
    pose = raised()
    assert find_reaches(view_limbs(MODEL, pose, seen(pose)), pose, 8, np.random.default_rng(0)) is None


def test_nothing_seen_nothing_reached() -> None:
    """Without points, or without a limb that hangs on something, no way is tried."""
    nothing = np.empty((0, 3))
    assert find_reaches(view_limbs(MODEL, raised(), nothing), raised(), 8, np.random.default_rng(0)) is None
    assert not layout_of(hinges()).limbs


def test_the_same_seed_reaches_the_same() -> None:
    """All chance is the generator's."""
    believed, points = np.zeros(len(MODEL.dof_names)), seen(raised())
    one, other = (
        find_reaches(view_limbs(MODEL, believed, points), believed, 5, np.random.default_rng(3))
        for _ in range(2)
    )
    assert one is not None
    assert other is not None
    for first, second in zip(one.angles, other.angles, strict=True):
        np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("limb", range(len(layout_of(MODEL).limbs)))
def test_only_tips_are_limbs(limb: int) -> None:
    """Nothing hangs on a limb's degrees of freedom but its own; the trunk is none."""
    dofs = layout_of(MODEL).limbs[limb].dofs
    carried = [j for j, parent in enumerate(MODEL.parents) if parent in dofs]
    assert set(carried) <= set(dofs.tolist())
    assert MODEL.parents[dofs[0]] >= 0
