"""Whether somebody else stands near a body: then what the body does not explain may be that person's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coordinator.scene.nearness import surround
from coordinator.scene.people.candidates import Candidate, candidates
from coordinator.scene.sharing import within
from coordinator.scene.view import SceneView

Array = NDArray[np.float64]

EXPLAINED = 0.12  # metres from a posed body in which nobody else is looked for
TALL, SEEN = 1.0, 1_000  # metres and pixels of somebody else, at the least
NEAR = 0.5  # metres from the body's box, in contact or about to be


def has_company(view: SceneView, surface: Array) -> bool:
    """Whether a frame shows somebody else near a posed body's points (V, 3), metres."""
    if not view.furnished:
        return False
    known = within(view, [surround(surface)], EXPLAINED)
    box = np.array([surface.min(axis=0) - NEAR, surface.max(axis=0) + NEAR])
    return any(is_near(each, box) for each in candidates(view, known))


def is_near(candidate: Candidate, box: Array) -> bool:
    """Whether somebody who is large enough is partly inside of a box (2, 3)."""
    size = candidate.box[1] - candidate.box[0]
    inside = np.all((candidate.points >= box[0]) & (candidate.points <= box[1]), axis=1)
    return bool(size.max() >= TALL and len(candidate.points) >= SEEN and inside.any())
