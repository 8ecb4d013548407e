"""The scene that a camera sees: what is known of it, frame after frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from common.frame import SUBJECT, DepthFrame
from coordinator.scene.cutting import Cut
from coordinator.scene.noise import DepthNoise, fit_noise
from coordinator.scene.people.candidates import somebodys, take_apart
from coordinator.scene.room.background import Learned, given, learn, nothing_known
from coordinator.scene.room.planes import NONE, Planes, find_planes, follow_planes, sample
from coordinator.scene.view import SceneView

Array = NDArray[np.float64]

SPAN = 2.4  # metres between the measured points of a frame from which on it shows more than a person
EXTREMES = (1.0, 99.0)  # per cent
FILLED = 0.4  # of the picture, from which on so much is measured that it cannot be people alone
MOVED = 0.5  # of what is measured, where so much is not as it was the camera moved: what is known is void
EVERY = 30  # frames after which planes are sought again, where none were found
NOTHING = nothing_known(0, 0).only(np.empty(0, np.uint32))


@dataclass(frozen=True, slots=True, eq=False)
class SceneChange:
    """What a frame changed in what is known of a scene: of the background its pixels, of the rest all."""

    seen: int = 0  # frames that show something
    growth: float = 0.0  # of the depth's noise; 0 before anything was measured
    planes: Array = field(default_factory=lambda: NONE.coefficients)  # (P, 3)
    has_floor: bool = False
    furnished: bool = False
    size: tuple[int, int] = (0, 0)  # rows and columns of the background; none are known in the beginning
    learned: Learned = field(default_factory=lambda: NOTHING)


class Scene:
    """What is known of a scene so far.

    Each frame is given to `see`, and then, with what was cut out of it, to `learn`. From the same frames and
    bodies the same follows, bit for bit; `recall` does it from the changes alone.

    Args:
        background: Depth (H, W) in metres where nobody is, 0 where that is not known; None to learn it all.
        up: Where the sky is about (3,), camera frame; None for a camera that is held as usual.
    """

    def __init__(self, background: NDArray[np.float32] | None = None, up: Array | None = None) -> None:
        self._seen = 0
        self._noise: DepthNoise | None = None
        self._planes = NONE if up is None else replace(NONE, sky=up)
        self._furnished = background is not None
        self._background = None if background is None else given(background)
        self._void = False  # what was given is known no more

    def see(self, frame: DepthFrame, left_out: NDArray[np.bool_] | None = None) -> SceneView:
        """A frame with what is known of its scene; `left_out` (H, W) are pixels that do not count."""
        depth = frame.metres()
        self._look(depth, sample(depth, frame.intrinsics))
        known = self._background
        return SceneView(
            number=frame.number,
            depth=depth,
            camera=frame.intrinsics,
            noise=self._noise or DepthNoise(),
            planes=self._planes,
            background=np.zeros_like(depth) if known is None else known.depth,
            furnished=self._furnished,
            left_out=left_out,
        )

    def learn(
        self,
        view: SceneView,
        cut: Cut | None,
        somebody: NDArray[np.bool_] | None = None,
        *,
        patient: bool = False,
        elsewhere: bool = False,
    ) -> SceneChange:
        """Take in the frame that was seen last, and give what it changed.

        Args:
            view: The frame, as it was seen.
            cut: The body that was cut out of it; None where nobody is found yet, or who was is lost: then
                whoever may be a person is learned late.
            somebody: Pixels (H, W) of whoever may be a person, if they are known.
            patient: Learn what was cut out as late as whoever may be a person: not all are found yet.
            elsewhere: The body may have left; so whoever may be a person is learned late.
        """
        learned = NOTHING
        if self._furnished:
            near = cut.near if cut else None
            doubtful = np.zeros(view.depth.shape, np.bool_) if cut is None else subject_in(view, cut)
            if cut is None or elsewhere:
                doubtful |= somebodys(view, take_apart(view)) if somebody is None else somebody
            patient = patient or elsewhere
            known = self._background or nothing_known(*view.depth.shape)
            was_known = known.depth.ravel() > 0.0
            learned = learn(known, view.depth, view.lens, view.noise.growth, near, doubtful, patient=patient)
            changed = np.count_nonzero(was_known[learned.pixels])
            if changed > MOVED * np.count_nonzero(view.depth):
                known = nothing_known(*view.depth.shape)
                learn(known, view.depth, view.lens, view.noise.growth, near, doubtful, patient=patient)
                learned = known.only(np.arange(view.depth.size, dtype=np.uint32))
                self._void = True
            self._background = known
        return self._change(learned)

    def recall(self, change: SceneChange) -> None:
        """Know what was known after the frame that made this change, if all before it were recalled, too."""
        self._seen, self._furnished = change.seen, change.furnished
        self._noise = DepthNoise(change.growth) if change.growth else None
        self._planes = Planes(change.planes, change.has_floor, self._planes.sky)
        if self._background is None and change.size != (0, 0):
            self._background = nothing_known(*change.size)
        if self._background is not None:
            self._background.recall(change.learned)
            self._void = self._void or len(change.learned.pixels) == self._background.depth.size

    def all(self) -> SceneChange:
        """The change that leads from nothing, or from the background that was given, to what is known now."""
        if self._background is None:
            return self._change(NOTHING)
        known = self._background
        touched = (known.depth > 0.0) | (known.frames > 0) | self._void
        return self._change(known.only(np.flatnonzero(touched).astype(np.uint32)))

    def _look(self, depth: NDArray[np.float32], rays: Array) -> None:
        if len(rays):
            self._noise = self._noise or fit_noise(depth)
            if len(self._planes.coefficients):
                self._planes = follow_planes(self._planes, rays, self._noise)
            elif self._seen % EVERY == 0 and shows_more_than_a_person(rays):
                self._planes = find_planes(rays, self._noise, self._planes.sky)
                filled = float(np.mean(depth > 0.0)) > FILLED
                self._furnished = self._furnished or filled or len(self._planes.coefficients) > 0
            self._seen += 1

    def _change(self, learned: Learned) -> SceneChange:
        return SceneChange(
            self._seen,
            self._noise.growth if self._noise else 0.0,
            self._planes.coefficients,
            self._planes.has_floor,
            self._furnished,
            (0, 0) if self._background is None else self._background.depth.shape,
            learned,
        )


def subject_in(view: SceneView, cut: Cut) -> NDArray[np.bool_]:
    """Pixels (H, W) of the subject that was cut out."""
    found = np.zeros(view.depth.shape, dtype=np.bool_)
    left, top, right, bottom = cut.window
    found[top:bottom, left:right] = cut.kinds == SUBJECT
    return found


def shows_more_than_a_person(rays: Array) -> bool:
    """Whether points (N, 3) of `sample` spread farther than one person can."""
    z = 1.0 / rays[:, 2]
    low, high = np.percentile(np.stack([rays[:, 0] * z, rays[:, 1] * z, z]), EXTREMES, axis=1)
    return bool((high - low).max() > SPAN)
