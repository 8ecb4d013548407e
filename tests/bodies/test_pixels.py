"""The forest that tells pixels of a body from those of things."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.body_pixels.scenes import draw_images
from gepf.common.camera import Intrinsics
from gepf.coordinator.bodies.human.people import people_pixels
from gepf.coordinator.bodies.pixels import PixelForest, describe

CAMERA = Intrinsics(60, 48, 70.0, 70.0, 29.5, 23.5)
DOWN = np.array([0.0, 1.0])


def random_tree(rng: np.random.Generator, features: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A tree of 31 nodes, in which some inner nodes of a full one are leaves."""
    open_nodes, chosen = 1, list[int]()
    while open_nodes:
        inner = len(chosen) < 15 and (len(chosen) < 3 or rng.random() < 0.7)
        chosen.append(int(rng.integers(features)) if inner else -1)
        open_nodes += 1 if inner else -1
    return np.array(chosen), rng.normal(0.0, 0.1, len(chosen)), rng.random(len(chosen))


@pytest.fixture
def forest() -> PixelForest:
    """Four random trees."""
    rng = np.random.default_rng(3)
    offsets = rng.normal(0.0, 0.3, (20, 2, 2)).astype(np.float32)
    return PixelForest.of(offsets, 0.5, [random_tree(rng, 20) for _ in range(4)])


@pytest.fixture
def depth() -> np.ndarray:
    """Random depth with gaps."""
    rng = np.random.default_rng(4)
    depth = rng.uniform(1.0, 2.0, (CAMERA.height, CAMERA.width)).astype(np.float32)
    return np.where(rng.random(depth.shape) < 0.1, np.float32(0.0), depth)


def test_kernel_agrees_with_plain_trees(forest: PixelForest, depth: np.ndarray) -> None:
    """Features and shares, one pixel and node at a time."""
    pixels = np.flatnonzero(depth)
    rows, columns = np.divmod(pixels, CAMERA.width)
    values = np.empty((len(pixels), len(forest.offsets)), dtype=np.float32)
    for feature, pair in enumerate(forest.offsets * np.float32(CAMERA.fx)):
        behind = []
        for right, down in pair:
            z = depth.ravel()[pixels]
            r, c = rows + np.rint(down / z).astype(int), columns + np.rint(right / z).astype(int)
            inside = (r >= 0) & (r < CAMERA.height) & (c >= 0) & (c < CAMERA.width)
            there = np.where(inside, depth[np.where(inside, r, 0), np.where(inside, c, 0)], 0.0)
            behind.append(np.where(there > 0.0, np.clip(there - z, -0.5, 0.5), 0.5))
        values[:, feature] = behind[0] - behind[1]
    described = describe(depth, pixels, forest.offsets * np.float32(CAMERA.fx), forest.limit_m)
    np.testing.assert_allclose(described, values, atol=1e-6)
    shares = forest.shares_at(depth, CAMERA, pixels, DOWN)
    np.testing.assert_allclose(shares, forest.shares_by(described), atol=1e-6)
    assert len(np.unique(shares)) > 10


def test_file_keeps_the_forest(forest: PixelForest, depth: np.ndarray, tmp_path: Path) -> None:
    """To the last bit."""
    forest.save(tmp_path / "forest.npz")
    read, pixels = PixelForest.load(tmp_path / "forest.npz"), np.flatnonzero(depth)
    np.testing.assert_array_equal(
        read.shares_at(depth, CAMERA, pixels, DOWN), forest.shares_at(depth, CAMERA, pixels, DOWN)
    )


def test_turned_camera_sees_the_same(forest: PixelForest, depth: np.ndarray) -> None:
    """An image that is turned by 90 degrees; half pixels are rounded either way."""
    upright, pixels = forest.shares_at(depth, CAMERA, np.flatnonzero(depth), DOWN), np.flatnonzero(depth)
    shares = np.zeros(depth.size, np.float32)
    shares[pixels] = upright
    turned = np.ascontiguousarray(np.rot90(depth))  # down is now to the right
    camera = Intrinsics(CAMERA.height, CAMERA.width, 70.0, 70.0, 23.5, 29.5)
    found = np.zeros(depth.size, np.float32)
    found[np.flatnonzero(turned)] = forest.shares_at(
        turned, camera, np.flatnonzero(turned), np.array([1.0, 0.0])
    )
    expected = np.rot90(shares.reshape(depth.shape))
    assert np.mean(np.abs(found.reshape(turned.shape) - expected) < 1e-6) > 0.98


def test_nothing_measured_is_no_body(forest: PixelForest) -> None:
    """An image without depth."""
    empty = np.zeros((CAMERA.height, CAMERA.width), np.float32)
    assert not forest.find_body(empty, CAMERA, np.ones(empty.shape, np.bool_), DOWN).any()


def test_people_are_told_from_furniture() -> None:
    """Scenes that the forest was not trained on."""
    people, things, missed, taken = 0, 0, 0, 0
    for seed in range(12):
        for image in draw_images(np.random.default_rng([1, seed])):
            depth, touching = image.depth.astype(np.float32), image.people | image.furniture
            body = people_pixels().find_body(depth, image.camera, touching, DOWN)
            people, missed = people + image.people.sum(), missed + (image.people & ~body).sum()
            things, taken = things + image.furniture.sum(), taken + (image.furniture & body).sum()
    assert missed < 0.12 * people
    assert taken < 0.35 * things
