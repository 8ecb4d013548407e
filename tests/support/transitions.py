"""The table of transitions of a track: the cases that are tested, and the table of docs/states.md.

`python -m tests.support.transitions` writes the table into the page.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace as with_fields
from pathlib import Path
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from gepf.coordinator.colour.clothes import Clothes, remember
from gepf.coordinator.filters.belief import USUAL_INTERVAL, Belief
from gepf.coordinator.settings import ColourSettings, TrackSettings
from gepf.coordinator.tracking.judgement import Gate
from gepf.coordinator.tracking.reporting import status_of
from gepf.coordinator.tracking.track_state import (
    Absent,
    Event,
    Found,
    FrameRefined,
    FrameSegmented,
    Instructions,
    Lost,
    NextSegmentation,
    Policy,
    SearchEnded,
    SearchGivenUp,
    Searching,
    Tracked,
    TrackState,
    step,
)

PAGE = Path(__file__).parents[2] / "docs" / "states.md"
START, END = "<!-- transitions: make with tests.support.transitions -->\n", "<!-- end -->\n"

LIMITS, COLOUR = TrackSettings(), ColourSettings()
POLICY = Policy(min_points=100, settings=LIMITS, colour=COLOUR)
NEVER_RECOVERS = POLICY._replace(recovers=False)

BELIEF = with_fields(Belief.at(np.array([0.5])), residual=np.array([0.01]), velocities=np.array([[1.0]]))
AFTER = with_fields(Belief.at(np.array([0.6])), residual=np.array([0.01]))
MOVED = Belief.at(np.array([0.7]))

NEW, AT_POSE = (NextSegmentation(BELIEF.reported, is_new=is_new) for is_new in (True, False))
ANYWHERE = NextSegmentation(None, is_new=False)

GIVEN = Found(belief=BELIEF, next_segmentation=NEW)
DETECTED = Found(belief=BELIEF, time_s=1.0, next_segmentation=NEW, place=np.zeros(3), detected_pixels=900)
RUNNING = Searching(searched_s=1.0, awaits_search=True)
TRACKED = Tracked(
    belief=BELIEF, time_s=1.0, next_segmentation=AT_POSE, check_clock_s=0.5, pixels=900, was_established=True
)
DUE = replace(TRACKED, check_clock_s=LIMITS.check_interval_s - 0.01)
UNSURE = replace(TRACKED, doubtful_s=LIMITS.check_interval_s - 0.01)
LOST = Lost(
    belief=BELIEF, time_s=1.0, next_segmentation=ANYWHERE, check_clock_s=0.5, pixels=900, was_established=True
)

INTERVAL_S = 1 / 32
NEXT_S, LATER_S = 1.0 + INTERVAL_S, 2.0
CANDIDATE = FrameSegmented(NEXT_S, pixels=900, points=500)
NOTHING, DARK = FrameSegmented(NEXT_S), FrameSegmented(NEXT_S, has_depth=False)
REASON = "everything visible of the body belongs to other bodies"
DUPLICATE = FrameSegmented(NEXT_S, is_duplicate=True)
FITS = FrameRefined(AFTER, Gate(0.8), pixels=800, time_s=NEXT_S)
AS_REFINED = {
    "belief": AFTER,
    "time_s": NEXT_S,
    "check_clock_s": 0.5 + INTERVAL_S,
    "normalised_residual": 0.8,
    "pixels": 800,
    "followed_s": INTERVAL_S,
}
DOUBTFUL = with_fields(FITS, gate=Gate(1.2, "doubt"))  # above the limit, but explained
WRONG = with_fields(FITS, gate=Gate(2.0, "wrong"))
ENDED, GIVEN_UP = SearchEnded(), SearchGivenUp()
RED, BLUE = Clothes((0.5, 0.5, 0.3), 20.0), Clothes((0.5, -0.2, -0.4), 20.0)


class Transition(NamedTuple):
    """One row: before, the event, the kind of state after it and the fields that change, instructions."""

    before: TrackState
    condition: str  # of the state before
    event: Event
    what: str  # the event in words
    kind: type[TrackState]
    changes: Mapping[str, object]
    instructions: Instructions
    policy: Policy = POLICY

    @property
    def ends_frame(self) -> bool:
        """Whether nothing is left to do in the frame, which is reported now."""
        return not isinstance(self.event, SearchEnded | SearchGivenUp) and "refine" not in self.instructions


TRANSITIONS = [
    Transition(Absent(), "", NOTHING, "nothing is seen", Absent, {}, ()),
    Transition(Absent(), "", FrameSegmented(NEXT_S, 50, 50), "too few points are seen", Absent, {}, ()),
    Transition(
        Absent(), "", CANDIDATE, "a candidate is seen",
        Searching, {"searched_s": NEXT_S, "awaits_search": True}, ("search",)
    ),
    Transition(Absent(), "", GIVEN_UP, "the search is given up", Absent, {}, ()),
    Transition(RUNNING, "a search runs", CANDIDATE, "a candidate is seen", Searching, {}, ()),
    Transition(
        RUNNING, "a search runs", NOTHING, "no candidate, but something is seen", Searching, {}, ()
    ),
    Transition(
        replace(RUNNING, searches=4, why="wrong"),
        "a search runs",
        DARK,
        "nothing is seen",
        Searching,
        {"searches": 1, "why": "", "visibility": "nothing"},
        (),
    ),
    Transition(
        RUNNING,
        "a search runs",
        SearchEnded(why="wrong"),
        "the search detects nothing",
        Searching,
        {"why": "wrong", "awaits_search": False},
        (),
    ),
    Transition(
        RUNNING,
        "a search runs",
        SearchEnded(DETECTED),
        "the search detects a body",
        Found,
        {name: getattr(DETECTED, name) for name in DETECTED.__struct_fields__},
        ("update the background",),
    ),
    Transition(RUNNING, "the first search runs", GIVEN_UP, "the search is given up", Absent, {}, ()),
    Transition(
        replace(RUNNING, searches=4),
        "a later search runs",
        GIVEN_UP,
        "the search is given up",
        Searching,
        {"searches": 3, "searched_s": -np.inf, "awaits_search": False},
        (),
    ),
    Transition(
        Searching(searched_s=1.0, why="wrong"),
        "no search is due",
        CANDIDATE,
        "a candidate is seen",
        Searching,
        {},
        (),
    ),
    Transition(
        Searching(searched_s=1.0, why="wrong"),
        "a search is due",
        with_fields(CANDIDATE, time_s=LATER_S),
        "a candidate is seen",
        Searching,
        {"searches": 2, "searched_s": LATER_S, "awaits_search": True},
        ("search",),
    ),
    Transition(
        Searching(searched_s=1.0, why="wrong"), "no search runs", NOTHING, "no candidate is seen", Absent, {},
        (),
    ),
    Transition(
        GIVEN, "the start pose was given", CANDIDATE, "the body is seen", Found, {}, ("refine",)
    ),
    Transition(
        GIVEN,
        "the start pose was given",
        NOTHING,
        "the body is not seen, but something is",
        Found,
        {"next_segmentation": None},
        (),
    ),
    Transition(
        GIVEN,
        "the start pose was given",
        DARK,
        "nothing is seen",
        Found,
        {"next_segmentation": None, "is_lost": True},
        (),
    ),
    Transition(
        DETECTED,
        "it was detected",
        with_fields(CANDIDATE, moved=MOVED),
        "the body is seen, moved since the detection",
        Found,
        {"belief": MOVED, "next_segmentation": MOVED.reported},
        ("refine",),
    ),
    Transition(
        DETECTED,
        "it was detected",
        NOTHING,
        "the body is not seen, but something is",
        Lost,
        {"visibility": "something"},
        (),
    ),
    Transition(
        DETECTED,
        "",
        FITS,
        "its pose is refined and explains the frame",
        Tracked,
        {
            "belief": AFTER,
            "time_s": NEXT_S,
            "check_clock_s": USUAL_INTERVAL,
            "normalised_residual": 0.8,
            "pixels": 800,
            "followed_s": USUAL_INTERVAL,
        },
        (),
    ),
    Transition(
        GIVEN,
        "",
        WRONG,
        "its pose is refined and does not explain the frame",
        Tracked,
        {
            "belief": AFTER,
            "time_s": NEXT_S,
            "check_clock_s": LIMITS.check_interval_s + USUAL_INTERVAL,
            "normalised_residual": 2.0,
            "why": "wrong",
            "unexplained_s": USUAL_INTERVAL,
        },
        (),
    ),
    Transition(
        replace(GIVEN, is_lost=True, next_segmentation=ANYWHERE),
        "nothing was seen at the start pose",
        DOUBTFUL,
        "its pose is refined and doubtful",
        Lost,
        {
            "belief": AFTER,
            "time_s": NEXT_S,
            "check_clock_s": LIMITS.check_interval_s + USUAL_INTERVAL,
            "normalised_residual": 1.2,
            "why": "doubt",
            "unexplained_s": USUAL_INTERVAL,
        },
        (),
    ),
    Transition(TRACKED, "", CANDIDATE, "the body is seen", Tracked, {}, ("refine",)),
    Transition(
        replace(TRACKED, check_clock_s=LIMITS.search_interval_s - 0.01),
        "detected 0.13 s earlier",
        CANDIDATE,
        "the body is seen",
        Tracked,
        {"awaits_search": True},
        ("search", "refine"),
    ),
    Transition(
        replace(DUE, normalised_residual=1.1),
        "a check is due, and the last pose was doubtful",
        CANDIDATE,
        "the body is seen",
        Tracked,
        {"awaits_search": True},
        ("search", "refine"),
    ),
    Transition(
        replace(DUE, ambiguous_facing=True),
        "a check is due, and the body may face the other way",
        CANDIDATE,
        "the body is seen",
        Tracked,
        {"awaits_search": True},
        ("search", "refine"),
    ),
    Transition(
        replace(DUE, ambiguous_facing=True, sides_s=COLOUR.facing_s),
        "a check is due, front and back look alike, but colour has told them apart",
        CANDIDATE,
        "the body is seen",
        Tracked,
        {},
        ("refine",),
    ),
    Transition(
        replace(DUE, sides_s=-COLOUR.exchanged_s),
        "a check is due, and colour has shown left and right swapped for a long time",
        CANDIDATE,
        "the body is seen",
        Tracked,
        {"awaits_search": True},
        ("search", "refine"),
    ),
    Transition(
        TRACKED,
        "",
        with_fields(FITS, sides=1),
        "its pose is refined, and colour shows left and right the correct way round",
        Tracked,
        {**AS_REFINED, "sides_s": INTERVAL_S},
        (),
    ),
    Transition(
        replace(TRACKED, sides_s=1.0),
        "colour has shown left and right the correct way round",
        with_fields(FITS, sides=-1),
        "its pose is refined, and colour shows them swapped",
        Tracked,
        {**AS_REFINED, "sides_s": 1.0 - INTERVAL_S},
        (),
    ),
    Transition(
        replace(TRACKED, clothes=RED, unlike_s=0.5),
        "for half a second, the clothes have been unlike those remembered",
        with_fields(FITS, clothes=np.array(BLUE.colour)),
        "its pose is refined, and the clothes are still unlike those remembered",
        Tracked,
        {
            **AS_REFINED,
            "unlike_s": 0.5 + INTERVAL_S,
            "clothes": remember(RED, np.array(BLUE.colour), INTERVAL_S, COLOUR.clothes),
        },
        (),
    ),
    Transition(
        UNSURE,
        "a joint has been in doubt for one check interval",
        CANDIDATE,
        "the body is seen",
        Tracked,
        {"awaits_search": True},
        ("search", "refine"),
    ),
    Transition(
        replace(UNSURE, doubtful_s=0.5 * LIMITS.check_interval_s),
        "a joint has been in doubt for half a check interval, and the next frame comes after a long gap",
        with_fields(CANDIDATE, time_s=LATER_S),
        "the body is seen",
        Tracked,
        {"awaits_search": True},
        ("search", "refine"),
    ),
    Transition(
        replace(UNSURE, doubtful_s=3 * LIMITS.check_interval_s),
        "a joint has been in doubt for three check intervals",
        CANDIDATE,
        "the body is seen",
        Tracked,
        {},
        ("refine",),
    ),
    Transition(
        replace(UNSURE, doubtful_s=4 * LIMITS.check_interval_s - 0.01),
        "a joint has been in doubt for four check intervals",
        CANDIDATE,
        "the body is seen",
        Tracked,
        {"awaits_search": True},
        ("search", "refine"),
    ),
    Transition(
        DUE,
        "a check is due, but nothing is in doubt",
        CANDIDATE,
        "the body is seen",
        Tracked,
        {},
        ("refine",),
    ),
    Transition(
        replace(DUE, normalised_residual=1.1, awaits_search=True),
        "a check is due, and a search runs",
        CANDIDATE,
        "the body is seen",
        Tracked,
        {},
        ("refine",),
    ),
    Transition(
        replace(DUE, normalised_residual=1.1),
        "a check is due, but lost bodies are not searched for",
        CANDIDATE,
        "the body is seen",
        Tracked,
        {},
        ("refine",),
        NEVER_RECOVERS,
    ),
    Transition(
        TRACKED,
        "",
        with_fields(CANDIDATE, is_elsewhere=True),
        "a candidate elsewhere is assumed to be the body",
        Lost,
        {"next_segmentation": None, "awaits_search": True},
        ("search", "refine"),
    ),
    Transition(
        replace(TRACKED, awaits_search=True),
        "",
        DUPLICATE,
        "other bodies explain everything visible of it",
        Lost,
        {"next_segmentation": None, "awaits_search": False, "visibility": "something"},
        ("stop searching",),
    ),
    Transition(
        replace(TRACKED, followed_s=0.1, was_established=False),
        "never followed for a check interval",
        DUPLICATE,
        "other bodies explain everything visible of it",
        Searching,
        {"searched_s": NEXT_S, "why": REASON, "visibility": "something"},
        ("stop searching",),
    ),
    Transition(
        DETECTED,
        "it was detected",
        DUPLICATE,
        "other bodies explain everything visible of it",
        Searching,
        {"searched_s": NEXT_S, "why": REASON},
        ("stop searching",),
    ),
    Transition(
        GIVEN,
        "the start pose was given",
        DUPLICATE,
        "other bodies explain everything visible of it",
        Found,
        {"next_segmentation": None},
        (),
    ),
    Transition(
        replace(LOST, next_segmentation=AT_POSE),
        "seen in the last frame",
        DUPLICATE,
        "other bodies explain everything visible of it",
        Lost,
        {"next_segmentation": None, "visibility": "something"},
        ("stop searching",),
    ),
    Transition(
        replace(TRACKED, followed_s=LIMITS.check_interval_s - 0.01, was_established=False),
        "followed for almost a check interval",
        FITS,
        "its pose is refined and explains the frame",
        Tracked,
        {**AS_REFINED, "followed_s": LIMITS.check_interval_s - 0.01 + INTERVAL_S, "was_established": True},
        (),
    ),
    Transition(
        replace(LOST, was_established=False),
        "never followed for a check interval",
        WRONG,
        "its pose is refined and does not explain the frame",
        Lost,
        {"belief": AFTER, "time_s": NEXT_S, "check_clock_s": 0.5 + INTERVAL_S, "normalised_residual": 2.0,
         "why": "wrong", "unexplained_s": INTERVAL_S},
        (),
    ),
    Transition(
        TRACKED,
        "lost bodies are not searched for",
        DUPLICATE,
        "other bodies explain everything visible of it",
        Lost,
        {"visibility": "something"},
        (),
        NEVER_RECOVERS,
    ),
    Transition(
        replace(TRACKED, why="doubt", ambiguous_facing=True),
        "",
        NOTHING,
        "the body is not seen, but something is",
        Lost,
        {"visibility": "something", "why": "", "ambiguous_facing": False},
        (),
    ),
    Transition(
        replace(TRACKED, unshown_s=COLOUR.unshown_s),
        "since its detection, colour has shown other people but not this body",
        CANDIDATE,
        "the body is seen",
        Absent,
        {},
        ("stop searching",),
    ),
    Transition(
        TRACKED,
        "",
        with_fields(FITS, is_confirmed=False),
        "its pose is refined, and colour shows other people but not this body",
        Tracked,
        {**AS_REFINED, "unshown_s": INTERVAL_S},
        (),
    ),
    Transition(
        replace(TRACKED, unshown_s=COLOUR.unshown_s),
        "since its detection, colour has not shown this body",
        with_fields(FITS, is_confirmed=True),
        "its pose is refined, and colour shows the body",
        Tracked,
        {**AS_REFINED, "unshown_s": None},
        (),
    ),
    Transition(
        replace(TRACKED, unshown_s=None),
        "colour has shown this body",
        with_fields(FITS, redetected=True, is_confirmed=False),
        "a search has found another pose of it, and colour shows other people",
        Tracked,
        {**AS_REFINED, "unshown_s": None, "check_clock_s": 0.0},
        (),
    ),
    Transition(
        replace(TRACKED, unshown_s=0.5),
        "for half a second, colour has not shown this body",
        with_fields(FITS, redetected=True, is_confirmed=False),
        "a search has found another pose of it, and colour shows other people",
        Tracked,
        {**AS_REFINED, "unshown_s": 0.5 + INTERVAL_S, "check_clock_s": 0.0},
        (),
    ),
    Transition(
        replace(LOST, unshown_s=None),
        "colour has shown this body",
        with_fields(FITS, redetected=True, is_confirmed=False),
        "a search has found a body, and colour shows other people",
        Tracked,
        {**AS_REFINED, "unshown_s": INTERVAL_S, "check_clock_s": 0.0, "followed_s": 0.0},
        (),
    ),
    Transition(TRACKED, "", DARK, "nothing is seen", Lost, {"visibility": "nothing"}, ()),
    Transition(
        UNSURE,
        "a joint has been in doubt for one check interval",
        with_fields(FITS, is_doubtful=True),
        "its pose is refined, and a joint may be wrong",
        Tracked,
        {
            "belief": AFTER,
            "time_s": NEXT_S,
            "next_segmentation": BELIEF.reported,
            "check_clock_s": 0.5 + INTERVAL_S,
            "normalised_residual": 0.8,
            "pixels": 800,
            "followed_s": INTERVAL_S,
            "doubtful_s": LIMITS.check_interval_s - 0.01 + INTERVAL_S,
        },
        (),
    ),
    Transition(
        UNSURE,
        "a joint has been in doubt for one check interval",
        with_fields(FITS, is_doubtful=True, redetected=True),
        "the reported pose was replaced by that of a search",
        Tracked,
        {
            "belief": AFTER,
            "time_s": NEXT_S,
            "next_segmentation": BELIEF.reported,
            "check_clock_s": 0.0,
            "normalised_residual": 0.8,
            "pixels": 800,
            "followed_s": INTERVAL_S,
            "doubtful_s": 0.0,
        },
        (),
    ),
    Transition(
        replace(TRACKED, unexplained_s=INTERVAL_S, why="wrong"),
        "",
        FITS,
        "its pose is refined and explains the frame",
        Tracked,
        {**AS_REFINED, "why": "", "unexplained_s": 0.0},
        (),
    ),
    Transition(
        TRACKED,
        "",
        with_fields(FITS, after_gap=True),
        "its pose is refined and explains the frame, after a long gap between frames",
        Tracked,
        {**AS_REFINED, "next_segmentation": AFTER.reported},
        (),
    ),
    Transition(
        TRACKED,
        "",
        WRONG,
        "its pose is refined and does not explain the frame",
        Tracked,
        {
            "belief": AFTER,
            "time_s": NEXT_S,
            "check_clock_s": 0.5 + INTERVAL_S,
            "normalised_residual": 2.0,
            "why": "wrong",
            "unexplained_s": INTERVAL_S,
        },
        (),
    ),
    Transition(
        replace(TRACKED, unexplained_s=0.09375),
        "the last frames are not explained",
        WRONG,
        "its pose is refined and does not explain the frame",
        Lost,
        {
            "belief": AFTER,
            "time_s": NEXT_S,
            "check_clock_s": 0.5 + INTERVAL_S,
            "normalised_residual": 2.0,
            "why": "wrong",
            "unexplained_s": 0.125,
        },
        (),
    ),
    Transition(
        TRACKED,
        "",
        with_fields(FITS, redetected=True, ambiguous_facing=True),
        "the pose of a search explains the frame better, elsewhere",
        Tracked,
        {
            "belief": AFTER,
            "time_s": NEXT_S,
            "check_clock_s": 0.0,
            "normalised_residual": 0.8,
            "pixels": 800,
            "followed_s": INTERVAL_S,
            "ambiguous_facing": True,
        },
        (),
    ),
    Transition(
        replace(TRACKED, faulty=("side",), awaits_search=True),
        "a camera had a fault",
        FITS,
        "its pose is refined, and the camera is back",
        Tracked,
        {
            "belief": AFTER,
            "time_s": NEXT_S,
            "check_clock_s": LIMITS.search_interval_s - USUAL_INTERVAL,
            "normalised_residual": 0.8,
            "pixels": 800,
            "followed_s": INTERVAL_S,
            "faulty": (),
            "awaits_search": False,
        },
        ("stop searching",),
    ),
    Transition(
        replace(TRACKED, awaits_search=True),
        "a search runs",
        ENDED,
        "the search ends",
        Tracked,
        {"awaits_search": False},
        (),
    ),
    Transition(
        replace(TRACKED, awaits_search=True),
        "a search runs",
        GIVEN_UP,
        "the search is given up",
        Tracked,
        {"awaits_search": False},
        (),
    ),
    Transition(
        replace(LOST, next_segmentation=AT_POSE),
        "",
        CANDIDATE,
        "a candidate is seen",
        Lost,
        {"next_segmentation": None, "awaits_search": True},
        ("search", "refine"),
    ),
    Transition(
        replace(LOST, awaits_search=True),
        "a search runs",
        CANDIDATE,
        "a candidate is seen",
        Lost,
        {},
        ("refine",),
    ),
    Transition(
        LOST,
        "lost bodies are not searched for",
        CANDIDATE,
        "the body is seen",
        Lost,
        {"next_segmentation": BELIEF.reported},
        ("refine",),
        NEVER_RECOVERS,
    ),
    Transition(LOST, "", NOTHING, "no candidate is seen", Lost, {"visibility": "nothing"}, ()),
    Transition(
        replace(LOST, unexplained_s=INTERVAL_S),
        "",
        DOUBTFUL,
        "its pose is refined and doubtful",
        Lost,
        {
            "belief": AFTER,
            "time_s": NEXT_S,
            "check_clock_s": 0.5 + INTERVAL_S,
            "normalised_residual": 1.2,
            "why": "doubt",
            "unexplained_s": 2 * INTERVAL_S,
        },
        (),
    ),
    Transition(
        replace(LOST, unexplained_s=4 * INTERVAL_S),
        "",
        FITS,
        "its pose is refined and explains the frame",
        Tracked,
        {**AS_REFINED, "unexplained_s": 0.0, "followed_s": 0.0},
        (),
    ),
    Transition(
        replace(LOST, awaits_search=True),
        "a search runs",
        ENDED,
        "the search ends",
        Lost,
        {"awaits_search": False},
        (),
    ),
    Transition(
        replace(LOST, awaits_search=True),
        "a search runs",
        GIVEN_UP,
        "the search is given up",
        Lost,
        {"awaits_search": False},
        (),
    ),
]  # fmt: skip


def table() -> str:
    """The transitions as a table in Markdown, with the status of a frame that ends with the row."""
    lines = ["| state | event | state after it | instructions | status |", "| --- | --- | --- | --- | --- |"]
    for row in TRANSITIONS:
        before = name_of(type(row.before)) + (f": {row.condition}" if row.condition else "")
        after = name_of(row.kind)
        done = ", ".join(row.instructions)
        status = status_after(row) if row.ends_frame else ""
        lines.append(f"| {before} | {row.what} | {after} | {done} | {status} |")
    return "\n".join(lines) + "\n"


def name_of(kind: type[TrackState]) -> str:
    """The name of a state, as users read it."""
    return kind.__name__.lower()


def status_after(row: Transition) -> str:
    """The status that the row is reported with, of a pose without doubt."""
    after, _ = step(row.before, row.event, row.policy)
    return status_of(after, is_ambiguous=False)


def with_table(page: str) -> str:
    """The page with the present table."""
    before, rest = page.split(START)
    _, after = rest.split(END)
    return before + START + "\n" + table() + "\n" + END + after


if __name__ == "__main__":
    PAGE.write_text(with_table(PAGE.read_text()))
