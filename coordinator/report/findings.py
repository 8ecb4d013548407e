"""The findings of a report: what happened, the ranges of angles, and doubtful frames and joints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from coordinator.pictures.plots import SIDES, Curve
from coordinator.results.summary import describe_status
from coordinator.results.track import Track
from coordinator.tracking.certainty.certainty import FLAGGED

Summary = dict[str, Any]


def describe_run(track: Track, summary: Summary) -> list[tuple[str, str]]:
    """The main facts about a run: names and values."""
    model = summary.get("model", {})
    stature = f", {model['stature_m']:.2f} m tall" if model.get("stature_m") else ""
    method, preset, particles = (summary.get(key) for key in ("method", "preset", "particles"))
    workers = len(summary.get("workers_seen", []))
    sent, again = summary.get("batches_sent", 0), summary.get("batches_sent_again", 0)
    return [
        ("frames", f"{len(track.frame)} in {np.ptp(track.time_s):.1f} s"),
        ("status", describe_status(track.status)),
        ("body", f"{model.get('name', 'unknown')}{stature}, {len(track.dof_names)} degrees of freedom"),
        ("method", f"{method}, preset {preset}, particles: {particles}"),
        *describe_cameras(summary),
        ("seed", str(summary.get("seed"))),
        ("speed", f"{summary.get('frame_rate', 0.0):.1f} frames a second"),
        ("service", f"{workers} worker{'s' * (workers != 1)}, {sent} batches, {again} sent again"),
    ]


def describe_cameras(summary: Summary) -> Iterator[tuple[str, str]]:
    """What each camera of a rig contributed, and its faults: names and texts."""
    for name, facts in summary.get("cameras", {}).items():
        faults = (f"; {f['fault']} from {f['from_s']:.1f} to {f['to_s']:.1f} s" for f in facts["faults"])
        yield f"camera {name}", f"shows the body in {facts['frames_shown']} frames" + "".join(faults)


def group_angles(names: tuple[str, ...]) -> list[tuple[str, tuple[str, ...]]]:
    """Angles of the trunk, or of a robot; then those of a person's limbs, right and left together."""
    motions = dict.fromkeys(name.partition("_")[2] for name in names if name.startswith(SIDES))
    limbs = tuple(name for motion in motions for side in SIDES if (name := side + motion) in names)
    others = tuple(name for name in names if name not in limbs)
    return [group for group in (("trunk" if limbs else "joints", others), ("limbs", limbs)) if group[1]]


def list_ranges(track: Track, curves: Iterable[Curve]) -> Iterator[tuple[str, ...]]:
    """Name, ends, range, fastest change and median deviation of each curve over the known frames, as text."""
    known = ~track.unknown
    if not known.any():
        return
    steps = np.maximum(np.diff(track.time_s[known]), 1e-9)
    for curve in curves:
        value, deviation = curve.reported[known], np.median(np.asarray(curve.deviation)[known])
        fastest = (np.abs(np.diff(value)) / steps).max(initial=0.0)
        numbers = (value.min(), value.max(), np.ptp(value), fastest, deviation)
        least, greatest, reach, speed, off = (f"{number:.0f}°" for number in numbers)
        yield curve.name.replace("_", " "), f"{least} … {greatest}", reach, f"{speed}/s", off


def find_doubts(track: Track) -> Iterator[tuple[str, str]]:
    """Doubtful frames and joints: a status, which gives the colour, and a text.

    First all frames that are not `tracked`, in order; then joints with a probable error above 15 cm in some
    frames, the most often flagged first.
    """
    for status, first, last in track.stretches():
        if status != "tracked":
            times, frames = (values[sorted({first, last})] for values in (track.time_s, track.frame))
            when = " to ".join(f"{time_s:.2f}" for time_s in times)
            which = " to ".join(map(str, frames))
            yield status, f"{when} s (frame{'s' * (len(frames) - 1)} {which}): {status}"
    chance = np.nan_to_num(track.joint_off_probability)
    shares = (chance > FLAGGED).mean(axis=0)
    for j in np.argsort(-shares, kind="stable"):
        if shares[j] > 0.0:
            worst = int(chance[:, j].argmax())
            name = track.joint_names[j].replace("_", " ")
            where = f"most likely in frame {track.frame[worst]} ({chance[worst, j]:.0%})"
            yield "ambiguous", f"{name} may be more than 15 cm off in {shares[j]:.0%} of the frames, {where}"
