"""Exact depth images of rooms: a floor, a wall, boxes, and a person made of ellipsoids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from gepf.common.arrays import Array, Mask
from gepf.common.camera import Intrinsics
from gepf.common.frame import Frame, View

Box = tuple[tuple[float, float, float], tuple[float, float, float]]  # least and greatest corner

CAMERA = Intrinsics(160, 120, 140.0, 140.0, 79.5, 59.5)
HEIGHT = 1.1  # of the camera above the floor, metres
WALL = 3.6  # metres away
PARTS = (
    # middle, half axes: head, trunk, legs, of somebody who stands at (0, floor, 0)
    ((0.0, -1.62, 0.0), (0.09, 0.12, 0.1)),
    ((0.0, -1.2, 0.0), (0.2, 0.36, 0.12)),
    ((-0.1, -0.45, 0.0), (0.08, 0.45, 0.09)),
    ((0.1, -0.45, 0.0), (0.08, 0.45, 0.09)),
)
TABLE: Box = ((-0.7, 0.55, 1.7), (0.7, 0.75, 2.0))
CABINET: Box = ((0.5, 0.0, 2.4), (1.1, HEIGHT, 2.9))
PERSON = (-0.4, 2.6)  # where somebody stands: x and z


class Seen(NamedTuple):
    """An image, and which pixels (H, W) are the person's."""

    view: View
    mask: Mask


@dataclass(frozen=True)
class Room:
    """A room with boxes, y down, metres, before a camera that looks down by `pitch` radians."""

    boxes: Sequence[Box] = ()
    pitch: float = 0.0
    noise: float = 0.0  # standard deviation of depth at 1 m; it grows with the square
    wall: float = WALL

    def see(self, person: tuple[float, float] | None, number: int = 0) -> Seen:
        """An image of the room with a person at x and z, or without one."""
        across = (np.arange(CAMERA.width) - CAMERA.cx) / CAMERA.fx
        down = (np.arange(CAMERA.height) - CAMERA.cy) / CAMERA.fy
        rays = np.stack([*np.meshgrid(across, down), np.ones((CAMERA.height, CAMERA.width))], axis=-1)
        rays = rays @ self.tilt.T
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = np.minimum(along(HEIGHT, rays[..., 1]), along(self.wall, rays[..., 2]))
            for box in self.boxes:
                depth = np.minimum(depth, of_box(rays, box))
            mine = np.full(depth.shape, np.inf)
            if person is not None:
                for middle, axes in PARTS:
                    place = np.array([middle[0] + person[0], middle[1] + HEIGHT, middle[2] + person[1]])
                    mine = np.minimum(mine, of_ellipsoid(rays, place, np.array(axes)))
        mask = mine < depth
        depth = np.minimum(mine, depth)
        depth += np.random.default_rng(number).normal(0.0, 1.0, depth.shape) * self.noise * depth**2
        units = np.where(depth < 8.0, np.rint(1000.0 * depth), 0.0).astype(np.uint16)
        return Seen(View(number, number / 30.0, units, 1000.0, CAMERA), mask)

    @property
    def tilt(self) -> Array:
        """Turns (3, 3) from the camera's directions to the room's."""
        c, s = np.cos(self.pitch), np.sin(self.pitch)
        return np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])

    def surface(self, person: tuple[float, float], count: int = 400) -> Array:
        """Points (V, 3) all over a person, in the camera frame."""
        n = np.arange(count) + 0.5
        turn, height = np.pi * (1.0 + 5.0**0.5) * n, 1.0 - 2.0 * n / count
        flat = np.sqrt(1.0 - height**2)
        sphere = np.stack([flat * np.cos(turn), height, flat * np.sin(turn)], axis=1)
        at = np.array([person[0], HEIGHT, person[1]])
        points = np.concatenate([sphere * axes + np.array(middle) + at for middle, axes in PARTS])
        turned: Array = points @ self.tilt
        return turned


def in_a_room(frame: Frame, behind: float = 0.6) -> Frame:
    """A frame that shows somebody alone, with a floor under the lowest point and a wall so far behind."""
    (view,) = frame.views
    depth, camera = view.metres().astype(np.float64), view.intrinsics
    down = np.broadcast_to(((np.arange(camera.height) - camera.cy) / camera.fy)[:, None], depth.shape)
    floor = float((down * depth).max()) + 0.01
    room = np.minimum(along(floor, down), depth.max() + behind)
    units = np.rint(1000.0 * np.where(depth > 0.0, depth, room)).astype(np.uint16)
    return Frame.of(replace(view, depth=units))


def along(distance: float, rays: Array) -> Array:
    """Depth at which rays reach a plane so far along one direction; infinite where they do not."""
    return np.where(rays > 0.0, distance / rays, np.inf)


def of_box(rays: Array, box: Box) -> Array:
    """Depth at which rays (H, W, 3) enter a box."""
    first, last = np.array(box[0]) / rays, np.array(box[1]) / rays
    enter, leave = np.minimum(first, last).max(axis=-1), np.maximum(first, last).min(axis=-1)
    return np.where((enter < leave) & (enter > 0.0), enter, np.inf)


def of_ellipsoid(rays: Array, middle: Array, axes: Array) -> Array:
    """Depth at which rays (H, W, 3) reach an ellipsoid."""
    ray, place = rays / axes, middle / axes
    a, b, c = np.sum(ray * ray, axis=-1), np.sum(ray * place, axis=-1), np.sum(place * place) - 1.0
    inside = b * b - a * c
    return np.where(inside > 0.0, (b - np.sqrt(np.maximum(inside, 0.0))) / a, np.inf)
