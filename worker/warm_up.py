"""Compile or load every kernel before the first request, by refining a tiny model."""

from __future__ import annotations

import numpy as np

from gepf.common.body import ROOT_DOFS, ROTATION, TRANSLATION, BodyModel
from gepf.common.camera import Intrinsics
from gepf.common.frame import SubjectFrame, SubjectView, View
from gepf.common.kernel import Kernel
from gepf.common.protocol.frames import decode_frame, encode_frame
from gepf.common.protocol.models import decode_model, encode_model
from gepf.common.refinement import Particles
from gepf.common.settings import RefineSettings


def warm_up(kernel: Kernel) -> None:
    """Process messages with a tiny model and frame in the worker, as if they were received."""
    model = decode_model(encode_model(tiny_model()))
    settings = RefineSettings()
    observation = kernel.observe(decode_frame(encode_frame(tiny_frame())), settings)
    poses = np.zeros((1, len(ROOT_DOFS)))
    poses[:, 2] = 2.0
    kernel.refine(model, observation, Particles(poses, settings))


def tiny_model() -> BodyModel:
    """A tetrahedron of 20 cm with free motion, one corner towards the camera."""
    faces = [[0, 3, 1], [1, 3, 2], [2, 3, 0], [0, 1, 2]]
    return BodyModel(
        name="tetrahedron",
        dof_names=ROOT_DOFS,
        kinds=np.repeat([TRANSLATION, ROTATION], 3),
        parents=np.arange(-1, len(ROOT_DOFS) - 1),
        axes=np.tile(np.eye(3), (2, 1)),
        points=np.zeros((len(ROOT_DOFS), 3)),
        limits=np.tile([-np.inf, np.inf], (len(ROOT_DOFS), 1)),
        rest_spreads=np.ones(len(ROOT_DOFS)),
        balls=np.array([3]),
        link_names=("all",),
        link_dofs=np.array([len(ROOT_DOFS) - 1]),
        vertices=np.array([[-1, 1, 0], [1, 1, 0], [0, -1, 0], [0, 0, -1]]) / 10,
        triangles=np.array(faces),
        skin_links=np.zeros((4, 1), dtype=np.int64),
        skin_weights=np.ones((4, 1)),
        joint_names=("all",),
        joint_links=np.zeros(1, dtype=np.int64),
        joint_points=np.zeros((1, 3)),
    )


def tiny_frame() -> SubjectFrame:
    """A flat patch of 20 cm at a distance of 2 m."""
    side = 32
    depth = np.zeros((side, side), dtype=np.uint16)
    depth[side // 4 : -side // 4, side // 4 : -side // 4] = 2 * 1000
    camera = Intrinsics(side, side, 5.0 * side, 5.0 * side, (side - 1) / 2, (side - 1) / 2)
    picked = np.flatnonzero(depth).astype(np.uint32)
    view = SubjectView(View(0, 0.0, depth, 1000.0, camera), picked, (0, 0, side, side))
    return SubjectFrame(0, 0.0, (view,))
