"""Depth that consists of points of a lattice is told from depth that noise left out."""

from __future__ import annotations

import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.common.camera import Intrinsics, back_project
from gepf.coordinator.sources.gaps import is_sparse
from gepf.coordinator.sources.point_clouds import render_points
from gepf.coordinator.synthesis.noise import as_a_kinect
from tests.support.rooms import along

CAMERA = Intrinsics(320, 240, 240.0, 240.0, 159.5, 119.5)


def room() -> Array:
    """Depth (H, W) of a floor and a wall, metres."""
    rays = back_project(np.ones((CAMERA.height, CAMERA.width)), CAMERA)
    with np.errstate(divide="ignore"):
        return np.minimum(along(1.2, rays[..., 1]), along(4.0, rays[..., 2]))


def counted(depth: Array) -> np.ndarray[tuple[int, ...], np.dtype[np.uint16]]:
    """Whole millimetres."""
    return np.rint(1000.0 * depth).astype(np.uint16)


@pytest.mark.parametrize("finer", [1.35, 1.6, 2.0, 2.4, 3.0])
@pytest.mark.parametrize("noisy", [False, True])
def test_depth_registered_to_a_finer_image_is_sparse(finer: float, *, noisy: bool) -> None:
    """With the noise of a depth camera and without, at any ratio of the sizes."""
    width, height, focal = round(finer * CAMERA.width), round(finer * CAMERA.height), finer * CAMERA.fx
    colour = Intrinsics(width, height, focal, focal, (width - 1.0) / 2.0, (height - 1.0) / 2.0)
    depth = as_a_kinect(room(), CAMERA, np.random.default_rng(1)) if noisy else room()
    points = back_project(depth, CAMERA)[depth > 0] - [0.025, 0.0, 0.0]
    assert is_sparse([counted(render_points(points, colour))])


@pytest.mark.parametrize("lost", [0.25, 0.4, 0.6])
def test_depth_that_noise_left_out_is_not_sparse(lost: float) -> None:
    """However many pixels fail, alone or with their neighbours, they are no points with gaps between them."""
    rng = np.random.default_rng(2)
    alone = rng.random(room().shape) < lost
    in_pairs = alone | np.roll(alone, 1, axis=1)
    for missing in (alone, in_pairs):
        assert not is_sparse([counted(np.where(missing, 0.0, room()))])


def test_a_far_floor_of_a_noisy_camera_is_not_sparse() -> None:
    """A rendered Kinect loses half of the pixels where depth changes fast from row to row."""
    rows = np.arange(CAMERA.height)[:, None] * np.ones(CAMERA.width)
    steep = 1.0 + 0.02 * rows
    noisy = counted(as_a_kinect(steep, CAMERA, np.random.default_rng(3)))
    assert np.mean(noisy == 0) > 0.3
    assert not is_sparse([noisy])
