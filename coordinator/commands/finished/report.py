"""`gepf report`: a page about a run, in its folder or where it is wanted."""

from __future__ import annotations

from pathlib import Path

from coordinator.commands.console.loading import loading
from coordinator.commands.console.progress import Show
from coordinator.results.summary import people_in
from coordinator.results.track import read_track

REPORT_FILE = "report.html"


def run_report(run: Path, out: Path | None, show: Show) -> None:
    """Write the page. Raises InputError if the folder holds no finished run."""
    page = out or run / REPORT_FILE
    people = people_in(run)
    if people:
        with loading(show, f"writing {page}"):
            from coordinator.report.page import write_people_report
        write_people_report(run, people, page)
        show.say(f"the report is in {page}, with one of each person in its folder")
        return
    read_track(run)
    with loading(show, f"writing {page}"):
        from coordinator.report import write_report
    write_report(run, page)
    show.say(f"the report is in {page}")
