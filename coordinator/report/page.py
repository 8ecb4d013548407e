"""A run as one self-contained HTML file."""

from __future__ import annotations

import base64
import io
import json
from itertools import chain
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, select_autoescape
from markupsafe import Markup
from matplotlib.figure import Figure

from coordinator.bodies.angles import is_person
from coordinator.files import FILM_FILE, HYPOTHESES_FILE, SHEET_FILE, write_atomically
from coordinator.pictures.plots import angle_curves, plot_curves, styled
from coordinator.report.findings import describe_run, find_doubts, group_angles, list_ranges
from coordinator.results.configuration import flatten
from coordinator.results.summary import people_in, read_summary
from coordinator.results.track import read_track

PICTURES = (FILM_FILE, SHEET_FILE, HYPOTHESES_FILE)
MEDIA = {".png": "image/png", ".mp4": "video/mp4"}


def write_report(run: Path, out: Path) -> None:
    """Write the page about the run in this folder, with a section per person.

    InputError if it holds no finished run, or the page cannot be written.
    """
    people = [describe_person(folder) for folder in people_in(run) or [run]]
    summary = read_summary(run)
    environment = Environment(
        loader=PackageLoader("coordinator.report", "."),
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


def describe_person(folder: Path) -> dict[str, Any]:
    """The data of the page for one person."""
    track, summary = read_track(folder), read_summary(folder)
    parts = {group: angle_curves(track, members) for group, members in group_angles(track.angle_names)}
    return {
        "folder": folder,
        "person": is_person(track.dof_names),
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
