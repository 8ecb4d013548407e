"""People in clothes as a depth camera with colour films them: noise, and the true joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.camera import points_of
from gepf.common.frame import Frame, View
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.coordinator.sources.source import to_units
from gepf.coordinator.synthesis.noise import KINECT, SensorModel, as_a_kinect
from gepf.coordinator.synthesis.rendering import ColouredSurface, DepthRenderer
from gepf.coordinator.synthesis.scenes import Scene

BACKGROUND, LIGHT = np.array([0.6, 0.6, 0.5]), np.array([0.3, -0.5, -1.0])
IMAGE_NOISE = 4.0  # of 255
UNITS_PER_METRE = 1000.0
PATCHES_M = (0.9, 0.25, 0.06)  # widths of the patches of a room's texture
CONTRAST, TINT = 0.12, 0.05  # of the patches of each width: of their brightness, and of their colours


@dataclass(frozen=True, eq=False)
class Film:
    """Frames (F) of N people.

    joints (F, N, J, 3) are true, camera frame, metres. owners (F, H, W) is the person at each pixel, -1 for
    none. in_view (F, N) is the share of each person that nobody else hides.
    """

    frames: list[Frame]
    names: tuple[str, ...]  # (J,) of the joints
    joints: Array
    owners: NDArray[np.int8]
    in_view: Array


def film(
    scene: Scene, clothes: Sequence[Array], rng: np.random.Generator, sensor: SensorModel = KINECT
) -> Film:
    """The people of a scene, with the colours (V, 3) of their vertices."""
    people, camera, images = [scene, *scene.others], scene.camera, list[Frame]()
    owners = np.full((len(scene.poses), camera.height, camera.width), -1, np.int8)
    in_view = np.zeros((len(scene.poses), len(people)))
    empty, wallpaper = np.zeros(owners.shape[1:]), np.tile(255.0 * BACKGROUND, (*owners.shape[1:], 1))
    with DepthRenderer(camera) as renderer:
        if scene.room is not None:
            empty = renderer.depth(*scene.room).astype(np.float64)
            wallpaper = 255.0 * texture(points_of(empty, camera, np.ones(empty.shape, np.bool_)))
            wallpaper = wallpaper.reshape(*empty.shape, 3)
        for number in range(len(scene.poses)):
            depth, colours, pixels = empty.copy(), wallpaper.copy(), np.zeros(len(people))
            for n, person in enumerate(people):
                surface = pose_vertices(person.model, person.poses[number, None])[0]
                seen = renderer.depth(surface, person.model.triangles)
                nearer = (seen > 0.0) & ((depth == 0.0) | (seen < depth))
                depth[nearer], owners[number][nearer] = seen[nearer], n
                dressed = ColouredSurface(surface, person.model.triangles, clothes[n])
                colours[nearer] = renderer.colours(dressed, BACKGROUND, LIGHT)[nearer]
                pixels[n] = np.sum(seen > 0.0)
            shown = np.array([np.sum(owners[number] == n) for n in range(len(people))])
            in_view[number] = shown / np.maximum(1.0, pixels)
            noisy = as_a_kinect(depth, camera, rng, sensor)
            image = np.clip(colours + rng.normal(0.0, IMAGE_NOISE, colours.shape), 0, 255).astype(np.uint8)
            units = to_units(noisy, UNITS_PER_METRE)
            view = View(number, number / scene.fps, units, UNITS_PER_METRE, camera, colours=image)
            images.append(Frame.of(view))
    joints = np.stack([joint_positions(person.model, person.poses) for person in people], axis=1)
    return Film(images, scene.model.joint_names, joints, owners, in_view)


def texture(points: Array) -> Array:
    """Colours (N, 3), from 0 to 1, of points of a room: patches of several widths with random colours."""
    colours = np.tile(BACKGROUND, (len(points), 1))
    for width_m in PATCHES_M:
        patches, inverse = np.unique(np.floor(points / width_m).astype(np.int64), axis=0, return_inverse=True)
        drawn = np.random.default_rng(len(patches)).uniform(-1.0, 1.0, (len(patches), 4))
        drawn = CONTRAST * drawn[:, 3:] + TINT * drawn[:, :3]
        colours += drawn[inverse.ravel()]
    return np.asarray(np.clip(colours, 0.0, 1.0))
