"""Depth images of a situation from one side, with noise, and which joints they show."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import msgspec
import numpy as np
import trimesh

from benchmarks.furniture.parts import Range, Surface, joined, room
from benchmarks.furniture.people import Posed
from benchmarks.furniture.situations import Situation
from gepf.common.arrays import Array, Indices, Mask
from gepf.common.body import BodyModel
from gepf.common.camera import Intrinsics, inverse, moved, pixels_at, rigid
from gepf.common.frame import Frame, View
from gepf.coordinator.sources.source import to_units
from gepf.coordinator.synthesis.noise import SensorModel, as_a_kinect
from gepf.coordinator.synthesis.rendering import DepthRenderer

DEPTH_SCALE = 10_000.0  # units per metre


KINECT = SensorModel(jump_m=0.1)
"""With 3 cm, the rows of a floor three metres away would be edges, and half of them without depth."""


class Recorder(msgspec.Struct, frozen=True):
    """The camera and the room."""

    camera: Intrinsics = Intrinsics(512, 424, 365.0, 365.0, 255.5, 211.5)
    fps: float = 30.0
    height_m: Range = (1.0, 1.6)
    distance_m: Range = (2.2, 3.0)  #: from the middle of the person, level
    walls_m: Range = (2.0, 3.2)  #: from there
    ceiling_m: float = 2.6
    around: int = 50  #: vertices that show a joint
    shown_share: float = 0.1  #: of them, at least, if the joint is visible
    same_m: float = 0.02  #: a vertex is visible if the surface is at most so far before it


RECORDER = Recorder()


@dataclass(frozen=True, slots=True, eq=False)
class Footage:
    """Frames (F), true joints (F, J, 3) in the camera frame, and which are visible (F, J)."""

    frames: list[Frame]
    names: tuple[str, ...]
    joints: Array
    visible: Mask


def record(
    situation: Situation, azimuth_deg: float, rng: np.random.Generator, recorder: Recorder = RECORDER
) -> Footage:
    """Render a situation from a side: 0 degrees is in front of the person, 90 at the left hand."""
    person, camera = situation.person, recorder.camera
    middle = person.joints.mean(axis=(0, 1))
    back = inverse(
        look_at(middle, azimuth_deg, rng.uniform(*recorder.distance_m), rng.uniform(*recorder.height_m))
    )
    walls, triangles = room(rng.uniform(*recorder.walls_m, 4).tolist(), recorder.ceiling_m)
    still = [(walls + middle * (1.0, 0.0, 1.0), triangles), joined(situation.furniture)]
    bodies, frames, visible = [person, *situation.others], list[Frame](), list[Mask]()
    near = nearest_vertices(person.model, recorder.around)
    with DepthRenderer(camera) as renderer:
        for n, surfaces in enumerate(moving(bodies)):
            vertices, faces = trimesh.util.append_faces(*zip(*still, *surfaces, strict=True))
            exact = renderer.depth(moved(np.asarray(vertices), back), faces).astype(np.float64)
            depth = to_units(as_a_kinect(exact, camera, rng, KINECT), DEPTH_SCALE)
            frames.append(Frame.of(View(n, n / recorder.fps, depth, DEPTH_SCALE, camera)))
            shown = shows(exact, moved(surfaces[0][0], back), camera, recorder.same_m)
            visible.append(shown[near].mean(axis=1) >= recorder.shown_share)
    return Footage(frames, person.model.joint_names, moved(person.joints, back), np.array(visible))


def look_at(middle: Array, azimuth_deg: float, distance: float, height: float) -> Array:
    """T_room_camera (4, 4) of a camera that looks at a point and is upright."""
    angle, down = np.radians(azimuth_deg), np.array([0.0, 1.0, 0.0])
    place = np.array([middle[0] + distance * np.sin(angle), -height, middle[2] - distance * np.cos(angle)])
    ahead = (middle - place) / np.linalg.norm(middle - place)
    right = np.cross(down, ahead)
    right /= np.linalg.norm(right)
    return rigid(np.column_stack([right, np.cross(ahead, right), ahead]), place)


def moving(bodies: list[Posed]) -> Iterator[list[Surface]]:
    """The surfaces of all bodies in each frame."""
    for each in zip(*(body.vertices for body in bodies), strict=True):
        yield [(vertices, body.model.triangles) for vertices, body in zip(each, bodies, strict=True)]


def nearest_vertices(model: BodyModel, count: int) -> Indices:
    """The vertices (J, n) nearest to each joint at rest."""
    away = np.linalg.norm(model.joint_points[:, None] - model.vertices, axis=-1)
    return np.asarray(np.argsort(away, axis=1)[:, :count])


def shows(depth: Array, points: Array, camera: Intrinsics, same_m: float) -> Mask:
    """Which points (n, 3) of a surface an exact depth image (H, W) shows."""
    row, column, inside = pixels_at(points, camera)
    seen = depth[np.where(inside, row, 0), np.where(inside, column, 0)]
    return np.asarray(inside & (seen > 0.0) & (points[:, 2] - seen < same_m))
