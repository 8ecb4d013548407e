"""Draws the crops that `train.py` trains its network on: python -m benchmarks.body_pixels CROPS.

People of many sizes, most of them dressed, sit, lie, and stand in the poses of the library, with furniture,
other things and other people beside them. Cameras of three kinds look at them from all sides, from 0.6 to
4.2 m, and cut many of them. Each large component of the foreground gives a crop, as the tracker makes it,
moved, turned and scaled a little; in some of them a part of the room is left in the foreground. Furniture is
drawn as in `benchmarks.furniture`, from other random numbers. Ten minutes on two cores.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.body_pixels.scenes import LabelledImage, draw_images
from gepf.common.arrays import Indices, Mask
from gepf.coordinator.bodies.pixels import CELL_M, MIN_CELLS, grid_at, sample
from gepf.coordinator.scene.noise import noise_of
from gepf.coordinator.scene.segmentation import label_parts, measure_components
from gepf.coordinator.settings import SceneSettings

SEED = 80
SETTINGS = SceneSettings()
MOVED_CELLS, TURNED_DEG, SCALED = 5.0, 4.0, 0.1  # most, deviation, most
ROOM_SHARE = 0.3  # of images in which a part of the room is left
LARGEST_COMPONENTS = 3  # of an image


class Crop(NamedTuple):
    """What the network sees (H, W), and which foreground cells (H, W) are people; or N crops as columns."""

    depth: NDArray[np.float16]
    known: Mask
    foreground: Mask
    people: Mask


def main() -> int:
    """Draw and write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.body_pixels", description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--scenes", type=int, default=3_300, metavar="N")
    parser.add_argument("--processes", type=int, default=2, metavar="N")
    chosen = parser.parse_args()
    with get_context("fork").Pool(chosen.processes) as pool:
        drawn = pool.map(draw_crops, range(chosen.scenes), chunksize=4)
    scenes = np.repeat(np.arange(chosen.scenes), [len(crops) for crops in drawn])
    crops = Crop(
        *(np.array(column) for column in zip(*(crop for crops in drawn for crop in crops), strict=True))
    )
    with chosen.file.open("wb") as file:
        np.savez(
            file,
            depth=crops.depth,
            known=crops.known,
            foreground=crops.foreground,
            people=crops.people,
            scenes=scenes,
        )
    print(f"{len(scenes)} crops")
    return 0


def draw_crops(nth: int) -> list[Crop]:
    """The crops of one scene."""
    rng = np.random.default_rng([SEED, nth])
    return [
        crop_around(component, foreground, image, rng)
        for image in draw_images(rng)
        for foreground in [draw_foreground(image, rng)]
        for component in large_components(image)
    ]


def draw_foreground(image: LabelledImage, rng: np.random.Generator) -> Mask:
    """People and things (H, W), in some images with a part of the room."""
    foreground = (image.people | image.furniture) & (image.depth > 0.0)
    if rng.random() < ROOM_SHARE and image.room.any():
        along = np.tensordot(rng.normal(size=2), np.indices(image.depth.shape), axes=1)
        beyond = along > np.quantile(along[image.room], rng.uniform(0.5, 0.95))
        foreground |= image.room & beyond & (image.depth > 0.0)
    return foreground


def large_components(image: LabelledImage) -> Iterator[Indices]:
    """The pixels (P, 2), rows and columns, of the largest components of people and things."""
    camera, limits, depth = image.camera, SETTINGS.segmentation, image.depth.astype(np.float32)
    noise = noise_of(SETTINGS.noise.usual_growth_m, SETTINGS.noise)
    free = (image.people | image.furniture) & (depth > 0.0)
    labels = label_parts(depth, free, limits.step_m, limits.step_m, noise, camera.fx)
    areas, _ = measure_components(labels, depth, camera.fx, camera.fy)
    for label in np.argsort(-areas)[:LARGEST_COMPONENTS].tolist():
        if areas[label] >= limits.min_person_m2:
            yield np.argwhere(labels == label)


def crop_around(component: Indices, foreground: Mask, image: LabelledImage, rng: np.random.Generator) -> Crop:
    """The crop around the pixels (P, 2) of a component, moved, turned and scaled a little."""
    middle_m = float(np.median(image.depth[tuple(component.T)])) * np.exp(rng.uniform(-SCALED, SCALED))
    step = CELL_M * image.camera.fx / middle_m
    centre = 0.5 * (component.min(axis=0) + component.max(axis=0))
    centre = centre + step * rng.uniform(-MOVED_CELLS, MOVED_CELLS, 2)
    angle = np.radians(rng.normal(0.0, TURNED_DEG))
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    grid = grid_at(centre, step * turn, np.array([MIN_CELLS, MIN_CELLS]))
    depth, known, inside = sample(image.depth.astype(np.float32), foreground, grid, middle_m)
    people = sample(image.depth.astype(np.float32), image.people, grid, middle_m)[2]
    return Crop(depth.astype(np.float16), known > 0.0, inside > 0.0, (people > 0.0) & (inside > 0.0))


if __name__ == "__main__":
    sys.exit(main())
