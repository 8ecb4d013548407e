"""The network that tells pixels of a body from those of things."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import correlate

from benchmarks.body_pixels.__main__ import large_components
from benchmarks.body_pixels.scenes import draw_images
from gepf.common.camera import Intrinsics
from gepf.coordinator.bodies.human.people import people_network
from gepf.coordinator.bodies.pixels import BodyNetwork, Layer, convolve, grid_around, halve, sample

CAMERA = Intrinsics(60, 48, 70.0, 70.0, 29.5, 23.5)
DOWN = np.array([0.0, 1.0])
CHANNELS = (3, 4, 4), (4, 6), (6, 5), (5, 5, 5), (10, 4), (10, 3), (7, 4)  # of each step down, below, and up


def draw_layers(rng: np.random.Generator) -> list[Layer]:
    """Layers with random weights, of few channels."""
    return [
        Layer(
            rng.normal(0.0, 0.3, (out, channels, 3, 3)).astype(np.float32),
            rng.normal(0.0, 0.1, out).astype(np.float32),
        )
        for step in CHANNELS
        for channels, out in pairwise(step)
    ]


@pytest.fixture
def network() -> BodyNetwork:
    """A network with random weights."""
    rng = np.random.default_rng(3)
    return BodyNetwork(tuple(draw_layers(rng)), (rng.normal(size=4).astype(np.float32), 0.1))


@pytest.fixture
def depth() -> np.ndarray:
    """Random smooth depth with gaps."""
    rng = np.random.default_rng(4)
    coarse = rng.uniform(1.0, 2.0, (CAMERA.height // 6, CAMERA.width // 6)).astype(np.float32)
    depth = coarse.repeat(6, axis=0).repeat(6, axis=1)
    return np.where(rng.random(depth.shape) < 0.1, np.float32(0.0), depth)


def plain_convolution(image: np.ndarray, layer: Layer) -> np.ndarray:
    """One pair of channels after the other, by scipy."""
    sums = [
        sum(
            correlate(channel, kernel, mode="constant")
            for channel, kernel in zip(image, kernels, strict=True)
        )
        for kernels in layer.weights
    ]
    return np.maximum(np.array(sums) + layer.bias[:, None, None], 0.0)


def plain_network(image: np.ndarray, network: BodyNetwork) -> np.ndarray:
    """The network, written down step by step."""
    a, b, c, d, e, f, g, h, i = network.layers
    one = plain_convolution(plain_convolution(image, a), b)
    two = plain_convolution(plain_halves(one), c)
    three = plain_convolution(plain_halves(two), d)
    below = plain_convolution(plain_convolution(plain_halves(three), e), f)
    up = below
    for kept, layer in ((three, g), (two, h), (one, i)):
        up = plain_convolution(np.concatenate([np.kron(up, np.ones((1, 2, 2))), kept]), layer)
    weights, bias = network.last
    return np.asarray(np.einsum("c,chw->hw", weights, up) + bias)


def plain_halves(image: np.ndarray) -> np.ndarray:
    """The largest of four neighbours."""
    corners = [image[:, row::2, column::2] for row in (0, 1) for column in (0, 1)]
    return np.asarray(np.max(corners, axis=0))


def test_network_agrees_with_plain_convolutions(network: BodyNetwork) -> None:
    """Every layer at once, on an image that is not square."""
    image = np.random.default_rng(5).normal(size=(3, 24, 40)).astype(np.float32)
    np.testing.assert_allclose(
        convolve(image, network.layers[0]), plain_convolution(image, network.layers[0]), atol=1e-5
    )
    np.testing.assert_array_equal(halve(image), plain_halves(image))
    odds = network.log_odds(image)
    np.testing.assert_allclose(odds, plain_network(image, network), atol=1e-4)
    assert np.ptp(odds) > 0.1


def test_file_gives_the_network(network: BodyNetwork, tmp_path: Path) -> None:
    """As `benchmarks/body_pixels/train.py` writes it: arrays of half precision in order."""
    arrays = [array for layer in network.layers for array in layer]
    arrays += [network.last[0].reshape(1, -1, 1, 1), np.array([network.last[1]])]
    with (tmp_path / "network.npz").open("wb") as file:
        np.savez(file, *(array.astype(np.float16) for array in arrays))
    read = BodyNetwork.load(tmp_path / "network.npz")
    found = [array for layer in read.layers for array in layer] + [read.last[0], np.array([read.last[1]])]
    for one, other in zip(arrays, found, strict=True):
        np.testing.assert_array_equal(other.ravel(), one.astype(np.float16).ravel())


def test_grid_is_upright_and_its_cells_are_found_again(depth: np.ndarray) -> None:
    """A camera that is turned by 30 degrees; each cell is the nearest to its own middle."""
    down = np.array([0.5, np.sqrt(0.75)])
    pixels = np.argwhere(depth > 0)
    grid = grid_around(pixels, 0.7, down)
    middles = np.stack([grid.rows.ravel(), grid.columns.ravel()], axis=1)
    np.testing.assert_array_equal(grid.cells_of(middles), np.indices(grid.rows.shape).reshape(2, -1))
    below = np.array([grid.columns[1, 0] - grid.columns[0, 0], grid.rows[1, 0] - grid.rows[0, 0]])
    np.testing.assert_allclose(below, 0.7 * down, atol=1e-9)
    rows, columns = grid.to_cells @ (pixels - grid.centre).T
    assert np.abs(rows).max() < 0.5 * grid.rows.shape[0]
    assert np.abs(columns).max() < 0.5 * grid.rows.shape[1]


def test_cells_show_depth_relative_to_the_middle(depth: np.ndarray) -> None:
    """Depth, whether it is known, and whether it is foreground, at the pixel of each cell."""
    foreground = np.random.default_rng(6).random(depth.shape) < 0.5
    grid = grid_around(np.argwhere(depth > 0), 1.0, DOWN)
    relative, known, inside = sample(depth, foreground, grid, 1.5)
    at = 20, 30
    row, column = grid.cells_of(np.array([at]))[:, 0]
    row_there, column_there = round(grid.rows[row, column]), round(grid.columns[row, column])
    z = depth[row_there, column_there]
    assert relative[row, column] == pytest.approx(z - 1.5 if z > 0 else 0.0, abs=1e-6)
    assert known[row, column] == (z > 0)
    assert inside[row, column] == foreground[row_there, column_there]
    assert not known[0].any()  # the margin is outside of the image
    assert np.abs(sample(depth, foreground, grid, 9.0)[0]).max() <= 1.5


def test_turned_camera_sees_the_same(network: BodyNetwork, depth: np.ndarray) -> None:
    """An image that is turned by 90 degrees; half pixels are rounded either way."""
    component = np.zeros(depth.shape, np.bool_)
    component[8:40, 12:50] = True
    grid = grid_around(np.argwhere(component), 1.4, DOWN)
    middling = float(np.median(network.log_odds(sample(depth, component, grid, 1.5))[30:50, 30:50]))
    network = replace(network, last=(network.last[0], network.last[1] - middling))
    upright = network.probabilities(depth, CAMERA, component, component, DOWN) > 0.5
    turned = np.ascontiguousarray(np.rot90(depth))  # down is now to the right
    camera = Intrinsics(CAMERA.height, CAMERA.width, 70.0, 70.0, 23.5, 29.5)
    there = np.ascontiguousarray(np.rot90(component))
    found = network.probabilities(turned, camera, there, there, np.array([1.0, 0.0])) > 0.5
    assert 0 < np.count_nonzero(upright) < np.count_nonzero(component & (depth > 0))
    assert np.mean((found == np.rot90(upright))[there]) > 0.95


def test_nothing_measured_is_no_body(network: BodyNetwork) -> None:
    """An image without depth."""
    empty = np.zeros((CAMERA.height, CAMERA.width), np.float32)
    everything = np.ones(empty.shape, np.bool_)
    assert not network.probabilities(empty, CAMERA, everything, everything, DOWN).any()


def test_people_are_told_from_furniture() -> None:
    """Components of scenes that the network was not trained with."""
    people, things, missed, taken = 0, 0, 0, 0
    for seed in range(12):
        for image in draw_images(np.random.default_rng([1, seed])):
            depth, touching = image.depth.astype(np.float32), image.people | image.furniture
            for rows, columns in (pixels.T for pixels in large_components(image)):
                component = np.zeros(depth.shape, np.bool_)
                component[rows, columns] = True
                likely = people_network().probabilities(depth, image.camera, component, touching, DOWN)
                body, shown = likely[rows, columns] > 0.5, image.people[rows, columns]
                people, missed = people + shown.sum(), missed + (shown & ~body).sum()
                things, taken = things + (~shown).sum(), taken + (~shown & body).sum()
    assert missed < 0.12 * people
    assert taken < 0.12 * things
