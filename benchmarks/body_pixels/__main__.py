"""Trains the forest that tells people from things: python -m benchmarks.body_pixels [FILE].

It needs scikit-learn (`pip install scikit-learn`), which nothing else does. People of many sizes, most of
them dressed, sit, lie, and stand in the poses of the library, with furniture, other things and other people
beside them. Cameras of three kinds look at them from all sides, from 0.6 to 4.2 m, and cut many of them.
Pixels are drawn from each image and described by differences of depth between pairs of places around them;
the forest learns which are people. The last tenth of the scenes is held out. Furniture is drawn as in
`benchmarks.furniture`, from other random numbers. Twelve minutes on two cores.
"""

from __future__ import annotations

import argparse
import sys
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.body_pixels.scenes import LabelledImage, draw_images
from gepf.common.arrays import Array, Indices, Mask
from gepf.coordinator.bodies.human.people import PIXELS_FILE
from gepf.coordinator.bodies.pixels import PixelForest, describe

SEED = 77
FEATURES, NEAREST_M, FARTHEST_M = 400, 0.02, 0.7  # of the places that are compared, from the pixel
LIMIT_M = 1.0
DRAWN = {"people": 330, "furniture": 210, "room": 40}  # pixels of an image
LIMITS = (0.3, 0.4, 0.5, 0.6)  # of the share of a pixel of a body, in the report


def main() -> int:
    """Draw, train, report, write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.body_pixels", description=__doc__)
    parser.add_argument("file", type=Path, nargs="?", default=PIXELS_FILE)
    parser.add_argument("--scenes", type=int, default=1800, metavar="N")
    parser.add_argument("--processes", type=int, default=2, metavar="N")
    chosen = parser.parse_args()
    with get_context("fork").Pool(chosen.processes) as pool:
        drawn = pool.map(draw_pixels, range(chosen.scenes), chunksize=4)
    values, labels = zip(*drawn, strict=True)
    training = int(0.9 * chosen.scenes)
    train(np.concatenate(values[:training]), np.concatenate(labels[:training]), chosen.file)
    held_out = np.concatenate(values[training:]), np.concatenate(labels[training:])
    print(report(PixelForest.load(chosen.file), *held_out))
    return 0


def draw_offsets() -> NDArray[np.float32]:
    """Pairs (F, 2, 2) of places around a pixel, metres; half of the second places are the pixel itself."""
    rng = np.random.default_rng(SEED)
    far = NEAREST_M * (FARTHEST_M / NEAREST_M) ** rng.random((FEATURES, 2))
    angles = 2.0 * np.pi * rng.random((FEATURES, 2))
    offsets = np.stack([far * np.cos(angles), far * np.sin(angles)], axis=-1)
    offsets[rng.random(FEATURES) < 0.5, 1] = 0.0
    return offsets.astype(np.float32)


def draw_pixels(nth: int) -> tuple[NDArray[np.float16], Mask]:
    """Features (P, F) of pixels of one scene, and which of them (P,) show people."""
    rng = np.random.default_rng([SEED, nth])
    values, labels = [np.empty((0, FEATURES), np.float16)], [np.empty(0, np.bool_)]
    for image in draw_images(rng):
        pixels, people = pick(image, rng)
        depth, offsets = image.depth.astype(np.float32), draw_offsets() * np.float32(image.camera.fx)
        values.append(describe(depth, pixels, offsets, LIMIT_M).astype(np.float16))
        labels.append(people)
    return np.concatenate(values), np.concatenate(labels)


def pick(image: LabelledImage, rng: np.random.Generator) -> tuple[Indices, Mask]:
    """Flat indices (P,) of pixels, and which of them (P,) show people."""
    picked = list[Indices]()
    for name, count in DRAWN.items():
        possible = np.flatnonzero(getattr(image, name))
        picked.append(rng.choice(possible, min(count, len(possible)), replace=False))
    pixels = np.concatenate(picked)
    return pixels, image.people.ravel()[pixels]


def train(values: NDArray[np.float16], labels: Mask, file: Path) -> None:
    """Train with features (P, F) and labels (P,), and write the forest."""
    from sklearn.ensemble import RandomForestClassifier  # type: ignore[import-not-found, unused-ignore]

    forest = RandomForestClassifier(
        n_estimators=10,
        max_depth=16,
        min_samples_leaf=30,
        max_features=40,
        max_samples=0.5,
        n_jobs=-1,
        random_state=SEED,
    )
    forest.fit(values.astype(np.float32), labels)
    PixelForest.of(draw_offsets(), LIMIT_M, [flattened(one.tree_) for one in forest.estimators_]).save(file)


def flattened(tree: Any) -> tuple[Indices, Array, Array]:
    """Features (N,), -1 at leaves, thresholds (N,) and shares of people (N,) of nodes, breadth first."""
    order, n = [0], 0
    while n < len(order):
        if tree.children_left[order[n]] >= 0:
            order += [tree.children_left[order[n]], tree.children_right[order[n]]]
        n += 1
    nodes = np.array(order)
    counts = tree.value[nodes, 0]
    inner = tree.children_left[nodes] >= 0
    return np.where(inner, tree.feature[nodes], -1), tree.threshold[nodes], counts[:, 1] / counts.sum(axis=1)


def report(forest: PixelForest, values: NDArray[np.float16], labels: Mask) -> str:
    """Shares of the pixels of people and of things that are taken for people."""
    shares, lines = forest.shares_by(values.astype(np.float32)), list[str]()
    for limit in LIMITS:
        people, things = (100.0 * np.mean(shares[which] > limit) for which in (labels, ~labels))
        lines.append(f"above {limit}: {people:.1f} % of the people, {things:.1f} % of the things")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
