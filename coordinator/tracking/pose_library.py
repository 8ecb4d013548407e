"""Poses in which a body can be detected, each with its descriptor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.body import BodyModel
from gepf.common.camera import NOT_MOVED, moved
from gepf.common.compiling import numba
from gepf.common.frame import SubjectView
from gepf.common.kinematics import link_transforms, pose_vertices
from gepf.common.kinematics.rotations import euler_angles, euler_matrix
from gepf.coordinator.bodies.family import Bodies, BodySize
from gepf.coordinator.scene.planes import Planes
from gepf.coordinator.settings import SearchSettings
from gepf.coordinator.tracking.descriptor import (
    COLUMNS,
    ROWS,
    VACANT,
    Cells,
    Image,
    cells_of,
    compare_part,
    describe,
    fill_differences,
    move_middle,
    splat,
)
from gepf.coordinator.tracking.observation import shows
from gepf.coordinator.tracking.truncation import truncated_sides


@dataclass(frozen=True, eq=False)
class PoseLibrary:
    """Poses (N, D) with the root at the origin, and their descriptors.

    root: Indices of the root's degrees of freedom. centres: Centre of each descriptor relative to the root,
    metres. cells: see `fill_differences`.
    """

    poses: Array  # (N, D)
    root: Indices  # (6,)
    centres: Array  # (N, 3)
    cells: NDArray[np.float32]  # (ROWS * COLUMNS, N)
    occupied: NDArray[np.float32]  # (N,)
    cell_m: float
    settings: SearchSettings

    @property
    def _bound_m(self) -> float:
        """The largest difference of depth that counts, metres."""
        return self.settings.max_cell_difference * self.cell_m

    def match(
        self,
        points: Array,
        scales: Sequence[float],
        roll: float,
        count: int,
        T_rig_camera: Array = NOT_MOVED,
        view: SubjectView | None = None,
    ) -> tuple[Array, Indices]:
        """The poses (count, D) most similar to points (P, 3), moved to them, and the indices of their scales.

        Points are in the camera's frame, metres, and are rotated by `roll`, radians, before the comparison;
        poses are in the rig's frame, the most similar first; `T_rig_camera` is (4, 4). `scales` are
        relative to the library. If the `view` that shows the points truncates the body, only the part of each
        pose that would be in view is compared.
        """
        turn = rotation_to_optical_axis(points.mean(axis=0), roll)
        if view is not None and (truncated := truncated_sides(view, turn, self.settings)).any():
            roots, difference = self._compare_part(points @ turn.T, scales, truncated, view, turn)
            chosen, scale_index = most_similar(difference, count)
            places = roots[scale_index, chosen]
        else:
            centres, difference = self._compare(points @ turn.T, scales)
            chosen, scale_index = most_similar(difference, count)
            places = centres[scale_index] - self.centres[chosen]
        places = places * np.take(scales, scale_index)[:, None]
        places = moved(places @ turn, T_rig_camera)
        to_rig = T_rig_camera[:3, :3] @ turn.T
        return turned_to(self.root, self.poses[chosen], places, to_rig), scale_index

    def _compare(self, points: Array, scales: Sequence[float]) -> tuple[Array, NDArray[np.float32]]:
        """Centres (S, 3) per scale, in library units, and differences (S, N) from a whole body's points."""
        points = np.ascontiguousarray(points)
        difference = np.empty((len(scales), len(self.poses)), dtype=np.float32)
        centres = np.empty((len(scales), 3))
        image = np.empty((ROWS, COLUMNS), dtype=np.float32)
        for k, scale in enumerate(scales):
            cells = describe(points / scale, self.cell_m, image, centres[k])
            fill_differences(self.cells, self.occupied, image, self._bound_m, difference[k])
            difference[k] /= cells + self.occupied
        return centres, difference

    @cached_property
    def _cells(self) -> Cells:
        """The descriptors, in the form in which they are compared with a part of a body."""
        return cells_of(self.cells.T.reshape(-1, ROWS, COLUMNS))

    def _compare_part(
        self, points: Array, scales: Sequence[float], truncated: Mask, view: SubjectView, turn: Array
    ) -> tuple[Array, NDArray[np.float32]]:
        """Positions of the roots (S, N, 3) per scale, in library units, and differences (S, N) from a part.

        `points` (P, 3) are those of the part, rotated by `turn` (3, 3). `truncated`: see `truncated_sides`.
        """
        left, right, top, bottom = truncated.astype(np.int64)
        ends = np.array([left - right, top - bottom])  # an end is visible if only the other is truncated
        image, middle, bound = np.empty((ROWS, COLUMNS), np.float32), np.empty(3), self._bound_m
        differences, places = [], []
        for scale in scales:
            scaled = np.ascontiguousarray(points / scale)
            describe(scaled, self.cell_m, image, middle)
            move_middle(scaled, self.cell_m, ends, middle)
            splat(scaled, self.cell_m, middle, image)
            filled = image < VACANT
            image[filled] -= np.float32(middle[2])
            in_view = filled | shows(view, scale * cell_points(self.cell_m, middle) @ turn).reshape(
                image.shape
            )
            difference, steps = compare_part(self._cells, image, in_view, ends, bound)
            differences.append(difference)
            places.append(middle - self.centres + steps * (self.cell_m, self.cell_m, 1.0))
        return np.array(places), np.array(differences)


def cell_points(cell_m: float, middle: Array) -> Array:
    """The centres (ROWS * COLUMNS, 3) of the cells of a descriptor, at the depth of its middle (3,)."""
    row, column = np.divmod(np.arange(ROWS * COLUMNS), COLUMNS)
    across, down = column + 0.5 - 0.5 * COLUMNS, row + 0.5 - 0.5 * ROWS
    return np.asarray(middle + cell_m * np.stack([across, down, np.zeros(len(row))], axis=1))


def most_similar(difference: NDArray[np.float32], count: int) -> tuple[Indices, Indices]:
    """The poses (count,) with the least difference (S, N) at any scale, and the indices of that scale."""
    scale_index = np.argmin(difference, axis=0)
    best = difference[scale_index, np.arange(len(scale_index))]
    chosen = np.argsort(best, kind="stable")[:count]
    return chosen, scale_index[chosen]


@lru_cache(maxsize=4)
def library_of(bodies: Bodies, size: BodySize, settings: SearchSettings) -> PoseLibrary:
    """The poses in which a body of this size is searched for; built once."""
    model, rng = bodies.for_start(*size), np.random.default_rng(20)  # independent of the run's seed
    count, cell_m = settings.library_poses, bodies.family.cell_m
    poses = bodies.family.draw_poses(model, count, rng)
    if cell_m is None:
        cell_m = float(np.max(np.ptp(pose_vertices(model, poses[:: max(1, count // 100)]), axis=1))) / COLUMNS
    return describe_poses(model, poses, cell_m, settings)


def rotation_to_optical_axis(at: Array, roll: float) -> Array:
    """Rotation (3, 3) that moves a point (3,) to the optical axis of the camera and then rolls by `roll`."""
    ahead = at / np.linalg.norm(at)
    across = np.cross([0.0, 1.0, 0.0], ahead)
    across /= np.linalg.norm(across)
    straight = np.stack([across, np.cross(ahead, across), ahead])
    c, s = np.cos(roll), np.sin(roll)
    return np.asarray(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ straight)


def turned_to(root: Indices, poses: Array, places: Array, turn: Array) -> Array:
    """Poses (N, D), rotated by `turn` (3, 3), with the root at `places` (N, 3).

    `root` (6,) are the indices of the degrees of freedom of the root.
    """
    after, angles = poses.copy(), root[3:]
    after[:, root[:3]] = places
    for pose in after:
        pose[angles] = euler_angles(turn @ euler_matrix(pose[angles]), pose[angles])
    return after


def at_quarter_turns(
    model: BodyModel,
    pose: Array,
    points: Array,
    cell_m: float,
    settings: SearchSettings,
    T_rig_camera: Array = NOT_MOVED,
    view: SubjectView | None = None,
) -> Array:
    """A pose (D,) moved to the observed points (P, 3), in four rotations about the vertical axis (4, D).

    The points are in the frame of the camera, poses in that of the rig; `T_rig_camera` is (4, 4). If the
    `view` that shows the points truncates the body, the part of the pose that would be in view is moved
    there.
    """
    straight = rotation_to_optical_axis(points.mean(axis=0), 0.0)
    turn = straight @ T_rig_camera[:3, :3].T
    poses, place, angles = np.tile(pose, (4, 1)), model.root[:3], model.root[3:]
    for n, rotated in enumerate(poses):
        quarter = euler_matrix(np.array([0.0, 0.5 * np.pi * n, 0.0]))
        rotated[angles] = euler_angles(euler_matrix(pose[angles]) @ quarter, pose[angles])
    if view is not None and truncated_sides(view, straight, settings).any():
        turned = turned_to(model.root, poses, np.zeros((4, 3)), turn)
        library = describe_poses(model, turned, cell_m, settings)
        return library.match(points, [1.0], 0.0, 4, T_rig_camera, view)[0]
    observed = seen_centre(moved(points, T_rig_camera) @ turn.T, cell_m)
    for rotated, surface in zip(
        poses, pose_vertices(model, poses)[:, :: vertex_stride(model, settings)], strict=True
    ):
        rotated[place] += (observed - seen_centre(surface @ turn.T, cell_m)) @ turn
    return poses


def seen_centre(points: Array, cell_m: float) -> Array:
    """The centre (3,) of the points (P, 3) that are visible along the third axis, as in a descriptor."""
    middle = np.empty(3)
    image = np.empty((ROWS, COLUMNS), dtype=np.float32)
    describe(np.ascontiguousarray(points), cell_m, image, middle)
    return middle


def describe_poses(model: BodyModel, poses: Array, cell_m: float, settings: SearchSettings) -> PoseLibrary:
    """Compute the descriptors of poses (N, D)."""
    count, stride = len(poses), vertex_stride(model, settings)
    links, vertices = model.skin_links[::stride, 0].copy(), model.vertices[::stride].copy()
    images, centres, occupied = describe_each(vertices, links, link_transforms(model, poses), cell_m)
    cells = np.ascontiguousarray(images.reshape(count, ROWS * COLUMNS).T)
    return PoseLibrary(poses, model.root, centres, cells, occupied, cell_m, settings)


def vertex_stride(model: BodyModel, settings: SearchSettings) -> int:
    """The largest stride over the vertices that still fills all cells."""
    return max(1, len(model.vertices) // settings.library_vertices)


@numba.njit(cache=True, nogil=True)
def describe_each(
    vertices: Array, links: Indices, transforms: Array, cell_m: float
) -> tuple[Image, Array, NDArray[np.float32]]:
    """Images (N, ROWS, COLUMNS), centres (N, 3) and numbers of occupied cells (N,) of a body in each pose.

    Each of the `vertices` (V, 3) moves with its link in `links` (V,); `transforms` (N, L, 3, 4) are those of
    all links in each pose.
    """
    count, points = len(transforms), np.empty((len(vertices), 3))
    images, centres = np.empty((count, ROWS, COLUMNS), dtype=np.float32), np.empty((count, 3))
    occupied = np.empty(count, dtype=np.float32)
    for n in range(count):
        for v in range(len(vertices)):
            t = transforms[n, links[v]]
            for a in range(3):
                points[v, a] = (
                    t[a, 0] * vertices[v, 0] + t[a, 1] * vertices[v, 1] + t[a, 2] * vertices[v, 2] + t[a, 3]
                )
        occupied[n] = describe(points, cell_m, images[n], centres[n])
    return images, centres, occupied


def upright_rolls(planes: Planes, rolls: tuple[float, ...], min_upright: float) -> tuple[float, ...]:
    """Rotations of the image, radians, in which a body is searched for; in the first the room is upright.

    If the vertical projects into the image plane with a length below `min_upright`, no image direction is
    upright, and `rolls` are returned unchanged.
    """
    across, down, _ = planes.up
    if len(rolls) == 1 or np.hypot(across, down) < min_upright:
        return rolls
    upright = float(np.arctan2(-across, -down))
    return tuple(upright + roll for roll in rolls)
