"""`gepf info`: facts about a sequence and its scene, and pictures of them."""

from __future__ import annotations

import logging
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from gepf.common.errors import InputError
from gepf.coordinator.bodies.human.measures import Measures
from gepf.coordinator.bodies.human.people import PEOPLE
from gepf.coordinator.commands.console import loading
from gepf.coordinator.commands.options import CameraOptions, InfoOptions
from gepf.coordinator.files import LOG_FILE
from gepf.coordinator.results.killed import finish_killed
from gepf.coordinator.results.summary import FOUND, PERSON_FILE, find_summary
from gepf.coordinator.results.track import read_track
from gepf.coordinator.sources import Format, Source, find_format, open_source
from gepf.coordinator.sources.doubts import find_doubts

if TYPE_CHECKING:
    from gepf.coordinator.scene.candidates import Candidate
    from gepf.coordinator.scene.scene import SceneView

logger = logging.getLogger(__name__)


class PersonSearch(msgspec.Struct, frozen=True):
    """How a recording is searched for a person."""

    max_frames: int = 60  #: that are searched, spread over the recording
    min_score: float = 0.25  #: above which a candidate is probably a person


SEARCH = PersonSearch()


def run_info(options: InfoOptions, camera: CameraOptions) -> None:
    """Print facts about a sequence and its scene; draw its middle frame, and the scene.

    Facts about the recording are printed first, because analysing the scene takes longer. For a rig, print
    the facts about each camera, and draw the first camera; for a run, print who was tracked.
    """
    sequence, as_json = options.sequence, options.as_json
    finish_killed(sequence)
    if (run := find_summary(sequence)) is not None:
        facts = describe_tracked(sequence, run)
        print_json(facts) if as_json else print_facts(facts)
        return
    try:
        form = find_format(sequence)
    except InputError:
        if (sequence / LOG_FILE).exists():
            read_track(sequence)  # raises InputError, as the run was interrupted
        raise
    source = open_source(sequence, camera.choose())
    cameras = []
    for each in source.views:
        turn = each.T_rig_camera[:3, :3]
        gravity = None if each.gravity is None else turn.T @ each.gravity
        alone = each.changed(gravity=gravity)  # with gravity in its own frame
        facts = describe_recording(form, alone)
        if not as_json:
            print_facts(facts)
        with loading():
            view, found = find_people(alone)
        if options.picture is not None and each is source.views[0]:
            from gepf.coordinator.pictures.film import save_png
            from gepf.coordinator.pictures.scene import draw_scene

            save_png(draw_scene(view, found), options.picture)
        scene = describe_scene(view, found)
        cameras.append(facts | scene)
        if not as_json:
            print_facts(scene)
    if as_json:
        print_json({"cameras": cameras} if len(source.views) > 1 else cameras[0])


def describe_tracked(run: Path, summary: Mapping[str, Any]) -> dict[str, object]:
    """Facts by name about the people of a run: their size in words, and the status of frames."""
    people = summary.get(FOUND) or [{**summary.get("model", {}), "status": summary.get("status", {})}]
    return {
        "frames": summary.get("frames"),
        "people": [
            {
                "size": Measures.of(one["stature_m"], one["girth"], one.get("age")).in_words(
                    one.get("stature_deviation_m", 0.0)
                )
                if one.get("girth")
                else None,
                "file": str(file) if (file := run / one.get("folder", "") / PERSON_FILE).exists() else None,
                "status": one["status"],
            }
            for one in people
        ],
    }


def find_people(source: Source) -> tuple[SceneView, list[Candidate]]:
    """The first examined frame with a likely person, and the likely people in it, the most likely first.

    The examined frames are spread over the whole recording. If none of them has a likely person, returns the
    last one, with its most likely candidate if there is any.
    """
    from gepf.coordinator.scene.candidates import find_candidates
    from gepf.coordinator.scene.scene import Scene
    from gepf.coordinator.settings import SceneSettings

    scene = Scene(SceneSettings(), up=None if source.gravity is None else -source.gravity)
    for number in source.numbers[:: math.ceil(len(source.numbers) / SEARCH.max_frames)]:
        view = scene.observe(source.view(number))
        found = find_candidates(view)
        likely = [each for each in found if each.score > SEARCH.min_score]
        if likely:
            return view, likely
        scene.learn(view, None)
    return view, found[:1]


def describe_scene(view: SceneView, found: list[Candidate]) -> dict[str, object]:
    """Facts by name: floor, walls and candidates."""
    planes = view.planes
    walls = planes.coefficients[1 if planes.has_floor else 0 :]
    down = -planes.up
    return {
        "frame_looked_at": view.number,
        "floor": None
        if not planes.has_floor
        else {
            "camera_height_m": round(planes.camera_height, 3),
            "pitch_deg": round(float(np.degrees(np.arcsin(down[2]))), 1),
            "roll_deg": round(float(np.degrees(np.arctan2(down[0], down[1]))), 1),
        },
        "walls_m": [round(float(1.0 / np.linalg.norm(wall)), 2) for wall in walls],
        "room": view.shows_room,
        "noise_mm": round(1000.0 * float(view.noise.sigma(np.array(2.0))), 1),
        "people": [
            {
                "may_be": "a person" if n == 0 and each.score > SEARCH.min_score else "a person or furniture",
                "pixel": [int(np.median(side)) for side in np.nonzero(each.mask)[::-1]],
                "distance_m": round(float(np.median(each.points[:, 2])), 2),
                "score": round(each.score, 2),
                "why": each.description,
            }
            for n, each in enumerate(found)
        ],
    }


def print_json(facts: Mapping[str, object]) -> None:
    """Print one JSON object."""
    sys.stdout.write(msgspec.json.encode(facts).decode() + "\n")


def print_facts(facts: Mapping[str, object]) -> None:
    """Print one line per fact; for a list, one line per item."""
    for name, value in facts.items():
        several = value if isinstance(value, list) and value and isinstance(value[0], Mapping) else [value]
        for number, each in enumerate(several):
            sys.stdout.write(f"{name if number == 0 else '':<15} {in_words(each)}\n")
    sys.stdout.flush()


def in_words(value: object) -> str:
    """A fact as text."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {in_words(each)}" for name, each in value.items())
    if isinstance(value, list):
        return " ".join(map(str, value)) or "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "unknown" if value is None else str(value)


def describe_place(source: Source) -> dict[str, object]:
    """Facts about a camera of a rig by name: where it is, the angle of its rotation, and its clock."""
    turned = np.degrees(np.arccos(np.clip(0.5 * (np.trace(source.T_rig_camera[:3, :3]) - 1.0), -1.0, 1.0)))
    return {
        "camera": source.camera,
        "position_m": source.T_rig_camera[:3, 3].round(3).tolist(),
        "turned_deg": round(float(turned), 1),
        "time_offset_s": source.offset_s,
    }


def describe_recording(form: Format, source: Source) -> dict[str, object]:
    """Facts about a sequence by name; its depth is that of ten frames. InputError for a damaged frame."""
    camera = source.intrinsics
    chosen = np.unique(np.linspace(0, len(source) - 1, 10).astype(int)).tolist()
    depths = [source.view(source.numbers[n]).metres() for n in chosen]
    seen = np.concatenate([depth[depth > 0] for depth in depths])
    near, far = (round(float(seen.min()), 4), round(float(seen.max()), 4)) if len(seen) else (None, None)
    for doubt in find_doubts(source, PEOPLE.nearest_m):
        logger.warning("%s: %s", source.name, doubt)
    return {
        **(describe_place(source) if source.camera else {}),
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
