"""`gepf info`: facts about a sequence and its scene, and pictures of them."""

from __future__ import annotations

import logging
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from PIL import Image

from common.errors import InputError
from common.frame import DepthFrame
from coordinator.commands.console import ended_at_once
from coordinator.sources import Format, Source, find_format
from coordinator.sources.camera import CameraOptions, doubt_camera, doubt_range

if TYPE_CHECKING:
    from coordinator.scene.candidates import Candidate
    from coordinator.scene.room import SceneView

logger = logging.getLogger(__name__)

SAMPLED = 10  # frames, evenly spread, from which the range of depth is read
LOOKED_AT = 60  # frames from the first on, among which the first with a person is looked for
PROMISING = 0.25  # score from which on a candidate is likely a person


@dataclass(frozen=True, slots=True)
class Pictures:
    """Files to draw into: a frame as it is, and one with what is found in its scene."""

    thumbnail: Path | None = None
    scene: Path | None = None


def run_info(sequence: Path, given: CameraOptions, pictures: Pictures, *, as_json: bool) -> None:
    """Print facts about a sequence and its scene, and draw frames of it into files.

    What the recording says of itself is printed at once; to look at the scene takes longer.
    """
    form = find_format(sequence)
    source = form.open(sequence, given)
    facts, middle = describe(form, source)
    if not as_json:
        print_facts(facts)
    if pictures.thumbnail is not None:
        save(thumbnail(middle), pictures.thumbnail)
    scene = describe_room(source, pictures.scene)
    if as_json:
        sys.stdout.write(msgspec.json.encode(facts | scene).decode() + "\n")
        return
    print_facts(scene)


def describe_room(source: Source, picture: Path | None) -> dict[str, object]:
    """Facts about a sequence's scene by name, drawn into a picture if one is wanted."""
    with ended_at_once():
        view, found = look(source)
    if picture is not None:
        from coordinator.pictures.scene import draw_scene

        save(draw_scene(view, found), picture)
    return describe_scene(view, found)


def look(source: Source) -> tuple[SceneView, list[Candidate]]:
    """The first frame that shows a person, and who may be one there, likeliest first.

    Where no frame shows a likely person, the frame with the likeliest; without any, the last.
    """
    from coordinator.scene.candidates import candidates
    from coordinator.scene.scene import Scene

    scene = Scene(up=None if source.gravity is None else -source.gravity)
    doubtful: tuple[SceneView, list[Candidate]] | None = None
    for number in source.numbers[:LOOKED_AT]:
        view = scene.see(source.frame(number))
        found = candidates(view)
        if found and found[0].score > PROMISING:
            return view, [each for each in found if each.score > PROMISING]
        if found and (doubtful is None or found[0].score > doubtful[1][0].score):
            doubtful = view, found[:1]
        scene.learn(view, None)
    return doubtful or (view, [])


def describe_scene(view: SceneView, found: list[Candidate]) -> dict[str, object]:
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
            describe_candidate(each, likely=n == 0 and each.score > PROMISING) for n, each in enumerate(found)
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


def print_facts(facts: Mapping[str, object]) -> None:
    """A line for each fact; for a list of things, one for each of them."""
    for name, value in facts.items():
        for number, line in enumerate(in_words(value)):
            sys.stdout.write(f"{name if number == 0 else '':<15} {line}\n")
    sys.stdout.flush()


def in_words(value: object) -> list[str]:
    """A fact as a person reads it: a line, or one for each thing of several."""
    if isinstance(value, list) and value and isinstance(value[0], Mapping):
        return [in_a_word(each) for each in value]
    return [in_a_word(value)]


def in_a_word(value: object) -> str:
    """A single fact."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {in_a_word(each)}" for name, each in value.items())
    if isinstance(value, list):
        return " ".join(map(str, value)) or "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "unknown" if value is None else str(value)


def save(picture: Image.Image, path: Path) -> None:
    """Write a PNG; InputError where that cannot be."""
    try:
        picture.save(path, "PNG")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}; choose another file") from error


def describe(form: Format, source: Source) -> tuple[dict[str, object], DepthFrame]:
    """Facts about a sequence by name, and its frame in the middle. Raises InputError."""
    camera = source.intrinsics
    near, far = depth_range(source)
    for doubt in (doubt_camera(camera), doubt_range(near, far)):
        if doubt is not None:
            logger.warning("%s: %s", source.name, doubt)
    facts: dict[str, object] = {
        "format": form.name,
        "frames": len(source),
        "first_frame": source.numbers[0],
        "fps": round(source.fps, 3),
        "width": camera.width,
        "height": camera.height,
        "intrinsics": {"fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy},
        "gravity": None if source.gravity is None else [round(g, 4) for g in source.gravity.tolist()],
        "nearest_m": near,
        "farthest_m": far,
        "truth": source.truth is not None,
        "init": source.init is not None,
    }
    return facts, source.frame(source.numbers[len(source) // 2])


def depth_range(source: Source) -> tuple[float | None, float | None]:
    """Nearest and farthest depth in metres, None where nothing was measured."""
    chosen = np.unique(np.linspace(0, len(source) - 1, SAMPLED).astype(int)).tolist()
    depths = [source.frame(source.numbers[n]).metres() for n in chosen]
    seen = np.concatenate([depth[depth > 0] for depth in depths])
    return (round(float(seen.min()), 4), round(float(seen.max()), 4)) if len(seen) else (None, None)


def thumbnail(frame: DepthFrame) -> Image.Image:
    """A frame as a person likes to see depth."""
    from coordinator.pictures.shading import shade_depth

    return shade_depth(frame.metres(), frame.intrinsics)
