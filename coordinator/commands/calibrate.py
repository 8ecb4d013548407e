"""`gepf calibrate`: the poses and clocks of cameras, from recordings of one person, as a rig file."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gepf.common.bounds import MAX_CAMERAS
from gepf.common.errors import InputError
from gepf.coordinator.bodies.choice import choose_bodies
from gepf.coordinator.bodies.human.dofs import HUMAN
from gepf.coordinator.calibration.extrinsics import read_poses
from gepf.coordinator.calibration.rig import CameraPose, calibrate
from gepf.coordinator.commands.options import CalibrateOptions
from gepf.coordinator.commands.progress import Show
from gepf.coordinator.files import require_new, with_parent
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.zenoh_refiner import Connect
from gepf.coordinator.settings import preset
from gepf.coordinator.sources import Source, open_source
from gepf.coordinator.sources.rig import RigCamera, find_fault, write_rig


def run_calibrate(options: CalibrateOptions, show: Show, connect: Connect) -> None:
    """Write the rig file, and print a line for each camera.

    Raises InputError for wrong input, and if the recordings do not determine a pose.
    """
    sequences, given, out = options.sequences, options.given, options.out
    require_new(out, force=options.force)
    with_parent(out)
    sources = open_all(sequences)
    if given is not None:
        found = {name: CameraPose(*pose, 0.0) for name, pose in read_poses(given, list(sources)).items()}
    else:
        with connect(Pool(), show.say) as workers:
            found = calibrate(
                sources, workers, preset("default"), choose_bodies(None, "default", HUMAN), show.say
            )
    cameras, deviations = list[RigCamera](), dict[str, object]()
    for (name, pose), sequence in zip(found.items(), sequences, strict=True):
        path = os.path.relpath(sequence.resolve(), out.resolve().parent)
        cameras.append(RigCamera(name, path, pose.T_first_other.tolist(), pose.offset_s))
        if (wrong := find_fault(cameras[-1])) is not None:
            raise InputError(f"{given}: {wrong}")
        if np.isfinite(pose.deviations).all():
            deviations[name] = {
                "rotation_deg": np.degrees(pose.deviations[:3]).round(4).tolist(),
                "position_at_person_m": pose.deviations[3:6].round(5).tolist(),
                "time_offset_s": round(float(pose.deviations[6]), 6),
            }
    write_rig(out, cameras, deviations)
    for name, pose in list(found.items())[1:]:
        sys.stdout.write(f"{name}: {describe_pose(pose)}\n")
    show.say(f"the rig is in {out}; gepf track {out} --out run/ tracks with all cameras")


def open_all(sequences: Sequence[Path]) -> dict[str, Source]:
    """The recordings by name; InputError unless they are two or more different recordings."""
    if not 2 <= len(sequences) <= MAX_CAMERAS:
        raise InputError(f"{len(sequences)} recordings are given; give 2 to {MAX_CAMERAS}, one per camera")
    if len({path.resolve() for path in sequences}) < len(sequences):
        raise InputError("the same recording is given twice; give one recording per camera")
    sources, found = [open_source(path) for path in sequences], dict[str, Source]()
    names = [source.name for source in sources]
    for n, source in enumerate(sources, 1):
        if len(source.views) > 1:
            raise InputError(f"{source.name} is a rig already; give the recordings of single cameras")
        found[source.name if names.count(source.name) == 1 else f"camera{n}"] = source
    return found


def describe_pose(pose: CameraPose) -> str:
    """A pose in one line, with its deviations if they are known."""
    rotation, position = pose.T_first_other[:3, :3], pose.T_first_other[:3, 3]
    away = float(np.linalg.norm(position))
    turn = float(np.degrees(np.arccos(np.clip((np.trace(rotation) - 1.0) / 2.0, -1.0, 1.0))))
    clock = 1000.0 * pose.offset_s
    text = f"{away:.3f} m from the first camera, turned by {turn:.1f} deg, clock {clock:+.1f} ms"
    spread = pose.deviations
    if not np.isfinite(spread).all():
        return text
    angle, metres = np.degrees(spread[:3].max()), 100.0 * spread[3:6].max()
    text += f"; deviations {angle:.2f} deg, {metres:.1f} cm at the person, {1000.0 * spread[6]:.1f} ms"
    return f"{text}; to reduce them, {pose.advice}"
