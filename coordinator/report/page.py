"""A run as one HTML file that needs nothing else; of several people a page of all, and one of each."""

from __future__ import annotations

import base64
import io
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, select_autoescape
from markupsafe import Markup
from matplotlib.figure import Figure

from common.errors import InputError
from coordinator.files import (
    ANIMATION_FILE,
    ERRORS_FILE,
    FILM_FILE,
    HYPOTHESES_FILE,
    SHEET_FILE,
    write_atomically,
)
from coordinator.pictures.plots import plot_angles, plot_slides, styled
from coordinator.report.findings import (
    are_a_persons,
    describe_run,
    describe_stages,
    describe_status,
    find_banner,
    find_doubts,
    find_flags,
    find_leaps,
    group_angles,
    list_ranges,
    list_slides,
)
from coordinator.results.angles import Slides, read_slides
from coordinator.results.configuration import flatten
from coordinator.results.summary import read_summary
from coordinator.results.track import Track, read_track, read_track_with_angles

PICTURES = (ANIMATION_FILE, FILM_FILE, SHEET_FILE, HYPOTHESES_FILE, ERRORS_FILE)
MEDIA = {".gif": "image/gif", ".png": "image/png", ".mp4": "video/mp4"}
PERSON_PAGE = "report.html"


def write_report(run: Path, out: Path, back: str | None = None) -> None:
    """Write the page about the run in this folder; InputError if it holds no finished run.

    The page of one of several people leads `back` to the page of all.
    """
    track, summary = read_track_with_angles(run), read_summary(run)
    sequence, slides = summary.get("sequence", run.name), read_slides(run, track)
    page = render(
        "page.html.j2",
        title=f"{sequence}: {run.name}" if back else sequence,
        back=back,
        folder=run,
        person=are_a_persons(track.angle_names or ()),
        summary=summary,
        facts=describe_run(track, summary),
        status=describe_status(track),
        banner=find_banner(track, summary),
        doubts=find_doubts(track),
        flags=find_flags(track),
        leaps=find_leaps(track),
        ranges=[*list_ranges(track), *list_slides(track, slides)],
        pictures={name: embed(run / name) for name in PICTURES},
        plots=plot(track, slides),
        slides=bool(slides.names),
        stages=describe_stages(summary),
        settings=[(name, str(value)) for name, value in flatten(summary.get("settings", {}))],
        whole=json.dumps(summary, indent=2),
    )
    write_page(page, out)


def write_people_report(run: Path, people: Sequence[Path], out: Path) -> None:
    """Write a page in each person's folder, and one about all that leads to them."""
    shown = []
    for folder in people:
        write_report(folder, folder / PERSON_PAGE, os.path.relpath(out, folder))
        track, summary = read_track(folder), read_summary(folder)
        shown.append(
            {
                "name": folder.name,
                "folder": folder,
                "page": os.path.relpath(folder / PERSON_PAGE, out.parent),
                "banner": find_banner(track, summary),
                "status": describe_status(track),
                "facts": describe_run(track, summary),
                "film": embed(folder / FILM_FILE),
                "picture": embed(folder / ANIMATION_FILE),
            }
        )
    whole = read_summary(run)
    title, text = whole.get("sequence", run.name), json.dumps(whole, indent=2)
    write_page(render("people.html.j2", title=title, summary=whole, people=shown, whole=text), out)


def render(template: str, **content: Any) -> str:
    """The text of a page, from one of the templates beside this file."""
    environment = Environment(
        loader=PackageLoader("coordinator.report", "."),
        autoescape=select_autoescape(default=True),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(content)


def write_page(page: str, out: Path) -> None:
    """Write a page's text; InputError if that cannot be done."""
    try:
        write_atomically(out, lambda opened: opened.write(page.encode()))
    except OSError as error:
        raise InputError(f"cannot write {out} ({error.strerror}); give a writable file with --out") from None


def plot(track: Track, slides: Slides) -> list[tuple[str, Markup]]:
    """A drawing of the angles of each part of the body, with its name, and one of the sliding joints."""
    groups = group_angles(track.angle_names or ())
    plots = [(group, as_svg(plot_angles(track, members))) for group, members in groups]
    return plots + ([("sliding joints", as_svg(plot_slides(track, slides)))] if slides.names else [])


def as_svg(figure: Figure) -> Markup:
    """A figure as an element of a page."""
    text = io.StringIO()
    with styled():
        figure.savefig(text, format="svg", metadata={"Date": None})
    return Markup(text.getvalue()[text.getvalue().index("<svg") :])


def embed(picture: Path) -> str | None:
    """A picture as an address that holds all of it; None where there is none."""
    if not picture.is_file():
        return None
    return f"data:{MEDIA[picture.suffix]};base64,{base64.b64encode(picture.read_bytes()).decode()}"
