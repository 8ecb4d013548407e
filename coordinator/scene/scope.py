"""The scope of tracking: the part of the scene, the person who is meant, and the known room."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Mask
from gepf.common.frame import View
from gepf.coordinator.scene.candidates import Candidate
from gepf.coordinator.scene.scene import SceneView

WAYS = ("best", "nearest", "largest", "moving")


@dataclass(frozen=True, slots=True, eq=False)
class Scope:
    """The part of the frames that is used, the person who is meant, and the room without people.

    near, far: metres; None for no limit.
    region: left, top, right and bottom in pixels, half-open; None for the whole image.
    person: One of WAYS, or a pixel of the person, column and row.
    background: depth (H, W) in metres, 0 if unknown; None to learn all of it.
    up: Unit vector (3,) away from the ground, rig's frame, if the recording or the user gives it.
    camera: The camera of a rig in which region, pixel and background are given.
    """

    near: float | None = None
    far: float | None = None
    region: tuple[int, int, int, int] | None = None
    person: str | tuple[int, int] = "best"
    background: NDArray[np.float32] | None = None
    up: Array | None = None
    camera: str = ""

    def limit(self, view: View) -> tuple[View, Mask | None]:
        """The image with depth within the limits only; the excluded pixels (H, W), with or without depth.

        Without limits: the same image, and None.
        """
        if self.near is None and self.far is None and self.region is None:
            return view, None
        depth = view.metres()
        excluded = (depth > 0.0) & (depth < (self.near or 0.0))
        if self.far is not None:
            excluded |= depth > self.far
        if self.region is not None:
            left, top, right, bottom = np.maximum(self.region, 0)
            outside = np.ones_like(excluded)
            outside[top:bottom, left:right] = False
            excluded |= outside
        return replace(view, depth=np.where(excluded, np.uint16(0), view.depth)), excluded

    def choose(self, view: SceneView, people: Sequence[Candidate]) -> list[Candidate]:
        """The candidates who may be meant, the most likely first."""

        def moved(candidate: Candidate) -> float:
            return float(np.mean(view.background[candidate.mask] > 0.0))

        if not isinstance(self.person, str):
            at = np.array(self.person)[::-1]
            return sorted(people, key=lambda who: np.linalg.norm(np.argwhere(who.widest) - at, axis=1).min())
        order: dict[str, Callable[[Candidate], float]] = {
            "best": lambda candidate: -candidate.score,
            "nearest": lambda candidate: float(np.median(candidate.points[:, 2])),
            "largest": lambda candidate: -float(np.sum(candidate.points[:, 2] ** 2)),
            "moving": lambda candidate: -moved(candidate),
        }
        least = view.settings.candidates.min_moved_share
        possible = [who for who in people if self.person != "moving" or moved(who) > least]
        return sorted(possible, key=order[self.person])

    def of(self, camera: str) -> Scope:
        """The scope of a camera of the rig; the user gives pixels of one."""
        if camera == self.camera:
            return self
        person = self.person if isinstance(self.person, str) else "best"
        return replace(self, region=None, person=person, background=None)

    def describe(self) -> dict[str, object]:
        """All fields by name as JSON values; the background as a hash."""
        empty = self.background
        return {
            "person": self.person if isinstance(self.person, str) else list(self.person),
            "near": self.near,
            "far": self.far,
            "roi": None if self.region is None else list(self.region),
            "background": None if empty is None else hashlib.sha256(empty.tobytes()).hexdigest()[:12],
            "up": None if self.up is None else self.up.tolist(),
        }
