"""The scene of a camera: its noise and planes, and the background and occupancy of each pixel.

The background of a pixel is the farthest depth measured there while no person was near. Something nearer,
such as a chair that was moved, replaces it once it has stayed for `settled_s`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Mask
from gepf.common.camera import NOT_MOVED, Intrinsics, Pinhole
from gepf.common.compiling import numba
from gepf.common.frame import View
from gepf.coordinator.scene.noise import DepthNoise, fit_growth, margin_at, noise_of
from gepf.coordinator.scene.occupancy import Occupancy, OccupancyChange, Window, accumulate, permanence_of
from gepf.coordinator.scene.planes import (
    UP_DIRECTIONS,
    Planes,
    extents,
    find_planes,
    refit,
    sample_rays,
    to_points,
)
from gepf.coordinator.settings import SceneSettings

Depth = NDArray[np.float32]
Marks = NDArray[np.uint8]
Pixels = NDArray[np.uint32]  # flat indices (N,)

NO_PIXELS = np.empty(0, np.uint32)
NO_POINTS = np.empty((0, 3), np.float32)  # no points of other people and things

NO_DEPTH, FOREGROUND, BACKGROUND, ON_PLANE = 0, 1, 2, 3  # marks of a pixel
SETTLED_STEPS = 30  # steps in `settled_s`, few enough for a byte; at 30 frames/s and 1 s, a step is one frame


@dataclass(frozen=True, slots=True, eq=False)
class SceneView:
    """One frame, compared with the known scene.

    depth: (H, W) metres, 0 for pixels without depth or outside the user's scope.
    noise: of the depth.
    background: (H, W) metres, depth without people; 0 if unknown. `Scene.learn` changes it in place.
    marks: (H, W) NO_DEPTH, FOREGROUND, BACKGROUND or ON_PLANE.
    shows_room: whether the frame shows a room, not only a person; if not, pixels without depth are empty.
    settings: of the segmentation of the frame.
    out_of_scope: (H, W) pixels that the user excluded; they are unknown.
    steps: time since the last frame with depth, in steps; SETTLED_STEPS of them make `settled_s`.
    is_first: whether no earlier frame had depth.
    occupancy: what pixels have shown; valid until the next `observe`. None if the frame shows no room.
    occupied: flat indices (N,) of the pixels whose occupancy the frame changed.
    foreign: points (N, 3) of other people and things in the frame before, camera frame, metres.
    """

    number: int
    depth: Depth
    intrinsics: Intrinsics
    noise: DepthNoise
    planes: Planes
    background: Depth
    marks: Marks
    shows_room: bool
    settings: SceneSettings
    out_of_scope: Mask | None = None
    steps: int = 1
    is_first: bool = False
    occupancy: Occupancy | None = None
    occupied: Pixels = field(default_factory=lambda: NO_PIXELS)
    foreign: NDArray[np.float32] = field(default_factory=lambda: NO_POINTS)

    def permanence(self, window: Window) -> Depth | None:
        """The permanence, from 0 to 1, of what a window (h, w) shows; None if the frame shows no room.

        Must be called before the next frame is given to `observe`.
        """
        if self.occupancy is None:
            return None
        return permanence_of(self.depth, self.noise, self.occupancy, window)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def mark_pixels(depth: Depth, background: Depth, pinhole: Pinhole, planes: Array, noise: DepthNoise) -> Marks:
    """NO_DEPTH, FOREGROUND, BACKGROUND or ON_PLANE of each pixel (H, W); planes (P, 3).

    Depth beyond the background is foreground: a person may come through a door.
    """
    fx, fy, cx, cy = pinhole
    marks = np.empty(depth.shape, dtype=np.uint8)
    x = ((np.arange(depth.shape[1]) - cx) / fx).astype(np.float32)
    nearest = np.empty(depth.shape[1], dtype=np.float32)  # plane in each direction, as 1 / z
    for v in range(depth.shape[0]):
        nearest[:] = -np.inf
        for p in range(len(planes)):
            slope, offset = np.float32(planes[p, 0]), np.float32(planes[p, 1] * (v - cy) / fy + planes[p, 2])
            for u in range(depth.shape[1]):
                nearest[u] = max(nearest[u], slope * x[u] + offset)
        for u in range(depth.shape[1]):  # without branches, so that it is vectorised
            z = depth[v, u]
            margin = np.float32(margin_at(z, noise))
            # on the plane or beyond it: nearest > 1 / z - margin / z^2
            on_plane = nearest[u] * z * z > z - margin
            is_background = abs(z - background[v, u]) < margin
            mark = ON_PLANE if on_plane else (BACKGROUND if is_background else FOREGROUND)
            marks[v, u] = mark if z > 0.0 else NO_DEPTH
    return marks


class Learned(NamedTuple):
    """The change of the background by one frame: flat indices (N,) of pixels, and their new values."""

    pixels: Pixels
    depth: Depth  # (N,) metres
    nearer_steps: NDArray[np.uint8]  # (N,) for how long something nearer was there, in steps


NOTHING_LEARNED = Learned(NO_PIXELS, np.empty(0, np.float32), np.empty(0, np.uint8))


@dataclass(frozen=True, slots=True, eq=False)
class SceneChange:
    """The change of a scene by one frame: the changed pixels of the background, and everything else."""

    frames_with_depth: int = 0
    time_s: float = 0.0  # of the last frame with depth
    elapsed_s: float = 0.0  # total time between frames with depth, with long gaps shortened
    growth: float = 0.0  # of the depth's noise; 0 before the first depth
    planes: Array = field(default_factory=lambda: np.empty((0, 3)))
    has_floor: bool = False
    approximate_up: Array = field(default_factory=lambda: UP_DIRECTIONS[0])  # (3,), of the planes
    # (U, 3); a single one if the camera measures it
    possible_ups: Array = field(default_factory=lambda: UP_DIRECTIONS)
    shows_room: bool = False
    size: tuple[int, int] = (0, 0)  # rows and columns of the background; 0 at the start
    learned: Learned = NOTHING_LEARNED
    occupancy: OccupancyChange = field(
        default_factory=lambda: OccupancyChange.of(Occupancy.unknown((0, 0)), NO_PIXELS)
    )
    T_rig_camera: Array = field(default_factory=NOT_MOVED.copy)  # of the frame
    foreign: NDArray[np.float32] = field(default_factory=lambda: NO_POINTS)  # (N, 3), see `segmentation`


SceneChanges = dict[str, SceneChange]
"""The changes of the scenes of all cameras, by their names."""


class Scene:
    """What is known about the scene of one camera.

    Each frame is given to `observe` and then to `learn`. The same frames and people's pixels give the same
    scene, bit for bit; `restore` rebuilds it from the changes alone. If the size of a frame differs from that
    of earlier frames, or of the background, it counts as coming from another camera, and the scene starts
    again.

    Args:
        settings: Settings of the scene and its segmentation.
        background: Depth (H, W) in metres without people, 0 if unknown; None to learn all of it.
        up: Approximate up direction (3,), camera frame; None for a camera that may be
            rotated by a multiple of 90 degrees.
    """

    def __init__(
        self, settings: SceneSettings, background: Depth | None = None, up: Array | None = None
    ) -> None:
        self._settings = settings
        self._T_rig_camera = NOT_MOVED
        self._possible_ups = UP_DIRECTIONS if up is None else up[None]
        self._background: Depth
        self._nearer_steps: NDArray[np.uint8]
        self._occupancy: Occupancy
        self._reset(np.zeros((0, 0), np.float32) if background is None else background.copy())
        self._shows_room = background is not None

    def observe(self, image: View, out_of_scope: Mask | None = None) -> SceneView:
        """Compare the next image with the known scene; `out_of_scope` (H, W) are excluded pixels."""
        depth, self._T_rig_camera = image.metres(), image.T_rig_camera
        if self._background.shape != depth.shape:
            self._reset(np.zeros_like(depth))
        steps, occupied = 0, NO_PIXELS
        if depth.any():
            steps = self._pass_time(image.time_s)
            self._update_noise_and_planes(depth, image.intrinsics, steps)
            self._frames_with_depth += 1
        intrinsics, planes, limits = image.intrinsics, self._planes, self._settings.noise
        noise = noise_of(self._growth or limits.usual_growth_m, limits)
        if self._shows_room:
            occupied = self._accumulate(depth, noise, steps)
        return SceneView(
            number=image.number,
            depth=depth,
            intrinsics=intrinsics,
            noise=noise,
            planes=planes,
            background=self._background,
            marks=mark_pixels(depth, self._background, intrinsics.pinhole, planes.coefficients, noise),
            shows_room=self._shows_room,
            settings=self._settings,
            out_of_scope=out_of_scope,
            steps=steps,
            is_first=self._frames_with_depth <= 1,
            occupancy=self._occupancy if self._shows_room else None,
            occupied=occupied,
            foreign=self._foreign,
        )

    def learn(
        self,
        view: SceneView,
        not_learned: Mask | None = None,
        foreign: NDArray[np.float32] = NO_POINTS,
        learned: Learned = NOTHING_LEARNED,
    ) -> SceneChange:
        """Learn from the last frame, the `view` that `observe` returned, and return the change.

        Pixels (H, W) of people and possible people are `not_learned`. The points `foreign` (N, 3), camera
        frame, metres, of other people and things are remembered until the next frame. A frame may be learned
        a second time, for pixels that were excluded as people the first time; pass what the first call
        `learned`, so that the returned change includes it.
        """
        self._foreign = foreign
        if not self._shows_room:
            return self._change(NO_PIXELS, NO_PIXELS)
        if not_learned is None:
            not_learned = np.zeros(view.depth.shape, np.bool_)
        learned_before = self._background > 0.0
        pixels = learn_pixels(
            view.depth, view.noise, not_learned, self._background, self._nearer_steps, view.steps
        )
        measured = np.count_nonzero(view.marks != NO_DEPTH)
        moved = np.count_nonzero(learned_before.ravel()[pixels]) > 0.5 * measured
        if moved:  # most of the image changed: the camera was moved
            self._background[:], self._nearer_steps[:] = 0.0, 0
            self._occupancy, self._foreign = Occupancy.unknown(view.depth.shape), NO_POINTS
            learn_pixels(
                view.depth, view.noise, not_learned, self._background, self._nearer_steps, view.steps
            )
        if moved or view.is_first:
            return self.whole_change()
        pixels = np.union1d(learned.pixels, pixels) if len(learned.pixels) else pixels
        return self._change(pixels, view.occupied)

    def restore(self, change: SceneChange) -> None:
        """Restore the scene after a frame by applying its change.

        The changes of all earlier frames must have been applied first.
        """
        self._possible_ups = change.possible_ups
        if self._background.shape != change.size:
            self._reset(np.zeros(change.size, np.float32))
        self._frames_with_depth, self._shows_room = change.frames_with_depth, change.shows_room
        self._growth = change.growth
        self._time_s, self._elapsed_s = change.time_s, change.elapsed_s
        self._T_rig_camera = change.T_rig_camera
        self._planes = Planes(change.planes, change.has_floor, change.approximate_up)
        self._background.ravel()[change.learned.pixels] = change.learned.depth
        self._nearer_steps.ravel()[change.learned.pixels] = change.learned.nearer_steps
        change.occupancy.apply(self._occupancy)
        self._foreign = change.foreign

    def whole_change(self) -> SceneChange:
        """The change from an empty scene to the present one."""
        pixels = np.arange(self._background.size, dtype=np.uint32)
        return self._change(pixels, pixels)

    def _reset(self, background: Depth) -> None:
        self._frames_with_depth = 0
        self._time_s = self._elapsed_s = 0.0
        self._growth = 0.0
        self._planes = Planes(approximate_up=self._possible_ups[0])
        self._shows_room = False
        self._background = background
        self._nearer_steps = np.zeros(background.shape, np.uint8)
        self._occupancy = Occupancy.unknown(background.shape)
        self._foreign = NO_POINTS  # points of other people and things in the last frame

    def _pass_time(self, time_s: float) -> int:
        """Count the time since the last frame with depth, and return it in steps.

        The first frame counts as one step; a gap counts for at most half of `settled_s`.
        """
        before, longest_s = self._step_count, 0.5 * self._settings.settled_s
        if self._frames_with_depth:
            self._elapsed_s += min(max(time_s - self._time_s, 0.0), longest_s)
            if time_s - self._time_s > longest_s:  # other people may be anywhere
                self._foreign = NO_POINTS
        self._time_s = time_s
        return self._step_count - before if self._frames_with_depth else 1

    @property
    def _step_count(self) -> int:
        """Time so far in steps, of which SETTLED_STEPS make `settled_s`."""
        return round(SETTLED_STEPS * self._elapsed_s / self._settings.settled_s)

    def _update_noise_and_planes(self, depth: Depth, camera: Intrinsics, steps: int) -> None:
        settings, limits = self._settings, self._settings.planes
        self._growth = self._growth or fit_growth(depth, settings.noise)
        rays = sample_rays(depth, camera, noise_of(self._growth, settings.noise), limits.points_across)
        planes = self._planes
        due = len(rays) > 0 and (not self._shows_room or self._step_count % SETTLED_STEPS < steps)
        if len(planes.coefficients):  # the camera stands still or moves slowly
            self._planes = replace(planes, coefficients=refit(planes.coefficients, rays, limits.min_points))
        elif due:
            extent = extents(to_points(rays), limits.outlier_percent).max()
            if extent > settings.candidates.max_length_m:  # more than a person
                self._planes, self._shows_room = find_planes(rays, self._possible_ups, limits), True

    def _accumulate(self, depth: Depth, noise: DepthNoise, steps: int) -> Pixels:
        """Add a depth image (H, W) to the occupancy, if it is due; returns the changed pixels."""
        settings, now = self._settings, self._step_count
        interval, memory = (
            max(1, round(SETTLED_STEPS * time_s / settings.settled_s))
            for time_s in (settings.remember_interval_s, settings.remembered_s)
        )
        if now // interval == (now - steps) // interval:
            return NO_PIXELS
        is_first = not self._occupancy.farthest.any()
        weight = 1.0 if is_first else min(1.0, max(steps, interval) / min(now + 1, memory))
        return accumulate(depth, noise, self._occupancy, weight)

    def _change(self, pixels: Pixels, occupied: Pixels) -> SceneChange:
        """The change of the background and of the occupancy at these pixels (N,), flat indices."""
        return SceneChange(
            frames_with_depth=self._frames_with_depth,
            time_s=self._time_s,
            elapsed_s=self._elapsed_s,
            growth=self._growth,
            planes=self._planes.coefficients,
            has_floor=self._planes.has_floor,
            approximate_up=self._planes.approximate_up,
            possible_ups=self._possible_ups,
            shows_room=self._shows_room,
            size=self._background.shape,
            learned=Learned(pixels, self._background.ravel()[pixels], self._nearer_steps.ravel()[pixels]),
            occupancy=OccupancyChange.of(self._occupancy, occupied),
            T_rig_camera=self._T_rig_camera,
            foreign=self._foreign,
        )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def learn_pixels(
    depth: Depth,
    noise: DepthNoise,
    not_learned: Mask,
    background: Depth,
    nearer_steps: NDArray[np.uint8],
    steps: int,
) -> NDArray[np.uint32]:
    """Learn a depth image (H, W) in place; returns the flat indices (N,) of the changed pixels.

    `steps` have passed since the last image.
    """
    pixels = np.empty(depth.size, dtype=np.uint32)
    count, changes = 0, np.empty(depth.shape[1], dtype=np.bool_)
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):  # without branches, so that it is vectorised; few pixels change
            z = depth[v, u]
            margin = np.float32(margin_at(z, noise))
            unchanged = (abs(z - background[v, u]) <= margin) & (nearer_steps[v, u] == 0)
            changes[u] = (z > 0.0) & (not not_learned[v, u]) & (not unchanged)
        for u in range(depth.shape[1]):
            if not changes[u]:
                continue
            pixels[count] = v * depth.shape[1] + u
            count += 1
            z, known_depth, margin = depth[v, u], background[v, u], np.float32(margin_at(depth[v, u], noise))
            nearer_steps[v, u] = nearer_steps[v, u] + steps if z < known_depth - margin else 0
            if z > known_depth + margin or nearer_steps[v, u] >= SETTLED_STEPS:
                background[v, u], nearer_steps[v, u] = z, 0
    return pixels[:count].copy()
