"""A run as one self-contained HTML file."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, select_autoescape
from markupsafe import Markup
from matplotlib.figure import Figure

from gepf.coordinator.bodies.families import family_of
from gepf.coordinator.files import FILM_FILE, HYPOTHESES_FILE, SHEET_FILE, write_atomically
from gepf.coordinator.pictures.plots import SIDES, Curve, angle_curves, plot_curves, styled
from gepf.coordinator.results.configuration import flatten
from gepf.coordinator.results.killed import finish_killed
from gepf.coordinator.results.summary import people_in, read_summary
from gepf.coordinator.results.tally import describe_status
from gepf.coordinator.results.track import Track, read_track, read_tracked_body

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
        *list_cameras(summary),
        ("seed", str(summary.get("seed"))),
        ("speed", f"{summary.get('frame_rate', 0.0):.1f} frames a second"),
        ("service", f"{workers} worker{'s' * (workers != 1)}, {sent} batches, {again} sent again"),
    ]


def list_cameras(summary: Summary) -> Iterator[tuple[str, str]]:
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
    """Name, limits, range, fastest change and median deviation of each curve in the known frames, as text."""
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
    shares = track.flagged.mean(axis=0)
    for j in np.argsort(-shares, kind="stable"):
        if shares[j] > 0.0:
            worst = int(chance[:, j].argmax())
            name = track.joint_names[j].replace("_", " ")
            where = f"most likely in frame {track.frame[worst]} ({chance[worst, j]:.0%})"
            yield "ambiguous", f"{name} may be more than 15 cm off in {shares[j]:.0%} of the frames, {where}"


PICTURES = (FILM_FILE, SHEET_FILE, HYPOTHESES_FILE)
MEDIA = {".png": "image/png", ".mp4": "video/mp4"}


def write_report(run: Path, out: Path) -> None:
    """Write the page about the run in this folder, with a section per person.

    InputError if it holds no finished run, or the page cannot be written.
    """
    finish_killed(run)
    people = [section_of(folder) for folder in people_in(run) or [run]]
    summary = read_summary(run)
    environment = Environment(
        loader=PackageLoader("gepf.coordinator.report", "."),
        autoescape=select_autoescape(default=True),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.get_template("page.html.j2").render(
        title=summary.get("sequence", run.name),
        people=people,
        summary=summary,
        stages=summary.get("time_per_stage", {}),
        settings=[(name, str(value)) for name, value in flatten(summary.get("settings", {}))],
        whole=json.dumps(summary, indent=2),
    )
    write_atomically(out, lambda opened: opened.write(page.encode()))


def section_of(folder: Path) -> dict[str, Any]:
    """The data of the page for one person."""
    track, summary = read_track(folder), read_summary(folder)
    parts = {group: angle_curves(track, members) for group, members in group_angles(track.angle_names)}
    return {
        "folder": folder,
        "zero": family_of(read_tracked_body(folder).model).zero,
        "facts": describe_run(track, summary),
        "doubts": list(find_doubts(track)),
        "ranges": list(list_ranges(track, chain.from_iterable(parts.values()))),
        "pictures": {name: embed(folder / name) for name in PICTURES},
        "plots": [(part, as_svg(plot_curves(track, curves))) for part, curves in parts.items()],
    }


def as_svg(figure: Figure) -> Markup:
    """A figure as an SVG element."""
    text = io.StringIO()
    with styled():
        figure.savefig(text, format="svg", metadata={"Date": None})
    return Markup(text.getvalue()[text.getvalue().index("<svg") :])


def embed(picture: Path) -> str | None:
    """A picture as a data URL; None if there is none."""
    if not picture.is_file():
        return None
    return f"data:{MEDIA[picture.suffix]};base64,{base64.b64encode(picture.read_bytes()).decode()}"
