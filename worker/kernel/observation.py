"""The observed points of a depth frame (section 4.1), in an order for the closest-point search.

They are computed once per frame and shared by all its particles.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.camera import Intrinsics
from gepf.common.compiling import numba
from gepf.common.frame import EMPTY, SubjectFrame, SubjectView
from gepf.common.nearest_pixels import nearest_occupied_pixels
from gepf.common.settings import RefineSettings
from gepf.worker.kernel.surface import neighbourhoods

TILE = 16  # observed points in one search


@dataclass(frozen=True, slots=True, eq=False)
class ObservedView:
    """Observed points of one camera, in its frame, in tiles of neighbours; copies of the last fill up a tile.

    empty: the pixels in which the body can be neither visible nor hidden. nearest: for each pixel the nearest
    pixel (row, column) that is not empty.
    """

    points: NDArray[np.float32]  # (tiles * TILE, 3)
    count: int  # points that are not padding
    empty: Mask  # (H, W)
    nearest: NDArray[np.int32]  # (2, H, W)
    camera: Intrinsics
    extent: Indices  # (4,) left, top, right, bottom of the whole image
    T_camera_rig: Array  # (3, 4)
    delay_s: float  # after the time of the frame
    keypoints: Array = field(default_factory=lambda: np.empty((0, 3)))  # (K, 3) of the SubjectView, if any


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Observation:
    """What the cameras of a frame observe."""

    views: tuple[ObservedView, ...]

    @property
    def total(self) -> int:
        """Number of points of all cameras."""
        return sum(view.count for view in self.views)


class PackedObservation(NamedTuple):
    """An observation of one camera for the kernel, with depth scaled so that noise is isotropic."""

    points: NDArray[np.float32]  # (3, tiles * TILE) metres, z times the ratio of lateral to depth noise
    tiles: NDArray[np.float32]  # (6, tiles) bounding boxes
    count: int  # type: ignore[assignment]  # tuples have a method of that name
    empty: Mask  # (H, W)
    nearest: NDArray[np.int32]  # (2, H, W)
    seen: Indices  # (4,) the view's extent
    lens: Array  # (5,) fx, fy, cx, cy, delay
    keypoints: Array  # (K, 3) column, row, inverse variance


class PackedViews(NamedTuple):
    """The packed observations of all cameras, one after another in flat arrays; see `view_of`."""

    points: NDArray[np.float32]
    tiles: NDArray[np.float32]
    empty: Mask
    nearest: NDArray[np.int32]
    extents: Indices  # (C, 6) first padded point, their number, points, first pixel, rows, columns
    seen: Indices  # (C, 4)
    lenses: Array  # (C, 5) fx, fy, cx, cy, delay
    T_camera_rig: Array  # (C, 3, 4)
    keypoints: Array  # (C, K, 3), of the precision 0 where a camera has none; K is 0 if no camera has any
    total: int  # points of all cameras that are not padding


def observe(subject: SubjectFrame) -> Observation:
    """Observed points of the picked pixels of a frame; ValueError if a pixel is outside."""
    return Observation(tuple(map(observe_view, subject.views)))


def observe_for(subject: SubjectFrame, settings: RefineSettings) -> Observation:
    """`observe`, and pack the observation in advance for requests with these settings."""
    observation = observe(subject)
    pack_views(observation, settings)
    return observation


def observe_view(view: SubjectView) -> ObservedView:
    """The observed points of one camera."""
    depth, camera, picked = view.image.metres(), view.image.intrinsics, view.picked
    if len(picked) and picked.max() >= depth.size:
        raise ValueError("picked pixels lie outside of the depth image")
    rows, columns = np.divmod(picked, depth.shape[1])
    z = depth.ravel()[picked].astype(np.float64)
    points = np.column_stack([(columns - camera.cx) / camera.fx * z, (rows - camera.cy) / camera.fy * z, z])
    ordered = points[neighbourhoods(points, TILE)].astype(np.float32)
    empty = view.image.depth == 0 if view.labels is None else view.labels == EMPTY
    return ObservedView(
        points=np.concatenate([ordered, np.repeat(ordered[-1:], -len(points) % TILE, axis=0)]),
        count=len(points),
        empty=empty,
        nearest=nearest_occupied_pixels(~empty),
        camera=camera,
        extent=np.array(view.extent, dtype=np.int64),
        T_camera_rig=view.image.T_camera_rig[:3],
        delay_s=view.delay_s,
        keypoints=np.empty((0, 3)) if view.keypoints is None else view.keypoints.astype(np.float64),
    )


_packed: WeakKeyDictionary[Observation, dict[float, PackedViews]] = WeakKeyDictionary()


def pack_views(observation: Observation, settings: RefineSettings) -> PackedViews:
    """Pack the observations of all cameras in the metric of the noise; cached while they exist."""
    packed = _packed.setdefault(observation, {})
    if settings.stretch not in packed:
        packed[settings.stretch] = join_views(observation, settings.stretch)
    return packed[settings.stretch]


def join_views(observation: Observation, stretch: float) -> PackedViews:
    """Pack the observations of all cameras with depth multiplied by `stretch`."""
    views, scale = observation.views, np.array([[1.0], [1.0], [stretch]], dtype=np.float32)
    points = [np.ascontiguousarray(each.points.T) * scale for each in views]
    columns = [np.ascontiguousarray(each.reshape(-1, TILE).T) for each in points]  # one per tile and axis
    padded, pixels = [each.shape[1] for each in points], [each.empty.size for each in views]
    starts = [np.cumsum(sizes) - sizes for sizes in (padded, pixels)]
    extents = [
        (starts[0][v], padded[v], each.count, starts[1][v], *each.empty.shape) for v, each in enumerate(views)
    ]
    lenses = [(*each.camera.pinhole, each.delay_s) for each in views]
    most = max(len(each.keypoints) for each in views)
    return PackedViews(
        points=np.concatenate([each.ravel() for each in points]),
        tiles=np.concatenate([side(each, axis=0) for each in columns for side in (np.min, np.max)]),
        empty=np.concatenate([each.empty.ravel() for each in views]),
        nearest=np.concatenate([each.nearest.ravel() for each in views]),
        extents=np.array(extents, dtype=np.int64),
        seen=np.stack([each.extent for each in views]),
        lenses=np.array(lenses),
        T_camera_rig=np.stack([each.T_camera_rig for each in views]),
        keypoints=np.stack(
            [each.keypoints if len(each.keypoints) else np.zeros((most, 3)) for each in views]
        ),
        total=observation.total,
    )


@numba.njit(cache=True, nogil=True)
def view_of(views: PackedViews, v: int) -> PackedObservation:
    """The observation of one camera."""
    extents = views.extents[v]
    place, padded, count, pixel, rows, columns = (
        extents[0], extents[1], extents[2], extents[3], extents[4], extents[5],
    )  # fmt: skip
    tiles, first, area = padded // TILE, 6 * (place // TILE), rows * columns
    return PackedObservation(
        views.points[3 * place : 3 * (place + padded)].reshape(3, padded),
        views.tiles[first : first + 6 * tiles].reshape(6, tiles),
        count,
        views.empty[pixel : pixel + area].reshape(rows, columns),
        views.nearest[2 * pixel : 2 * (pixel + area)].reshape(2, rows, columns),
        views.seen[v],
        views.lenses[v],
        views.keypoints[v],
    )
