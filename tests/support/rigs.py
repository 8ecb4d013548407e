"""A person before several cameras, rendered."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.frame import DepthFrame
from common.kinematics import pose_vertices
from common.kinematics.rotations import euler_matrix
from coordinator.bodies.tracked import name_pose
from coordinator.synthesis.rendering import DepthRenderer
from tests.support.people import CAMERA, frame_of
from tests.support.recordings import write_open3d

Array = NDArray[np.float64]

MIDDLE = np.array([0.1, 0.1, 2.7])  # where the person is


def around(yaw_deg: float) -> Array:
    """T_rig_camera (4, 4) of a camera that looks at the person, turned about them from the rig's own."""
    placed = np.eye(4)
    placed[:3, :3] = euler_matrix(np.array([0.0, -np.radians(yaw_deg), 0.0]))
    placed[:3, 3] = MIDDLE - placed[:3, :3] @ MIDDLE
    return placed


def seen_from(model: BodyModel, poses: Sequence[Array], places: Mapping[str, Array]) -> DepthFrame:
    """A frame of cameras at places by name, each with the body in its own pose (D,)."""
    views = []
    with DepthRenderer(CAMERA) as renderer:
        for pose, (name, placed) in zip(poses, places.items(), strict=True):
            back = np.linalg.inv(placed)
            vertices = pose_vertices(model, pose[None])[0] @ back[:3, :3].T + back[:3, 3]
            depth = renderer.depth(vertices, model.triangles).astype(np.float64)
            views.append(replace(frame_of(0, depth), camera=name, T_rig_camera=placed))
    return replace(views[0], others=tuple(views[1:]))


def write_rig(
    folder: Path,
    model: BodyModel,
    posture: Mapping[str, float],
    rates: Mapping[str, float],
    places: Mapping[str, Array],
    delays_s: Mapping[str, float],
    frames: int,
) -> Path:
    """A rig's recordings of a body whose joints move at rates per second, each camera with its own delay."""
    cameras = {}
    for name, placed in places.items():
        images = []
        for n in range(frames):
            time_s = n / 30.0 + delays_s.get(name, 0.0)
            moved = {**posture, **{dof: posture.get(dof, 0.0) + rate * time_s for dof, rate in rates.items()}}
            images.append(seen_from(model, [name_pose(model, moved)], {name: placed}).depth)
        write_open3d(folder / name, np.array(images), CAMERA)
        cameras[name] = {
            "sequence": name,
            "T_rig_camera": placed.tolist(),
            "time_offset_s": delays_s.get(name, 0.0),
        }
    path = folder / "rig.json"
    path.write_text(json.dumps({"cameras": cameras}))
    return path
