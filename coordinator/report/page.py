"""Several people of one recording on one page, with a page of each beside it."""

from __future__ import annotations

import base64
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, Template, select_autoescape

from common.errors import InputError
from coordinator.files import (
    ANIMATION_FILE,
    ERRORS_FILE,
    FILM_FILE,
    HYPOTHESES_FILE,
    SHEET_FILE,
    write_atomically,
)
from coordinator.report.angles import draw_angles, draw_slides
from coordinator.report.findings import (
    are_a_persons,
    describe_run,
    describe_stages,
    describe_status,
    find_banner,
    find_doubts,
    find_flags,
    find_leaps,
    list_ranges,
    list_settings,
    list_slides,
)
from coordinator.results.angles import read_slides
from coordinator.results.summary import read_summary
from coordinator.results.track import Track, read_track, read_track_with_angles

PICTURES = (ANIMATION_FILE, FILM_FILE, SHEET_FILE, HYPOTHESES_FILE, ERRORS_FILE)
MEDIA = {".gif": "image/gif", ".png": "image/png", ".mp4": "video/mp4"}


def write_report(run: Path, out: Path, back: str | None = None) -> None:
    """Write the page about the run in this folder; InputError if it holds no finished run.

    Of one of several people it leads `back` to the page of all.
    """
    track = read_track_with_angles(run)
    write_page(render(run, track, read_summary(run), back), out)


def write_page(page: str, out: Path) -> None:
    """Write a page's text; InputError if that cannot be done."""
    try:
        write_atomically(out, lambda opened: opened.write(page.encode()))
    except OSError as error:
        raise InputError(f"cannot write {out} ({error.strerror}); give a writable file with --out") from None


def template(name: str) -> Template:
    """One of the templates that stand beside this file."""
    environment = Environment(
        loader=PackageLoader("coordinator.report", "."),
        autoescape=select_autoescape(default=True),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(name)


def render(run: Path, track: Track, summary: dict[str, Any], back: str | None = None) -> str:
    """The page's text."""
    sequence, slides = summary.get("sequence", run.name), read_slides(run, track)
    return template("page.html.j2").render(
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
        angles=[*draw_angles(track), *draw_slides(track, slides)],
        slides=bool(slides.names),
        stages=describe_stages(summary),
        settings=list_settings(summary.get("settings", {})),
        whole=json.dumps(summary, indent=2),
    )


def embed(picture: Path) -> str | None:
    """A picture as the address that holds it whole; None where there is none."""
    if not picture.is_file():
        return None
    return f"data:{MEDIA[picture.suffix]};base64,{base64.b64encode(picture.read_bytes()).decode()}"


PERSON_PAGE = "report.html"


def write_people_report(run: Path, people: Sequence[Path], out: Path) -> None:
    """Write a page in each person's folder, and one about all that leads to them."""
    for person in people:
        write_report(person, person / PERSON_PAGE, os.path.relpath(out, person))
    summary = read_summary(run)
    shown = [show_person(person, out) for person in people]
    page = template("people.html.j2").render(
        title=summary.get("sequence", run.name),
        summary=summary,
        people=shown,
        whole=json.dumps(summary, indent=2),
    )
    write_page(page, out)


def show_person(person: Path, out: Path) -> dict[str, object]:
    """What the page of all says about one."""
    track, summary = read_track(person), read_summary(person)
    return {
        "name": person.name,
        "folder": person,
        "page": os.path.relpath(person / PERSON_PAGE, out.parent),
        "banner": find_banner(track, summary),
        "status": describe_status(track),
        "facts": describe_run(track, summary),
        "film": embed(person / FILM_FILE),
        "picture": embed(person / ANIMATION_FILE),
    }
