"""Several people of one recording on one page, with a page of each beside it."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path

from coordinator.files.names import ANIMATION_FILE, FILM_FILE
from coordinator.report.doubts import find_banner
from coordinator.report.facts import describe_run, describe_status
from coordinator.report.page import embed, template, write_page, write_report
from coordinator.results.summary import read_summary
from coordinator.results.track import read_track

TEMPLATE, PAGE = "people.html.j2", "report.html"


def write_people_report(run: Path, people: Sequence[Path], out: Path) -> None:
    """Write a page in each person's folder, and one about all that leads to them."""
    for person in people:
        write_report(person, person / PAGE, os.path.relpath(out, person))
    summary = read_summary(run)
    shown = [show_person(person, out) for person in people]
    page = template(TEMPLATE).render(
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
        "page": os.path.relpath(person / PAGE, out.parent),
        "banner": find_banner(track, summary),
        "status": describe_status(track),
        "facts": describe_run(track, summary),
        "film": embed(person / FILM_FILE),
        "picture": embed(person / ANIMATION_FILE),
    }
