"""What `gepf track` would find in a sequence's scene, as `gepf info` reports it."""

from __future__ import annotations

import numpy as np

from coordinator.scene.people.candidates import Candidate, candidates
from coordinator.scene.scene import Scene
from coordinator.scene.view import SceneView
from coordinator.sources import Source

LOOKED_AT = 60  # frames from the first on, among which the first with a person is looked for
PROMISING = 0.25  # score from which on a candidate is likely a person


def look(source: Source, promising: float = PROMISING) -> tuple[SceneView, list[Candidate]]:
    """The first frame that shows a person, and who may be one there, likeliest first.

    Where no frame shows a likely person, the frame with the likeliest; without any, the last.
    """
    scene = Scene(up=None if source.gravity is None else -source.gravity)
    doubtful: tuple[SceneView, list[Candidate]] | None = None
    for number in source.numbers[:LOOKED_AT]:
        view = scene.see(source.frame(number))
        found = candidates(view)
        if found and found[0].score > promising:
            return view, [each for each in found if each.score > promising]
        if found and (doubtful is None or found[0].score > doubtful[1][0].score):
            doubtful = view, found[:1]
        scene.learn(view, None)
    return doubtful or (view, [])


def describe_scene(
    view: SceneView, found: list[Candidate], promising: float = PROMISING
) -> dict[str, object]:
    """Facts by name: floor, walls and candidates."""
    height = view.floor_height
    walls = view.planes.coefficients[1 if view.planes.has_floor else 0 :]
    down = -view.up
    return {
        "frame_looked_at": view.number,
        "floor": None
        if height is None
        else {
            "camera_height_m": round(height, 3),
            "pitch_deg": round(float(np.degrees(np.arcsin(down[2]))), 1),
            "roll_deg": round(float(np.degrees(np.arcsin(down[0]))), 1),
        },
        "walls_m": [round(float(1.0 / np.linalg.norm(wall)), 2) for wall in walls],
        "room": view.furnished,
        "noise_mm": round(1000.0 * float(view.noise.sigma(np.array([2.0]))[0]), 1),
        "people": [
            describe_candidate(each, likely=n == 0 and each.score > promising) for n, each in enumerate(found)
        ],
    }


def describe_candidate(candidate: Candidate, *, likely: bool) -> dict[str, object]:
    """Where a candidate is, what it may be, and why."""
    rows, columns = np.nonzero(candidate.mask)
    return {
        "may_be": "a person" if likely else "a person or furniture",
        "pixel": [int(np.median(columns)), int(np.median(rows))],
        "distance_m": round(float(np.median(candidate.points[:, 2])), 2),
        "score": round(candidate.score, 2),
        "why": candidate.why,
    }
