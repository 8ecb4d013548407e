"""Data-driven proposals of limb poses that explain the observed points, on a puppet with a raised arm."""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array, Indices
from gepf.common.body import BodyModel
from gepf.common.kinematics import pose_vertices
from gepf.coordinator.filters import exploration
from gepf.coordinator.filters.exploration import explain
from gepf.coordinator.settings import ExplorationSettings
from tests.support.bodies import hinges, puppet

MODEL = puppet()
DOWN = np.zeros(len(MODEL.dof_names))
RAISED = DOWN.copy()
RAISED[MODEL.dof("l_arm_1")] = 1.2


def propose_limbs(
    model: BodyModel, pose: Array, points: Array, count: int, seed: int = 0
) -> list[tuple[Indices, Array]]:
    """Proposals for the points that the pose leaves unexplained."""
    near = explain(model, pose, points, ExplorationSettings())
    return exploration.propose_limbs(
        model, pose, points, near, count, np.random.default_rng(seed), ExplorationSettings()
    )


def seen(pose: Array) -> Array:
    """Points all over the puppet."""
    vertices: Array = pose_vertices(MODEL, pose[None])[0]
    return vertices


def explained(pose: Array, points: Array) -> float:
    """Share of points that are within 8 cm of the model."""
    apart = np.linalg.norm(points[:, None] - seen(pose)[None], axis=-1).min(axis=1)
    return float(np.mean(apart <= 0.08))


def test_an_arm_that_is_elsewhere_is_held_so_that_it_explains_what_is_seen() -> None:
    """For an arm predicted to hang: most proposals explain more points, within the joint limits."""
    points = seen(RAISED)
    proposed = propose_limbs(MODEL, DOWN, points, 8)
    assert len(proposed) == 8
    after = []
    for dofs, angles in proposed:
        held = DOWN.copy()
        held[dofs] = angles
        assert np.all((angles >= MODEL.limits[dofs, 0]) & (angles <= MODEL.limits[dofs, 1]))
        after.append(explained(held, points))
    assert np.mean(np.array(after) > explained(DOWN, points)) > 0.5


def test_where_all_is_explained_or_nothing_is_seen_nothing_is_proposed() -> None:
    """The true pose explains all points; without points or limbs there is nothing to propose."""
    assert propose_limbs(MODEL, RAISED, seen(RAISED), 8) == []
    assert propose_limbs(MODEL, RAISED, np.empty((0, 3)), 8) == []
    assert propose_limbs(hinges(), np.zeros(2), np.full((50, 3), 9.0), 8) == []
