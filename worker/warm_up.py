"""Compile or load every kernel before the first request, by refining something tiny."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from common.body import ROOT_DOFS, ROTATION, TRANSLATION, BodyModel
from common.camera import Intrinsics
from common.frame import DepthFrame, SubjectFrame
from common.protocol.frames import decode_frame, encode_frame
from common.protocol.models import decode_model, encode_model
from common.settings import RefineSettings
from worker.service import Kernel

O = TypeVar("O")  # noqa: E741 - what `observe` makes of a frame


def warm_up(kernel: Kernel[O]) -> None:
    """Send a tiny model and frame through the whole of a worker, as they would come off the wire."""
    model = decode_model(encode_model(tiny_model()))
    observation = kernel.observe(decode_frame(encode_frame(tiny_frame())))
    poses = np.zeros((1, len(ROOT_DOFS)))
    poses[:, 2] = 2.0
    kernel.refine(model, observation, poses, RefineSettings())


def tiny_model() -> BodyModel:
    """A pyramid of 20 cm that can move and turn freely."""
    vertices = np.array([[-0.1, 0.1, 0.0], [0.1, 0.1, 0.0], [0.0, -0.1, 0.0], [0.0, 0.0, -0.1]])
    return BodyModel(
        name="pyramid",
        dof_names=ROOT_DOFS,
        kinds=np.repeat(np.array([TRANSLATION, ROTATION], dtype=np.int64), 3),
        parents=np.arange(-1, 5, dtype=np.int64),
        axes=np.tile(np.eye(3), (2, 1)),
        points=np.zeros((6, 3)),
        limits=np.tile([-np.inf, np.inf], (6, 1)),
        rest_spreads=np.ones(6),
        balls=np.array([3], dtype=np.int64),
        link_names=("all",),
        link_dofs=np.array([5], dtype=np.int64),
        vertices=vertices,
        triangles=np.array([[0, 3, 1], [1, 3, 2], [2, 3, 0], [0, 1, 2]], dtype=np.int64),
        skin_links=np.zeros((4, 1), dtype=np.int64),
        skin_weights=np.ones((4, 1)),
        joint_names=("all",),
        joint_links=np.zeros(1, dtype=np.int64),
        joint_points=np.zeros((1, 3)),
    )


def tiny_frame() -> SubjectFrame:
    """A flat patch of 20 cm at a distance of 2 m."""
    depth = np.zeros((32, 32), dtype=np.uint16)
    depth[8:24, 8:24] = 2000
    camera = Intrinsics(32, 32, 160.0, 160.0, 15.5, 15.5)
    picked = np.flatnonzero(depth).astype(np.uint32)
    return SubjectFrame(DepthFrame(0, 0.0, depth, 1000.0, camera), picked, (0, 0, 32, 32))
