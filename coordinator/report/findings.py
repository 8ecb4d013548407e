"""The findings of a report: what happened, the ranges of angles, and doubtful frames and joints."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coordinator.results.angles import Slides
from coordinator.results.summary import describe_status
from coordinator.results.track import Track
from coordinator.tracking.certainty.certainty import FLAGGED

Array = NDArray[np.float64]
Summary = dict[str, Any]

TRUSTED_SHARE = 0.9  # of tracked frames; below it a run is reliable in part, below 0.5 not at all

SIDES = ("right_", "left_")


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
        *((f"camera {name}", text) for name, text in describe_cameras(track, summary)),
        ("seed", str(summary.get("seed"))),
        ("speed", f"{summary.get('frame_rate', 0.0):.1f} frames a second"),
        ("service", f"{workers} worker{'s' * (workers != 1)}, {sent} batches, {again} sent again"),
    ]


def describe_cameras(track: Track, summary: Summary) -> Iterator[tuple[str, str]]:
    """What each camera of a rig contributed, and its faults: names and texts."""
    names, shares = track.camera_names or (), track.joint_seen_by
    for name, seen in zip(names, () if shares is None else np.swapaxes(shares, 0, 1), strict=True):
        facts = summary.get("cameras", {}).get(name, {})
        frames = int(np.sum(np.any(seen > 0.0, axis=1)))
        text = f"shows the body in {frames} frames, {np.mean(seen):.0%} of the surface that faces it"
        faults = (
            f"; {f['fault']} from {f['from_s']:.1f} to {f['to_s']:.1f} s" for f in facts.get("faults", ())
        )
        yield name, text + "".join(faults)


def group_angles(names: tuple[str, ...]) -> list[tuple[str, tuple[str, ...]]]:
    """Angles of the trunk, or of a robot; then those of a person's limbs, right and left together."""
    motions = dict.fromkeys(name.partition("_")[2] for name in names if name.startswith(SIDES))
    limbs = tuple(name for motion in motions for side in SIDES if (name := side + motion) in names)
    others = tuple(name for name in names if name not in limbs)
    return [group for group in (("trunk" if limbs else "joints", others), ("limbs", limbs)) if group[1]]


@dataclass(frozen=True, slots=True)
class Range:
    """The range of an angle or a prismatic joint, in degrees or centimetres."""

    name: str
    unit: str
    form: str  # of a number
    least: float
    greatest: float
    fastest: float  # per second
    deviation: float  # one standard deviation, the median


def list_ranges(track: Track, slides: Slides) -> Iterator[Range]:
    """Ranges of all angles, in the order of the plots, and of prismatic joints, over the known frames."""
    known, names = ~track.unknown, track.angle_names
    if not known.any():
        return
    steps = np.maximum(np.diff(track.time_s[known]), 1e-9)

    def reach(name: str, unit: str, form: str, value: Array, deviation: Array) -> Range:
        fastest = (np.abs(np.diff(value[known])) / steps).max(initial=0.0)
        ends = value[known].min(), value[known].max(), fastest, np.median(deviation[known])
        return Range(name.replace("_", " "), unit, form, *map(float, ends))

    for name in (name for _, members in group_angles(names) for name in members):
        a = names.index(name)
        value, deviation = np.degrees(track.angle[:, a]), np.degrees(track.angle_deviation[:, a])
        yield reach(name, "°", "%.0f", value, deviation)
    for name, value, deviation in zip(slides.names, slides.value.T, slides.deviation.T, strict=True):
        yield reach(name, " cm", "%.1f", 100.0 * value, 100.0 * deviation)


def find_doubts(track: Track) -> Iterator[tuple[str, str]]:
    """Doubtful frames and joints: a status, which gives the colour, and a text.

    First all frames that are not `tracked`, in order; then joints with a probable error above 15 cm in some
    frames, the most often flagged first.
    """
    for status, first, last in track.stretches():
        if status != "tracked":
            frames, times = track.frame[[first, last]], track.time_s[[first, last]]
            text = f"{times[0]:.2f} s (frame {frames[0]}): {status}"
            if first < last:
                text = f"{times[0]:.2f} to {times[1]:.2f} s (frames {frames[0]} to {frames[1]}): {status}"
            yield status, text
    chance = np.nan_to_num(track.joint_off_probability)
    shares = (chance > FLAGGED).mean(axis=0)
    for j in np.argsort(-shares, kind="stable"):
        if shares[j] > 0.0:
            worst = int(chance[:, j].argmax())
            name = track.joint_names[j].replace("_", " ")
            where = f"most likely in frame {track.frame[worst]} ({chance[worst, j]:.0%})"
            yield "ambiguous", f"{name} may be more than 15 cm off in {shares[j]:.0%} of the frames, {where}"


def find_banner(track: Track, summary: Summary) -> tuple[str, str] | None:
    """A warning if a run is not reliable, completely or in part, and the status that gives its colour."""
    share = float(np.mean(track.status == "tracked")) if len(track.status) else 0.0
    if share < 0.5:
        why = f": {next(iter(summary['doubts']))}" if summary.get("doubts") else ""
        return "lost", f"Do not trust this run: {share:.0%} of its frames are tracked{why}."
    if share < TRUSTED_SHARE:
        return "ambiguous", f"Trust this run in parts: {share:.0%} of its frames are tracked."
    if not summary.get("complete", True):
        return "ambiguous", "This run ended before its last frame."
    return None
