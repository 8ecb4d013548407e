"""The scope of tracking: the part of the scene, the selected person, and the empty room."""

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

PERSON_CRITERIA = ("best", "nearest", "largest", "moving")


@dataclass(frozen=True, slots=True, eq=False)
class Scope:
    """The part of the frames that is used, the selected person, and the room without people.

    near, far: metres; None for no limit.
    region: left, top, right and bottom in pixels, half-open; None for the whole image.
    person: One of PERSON_CRITERIA, or a pixel of the person, column and row.
    background: depth (H, W) in metres, 0 if unknown; None to learn all of it.
    up: Unit vector (3,) away from the ground, rig frame, if the recording or the user gives it.
    camera: The camera of a rig to which region, pixel and background apply.
    """

    near: float | None = None
    far: float | None = None
    region: tuple[int, int, int, int] | None = None
    person: str | tuple[int, int] = "best"
    background: NDArray[np.float32] | None = None
    up: Array | None = None
    camera: str = ""

    def limit(self, view: View) -> tuple[View, Mask | None]:
        """The image with only the depth within the limits, and the mask (H, W) of excluded pixels.

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
        """The candidates for the selected person, the most likely first."""

        def moved_share(candidate: Candidate) -> float:
            return float(np.mean(view.background[candidate.mask] > 0.0))

        if not isinstance(self.person, str):
            pixel = np.array(self.person)[::-1]

            def distance(candidate: Candidate) -> float:
                return float(np.linalg.norm(np.argwhere(candidate.widest) - pixel, axis=1).min())

            return sorted(people, key=distance)
        order: dict[str, Callable[[Candidate], float]] = {
            "best": lambda candidate: -candidate.score,
            "nearest": lambda candidate: float(np.median(candidate.points[:, 2])),
            "largest": lambda candidate: -float(np.sum(candidate.points[:, 2] ** 2)),
            "moving": lambda candidate: -moved_share(candidate),
        }
        min_share = view.settings.candidates.min_moved_share
        possible = people
        if self.person == "moving":
            possible = [candidate for candidate in people if moved_share(candidate) > min_share]
        return sorted(possible, key=order[self.person])

    def of(self, camera: str) -> Scope:
        """The scope of a camera of the rig; the pixels given by the user apply to one camera only."""
        if camera == self.camera:
            return self
        person = self.person if isinstance(self.person, str) else "best"
        return replace(self, region=None, person=person, background=None)

    def describe(self) -> dict[str, object]:
        """The scope as JSON values; the region is named `roi`, and the background is a hash."""
        background = self.background
        digest = None if background is None else hashlib.sha256(background.tobytes()).hexdigest()[:12]
        return {
            "person": self.person if isinstance(self.person, str) else list(self.person),
            "near": self.near,
            "far": self.far,
            "roi": None if self.region is None else list(self.region),
            "background": digest,
            "up": None if self.up is None else self.up.tolist(),
        }
