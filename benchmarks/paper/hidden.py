"""Which joints the camera sees, from the renderer.

A joint lies inside its limb. It counts as seen if at least half of what its limb shows around it, were the
limb alone in the picture, is still seen when the whole body is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.camera import back_project
from common.kinematics import joint_positions, pose_vertices
from coordinator.synthesis.rendering import DepthRenderer
from coordinator.synthesis.scenes import Scene

AROUND = 0.08  # metres across the line of sight
SAME = 0.005  # metres: what is nearer than the limb by more hides it
LIMBS = {
    "elbow": ("upper_arm", "forearm"),
    "wrist": ("forearm", "hand"),
    "knee": ("thigh", "shank"),
    "ankle": ("shank", "foot"),
}
"""Links that meet in a joint; the joints of the trunk are always taken as seen."""


def visible_joints(scene: Scene) -> NDArray[np.bool_]:
    """For every frame and joint (F, J) whether it is seen."""
    model = scene.model
    seen = np.ones((len(scene.poses), len(model.joint_names)), dtype=bool)
    vertices = pose_vertices(model, scene.poses)
    joints = joint_positions(model, scene.poses)
    with DepthRenderer(scene.camera) as renderer:
        for frame in range(len(scene.poses)):
            whole = renderer.depth(vertices[frame], model.triangles)
            for j, name in enumerate(model.joint_names):
                side, _, kind = name.partition("_")
                if kind in LIMBS:
                    limb = limb_triangles(scene, side, kind)
                    alone = renderer.depth(vertices[frame], limb)
                    seen[frame, j] = mostly_seen(alone, whole, joints[frame, j], scene)
    return seen


def limb_triangles(scene: Scene, side: str, kind: str) -> NDArray[np.int64]:
    """Triangles (T, 3) of the links that meet in a joint."""
    prefixes = tuple(f"{side[0]}_{link}" for link in LIMBS[kind])
    links = [k for k, name in enumerate(scene.model.link_names) if name.startswith(prefixes)]
    triangles = scene.model.triangles
    return triangles[np.isin(scene.model.skin_links[triangles[:, 0], 0], links)]


def mostly_seen(
    alone: NDArray[np.float32], whole: NDArray[np.float32], joint: NDArray[np.float64], scene: Scene
) -> bool:
    """Whether half of the limb's pixels around a joint (3,) are in front in the whole picture."""
    points = back_project(alone, scene.camera)
    near = (alone > 0.0) & (np.hypot(points[..., 0] - joint[0], points[..., 1] - joint[1]) < AROUND)
    front = whole[near] > alone[near] - SAME
    return bool(np.mean(front) >= 0.5) if len(front) else False
