"""`gepf init`: a start file from joint values, shown over the first frame, and refined on it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from common.body import ROOT_DOFS, ROTATION, BodyModel
from common.errors import InputError
from common.frame import DepthFrame, SubjectFrame
from common.settings import RefineSettings
from coordinator.bodies.choice import choose_bodies, choose_model
from coordinator.bodies.tracked import Bodies, pose_by_name
from coordinator.commands.console import end_as_interrupted
from coordinator.commands.job import choose_dofs, choose_pool, choose_settings
from coordinator.commands.options import InitOptions
from coordinator.commands.progress import Show
from coordinator.commands.workers import Connect
from coordinator.files import require_new, write_atomically
from coordinator.pictures.film import tile, whole_view
from coordinator.pictures.overlay import Painter, Shown
from coordinator.pictures.run import opengl_fault
from coordinator.sources import open_source
from coordinator.sources.camera import parse_camera_options
from coordinator.sources.source import select_frames
from coordinator.tracking.gating import Gate, gate_pose
from coordinator.tracking.observing.sensor_noise import assume_noise, measure_noise
from coordinator.tracking.placing import FACING_DEG, ROUNDS, YAWS_DEG, place
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.segmenter import PosedBody, Segmenter
from coordinator.tracking.state import given_start, read_start, require_known

Array = NDArray[np.float64]

PRESET = "default"


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A pose (D,) on a frame: its mean residual, metres, and whether it can be believed."""

    pose: Array
    residual: float
    gate: Gate


def run_init(options: InitOptions, show: Show, connect: Connect) -> None:
    """Write the start file and its picture. InputError for options that make no sense, before all else."""
    picture = options.picture or options.out.with_suffix(".png")
    for path in (options.out, picture):
        require_new(path, force=options.force)
    bodies = choose_bodies(choose_dofs(options.dof), PRESET, choose_model(options.model))
    values = read_values(options.init, options.values or (), bodies)
    source = open_source(
        options.sequence, parse_camera_options(options.camera.intrinsics, options.camera.depth_scale)
    )
    frame = source.frame(select_frames(source.numbers, options.frames)[0])
    end_as_interrupted()
    with connect(choose_pool(options.workers, None, None), show) as refiner:
        values, before, after = settle(values, bodies, frame, refiner, refine=options.refine)
    start = given_start(values, bodies)
    written = {**values, **pose_by_name(start.model, after.pose)}
    write_atomically(options.out, lambda file: file.write(encode(written)))
    draw(frame, start.model, {"as given": before, "refined": after}, picture)
    for line in describe(start.model, before, after):
        show.say(line)
    show.say(f"the start is in {options.out}, drawn in {picture}; track with --init {options.out}")
    if not after.gate.passes:
        show.warn(f"{after.gate.why}: look at {picture}, and give other values with --set")


def read_values(init: Path | None, settings: Sequence[str], bodies: Bodies) -> dict[str, float]:
    """Values by name in radians and metres: of a file, and those of NAME=VALUE, degrees and metres."""
    values = dict(read_start(init, bodies.dof_names)) if init else {}
    full = bodies.full(*(bodies.measures or (1.75, 1.0)))
    for text in settings:
        name, equals, number = text.partition("=")
        require_known(name.strip(), bodies.dof_names, "--set")
        turns = full.kinds[full.dof(name.strip())] == ROTATION
        try:
            value = float(number) if equals else np.nan
        except ValueError:
            value = np.nan
        if not np.isfinite(value):
            unit = "degrees" if turns else "metres"
            raise InputError(f"--set {text} is not of the form NAME=NUMBER; write {name}=30, in {unit}")
        values[name.strip()] = float(np.radians(value)) if turns else value
    return values


def settle(
    values: Mapping[str, float], bodies: Bodies, frame: DepthFrame, refiner: Refiner, *, refine: bool
) -> tuple[dict[str, float], Fitted, Fitted]:
    """Values with the base placed, if it was not given; how they fit the frame, and how after a descent."""
    settings = choose_settings("gepf", PRESET, None, None, 0)
    rules = assume_noise(settings.refine, measure_noise(frame))
    placed = dict(values)
    if not any(name in values for name in ROOT_DOFS[:3]):
        found = Segmenter(settings.points).segment(frame, [None]).candidates
        subject = require_seen(found[0] if found else None, frame)
        refiner.publish(subject)
        full = bodies.full(*(bodies.measures or (1.75, 1.0)))
        yaws_deg = FACING_DEG if bodies.people else YAWS_DEG
        placed |= place(full, values, subject, refiner, rules, yaws_deg)
    start = given_start(placed, bodies)
    body = PosedBody(start.model, start.pose)
    segmented = Segmenter(settings.points).segment(frame, [body])
    refiner.publish(require_seen(segmented.subjects[0], frame))
    before = descend(start.model, start.pose, refiner, rules, 0)
    return placed, before, descend(start.model, start.pose, refiner, rules, ROUNDS if refine else 0)


def require_seen(subject: SubjectFrame | None, frame: DepthFrame) -> SubjectFrame:
    """The subject; InputError where nothing is seen."""
    if subject is None or not len(subject.picked):
        raise InputError(
            f"frame {frame.number} shows nothing there; choose another with --frames, or say where the body "
            "is with --set root_tx=..., root_ty, root_tz in metres from the camera"
        )
    return subject


def descend(model: BodyModel, pose: Array, refiner: Refiner, rules: RefineSettings, rounds: int) -> Fitted:
    """The pose after so many rounds of ICP on the published frame."""
    asked = msgspec.structs.replace(rules, icp_iterations=rounds)
    refined = refiner.submit(model, pose[None], asked).result()
    residual = float(refined.residual[0])
    return Fitted(refined.poses[0], residual, gate_pose(float(refined.log_likelihood[0]), residual, rules))


def encode(values: Mapping[str, float]) -> bytes:
    """The start file: what is not zero, radians and metres."""
    return (json.dumps({name: round(v, 6) for name, v in values.items() if v}, indent=2) + "\n").encode()


def draw(frame: DepthFrame, model: BodyModel, fitted: Mapping[str, Fitted], path: Path) -> None:
    """The body in each pose over the frame, side by side."""
    painter = Painter(model, whole_view(frame.intrinsics), opengl_fault() is None)
    try:
        pictures: list[Image.Image] = []
        for title, each in fitted.items():
            status = "tracked" if each.gate.passes else "lost"
            shown = Shown(each.pose, each.pose[None][:0], np.empty(0), status)
            pictures.append(painter.paint(frame, shown, title))
    finally:
        painter.close()
    write_atomically(path, lambda file: tile(pictures, len(pictures)).save(file, "PNG"))


def describe(model: BodyModel, before: Fitted, after: Fitted) -> list[str]:
    """What the descent changed, for people."""
    change = np.abs(after.pose - before.pose)
    turning = np.flatnonzero(model.kinds == ROTATION)
    most = turning[int(np.argmax(change[turning]))] if len(turning) else None
    line = f"mean residual {1000 * before.residual:.1f} mm as given, {1000 * after.residual:.1f} mm refined"
    if most is None or not change[most] > 0.0:
        return [line]
    return [f"{line}; {model.dof_names[most]} changed most, by {np.degrees(change[most]):.1f} degrees"]
