"""Layout of the kernel's body, and visibility against OpenGL."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import maximum_filter, minimum_filter

from common.arrays import Array, Mask
from common.body import ROOT_DOFS
from common.camera import Intrinsics, project
from common.kinematics import pose_vertices
from coordinator.synthesis.rendering import DepthRenderer
from coordinator.synthesis.scenes import SCENES, Scene
from tests.support.bodies import person
from tests.support.kernel.kernel_cases import DEFAULT, layout, subject
from worker.kernel.observation import observe, pack_views
from worker.kernel.surface import pack_model
from worker.kernel.visibility import visible_vertices
from worker.kernel.workspace import make_workspaces

AROUND = 7  # pixels: what the surface does within 14 mm, about a pixel of the worker, counts as its edge
SEEN, HIDDEN = 0.003, 0.05  # metres behind the z-buffer

Marks = Mask


def test_a_body_is_packed_whole() -> None:
    """The kernel's order keeps every vertex with its skin and every triangle with its corners."""
    model = person()
    skeleton, surface = pack_model(model)
    order = layout(model)
    drawn, expected = (body.vertices[body.triangles].reshape(-1, 9) for body in (surface, model))
    np.testing.assert_array_equal(np.unique(drawn, axis=0), np.unique(expected, axis=0))
    assert len(drawn) == len(expected)
    np.testing.assert_array_equal(surface.vertices, model.vertices[order])
    used = surface.skin_links.shape[1]  # of four: no vertex has more
    np.testing.assert_array_equal(surface.skin_links, model.skin_links[order, :used])
    np.testing.assert_array_equal(surface.skin_weights, model.skin_weights[order, :used])
    assert np.all(model.skin_weights[:, used:] == 0.0)
    assert tuple(np.array(model.dof_names)[skeleton.precisions == 0.0]) == ROOT_DOFS


def judge(vertices: Array, scene: Scene) -> tuple[Marks, Marks, Marks]:
    """Vertices (V,) that the z-buffer shows, and those that are clearly to be seen or clearly hidden."""
    whole = scene.camera
    camera = Intrinsics(1024, 1024, whole.fx * 2.0, whole.fy * 2.0, 511.5, 511.5)
    with DepthRenderer(camera) as renderer:
        depth = renderer.depth(vertices, scene.model.triangles)
    behind = np.where(depth > 0.0, depth, np.float32(np.inf))
    columns, rows = np.clip(np.rint(project(vertices, camera)).astype(int), 0, 1023).T
    z = vertices[:, 2]
    nearest, farthest = (f(behind, size=AROUND)[rows, columns] for f in (minimum_filter, maximum_filter))
    return z <= behind[rows, columns] + 0.01, z <= nearest + SEEN, z > farthest + HIDDEN


@pytest.mark.parametrize(
    ("name", "frame"), [("arm", 0), ("arm", 60), ("arm", 105), ("turn", 50), ("turn", 140)]
)
def test_the_worker_sees_what_the_z_buffer_shows(name: str, frame: int) -> None:
    """No clearly hidden vertex is visible, all clearly visible ones are, and 19 of 20 vertices agree."""
    scene = SCENES[name]()
    vertices = pose_vertices(scene.model, scene.poses[frame : frame + 1])[0]
    seen = np.zeros(len(vertices), dtype=bool)
    skeleton, surface = pack_model(scene.model)
    views, order = pack_views(observe(subject()), DEFAULT), layout(scene.model)
    workspace = make_workspaces(skeleton, surface, views).shared
    workspace.posed[:] = vertices[order]
    seen[order[visible_vertices(surface, workspace)]] = True
    shown, free, hidden = judge(vertices, scene)
    assert free.mean() > 0.07
    assert hidden.mean() > 0.14
    assert np.mean(seen == shown) > 0.95
    assert np.mean(seen[free]) > 0.99
    assert not np.any(seen & hidden)
