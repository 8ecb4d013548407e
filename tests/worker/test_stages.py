"""Visibility in the kernel against OpenGL."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import maximum_filter, minimum_filter

from gepf.common.arrays import Array, Mask
from gepf.common.camera import Intrinsics, project
from gepf.common.kinematics import pose_vertices
from gepf.coordinator.synthesis.rendering import DepthRenderer
from gepf.coordinator.synthesis.scenes import SCENES, Scene
from gepf.worker.kernel.observation import observe, pack_views
from gepf.worker.kernel.surface import order_vertices, pack_model
from gepf.worker.kernel.visibility import visible_vertices
from gepf.worker.kernel.workspace import make_workspaces
from tests.support.kernel.kernel_cases import DEFAULT, subject

AROUND = 7  # pixels: what the surface does within 14 mm, about a pixel of the worker, counts as its edge
SEEN, HIDDEN = 0.003, 0.05  # metres behind the z-buffer

Marks = Mask


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
    views, order = pack_views(observe(subject()), DEFAULT), order_vertices(scene.model)[0]
    workspace = make_workspaces(skeleton, surface, views).shared
    workspace.posed[:] = vertices[order]
    seen[order[visible_vertices(surface, workspace)]] = True
    shown, free, hidden = judge(vertices, scene)
    assert free.mean() > 0.07
    assert hidden.mean() > 0.14
    assert np.mean(seen == shown) > 0.95
    assert np.mean(seen[free]) > 0.99
    assert not np.any(seen & hidden)
