"""The state machine of a track: its table of transitions, and the states at the end of any history."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gepf.coordinator.filters.belief import Belief
from gepf.coordinator.results.log import pack_array, unpack_array
from gepf.coordinator.tracking.estimate import Status
from gepf.coordinator.tracking.judgement import Gate
from gepf.coordinator.tracking.reporting import status_of
from gepf.coordinator.tracking.track_state import (
    Absent,
    Body,
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
    TrackedBefore,
    TrackState,
    step,
)
from tests.support.transitions import (
    BELIEF,
    DETECTED,
    GIVEN,
    LOST,
    PAGE,
    POLICY,
    TRACKED,
    TRANSITIONS,
    Transition,
    with_table,
)


def describe(row: Transition) -> str:
    """The name of a test."""
    return f"{type(row.before).__name__} {row.condition}: {row.what}"


@pytest.mark.parametrize("row", TRANSITIONS, ids=describe)
def test_a_transition_is_as_the_table_says(row: Transition) -> None:
    """The kind of the state, the instructions, and the changed fields; no other field changes."""
    after, instructions = step(row.before, row.event, row.policy)
    assert type(after) is row.kind
    assert instructions == row.instructions
    for name in after.__struct_fields__:
        value = getattr(after, name)
        if name == "next_segmentation":
            assert value == segmentation_after(row)
        elif name in row.changes:
            assert value is row.changes[name] or value == row.changes[name], name
        elif name == "belief" and isinstance(after, Lost) and after.visibility != "body":
            before = row.before.belief if isinstance(row.before, Body) else BELIEF
            np.testing.assert_array_equal(value.poses, before.poses)
            assert np.isnan(value.residual).all()
            assert not value.velocities.any()
        elif hasattr(row.before, name):
            assert value is getattr(row.before, name) or value == getattr(row.before, name), name


def segmentation_after(row: Transition) -> NextSegmentation:
    """What the next frame is segmented with: the pose of the table, and the rest as it was when fixed."""
    before = row.before
    if not isinstance(before, Body):
        detected = row.changes["next_segmentation"]
        assert isinstance(detected, NextSegmentation)
        return detected
    fixed = before.next_segmentation
    if isinstance(row.event, FrameSegmented):
        is_new = isinstance(before, Found) or before.is_new(row.policy.settings)
        excluded, is_confirmed = before.agreement.contradicting, before.unshown_s is None
        fixed = msgspec.structs.replace(fixed, excluded=excluded, is_new=is_new, is_confirmed=is_confirmed)
    if isinstance(row.event, FrameRefined) and row.event.after_gap:
        fixed = msgspec.structs.replace(fixed, followed_s=row.changes["followed_s"])
    pose = row.changes.get("next_segmentation", fixed.pose)
    assert pose is None or isinstance(pose, np.ndarray)
    return msgspec.structs.replace(fixed, pose=pose)


def test_the_table_has_every_event_of_every_state() -> None:
    """Each kind of event in each state, if the state allows it, and all ways from a state to another."""
    rows = {(type(row.before), type(row.event)) for row in TRANSITIONS}
    kinds = get_args(TrackState)
    assert rows >= {(kind, event) for kind in kinds for event in (FrameSegmented,)}
    assert rows >= {(kind, FrameRefined) for kind in (Found, Tracked, Lost)}
    assert rows >= {(kind, SearchEnded) for kind in (Searching, Tracked, Lost)}
    assert rows >= {(kind, SearchGivenUp) for kind in (Absent, Searching, Tracked, Lost)}


def test_the_page_has_the_tested_table() -> None:
    """If not: python -m tests.support.transitions."""
    page = PAGE.read_text()
    assert with_table(page) == page


EVENTS = [  # what a frame shows
    *(
        FrameSegmented(0.0, 900, points, is_elsewhere=elsewhere, moved=moved)
        for points in (50, 500)
        for elsewhere in (False, True)
        for moved in (None, Belief.at(np.array([0.7])))
    ),
    *(FrameSegmented(0.0, has_depth=depth) for depth in (False, True)),
    FrameSegmented(0.0, is_duplicate=True),
]
RESULTS = st.builds(
    FrameRefined,
    belief=st.just(Belief.at(np.array([0.6]))),
    gate=st.sampled_from([Gate(0.5), Gate(1.1, "why"), Gate(2.0, "why")]),
    pixels=st.just(900),
    time_s=st.just(0.0),
    redetected=st.booleans(),
    ambiguous_facing=st.sampled_from([None, True, False]),
    faulty=st.sampled_from([(), ("a",), ("a", "b")]),
    residuals=st.sampled_from([{}, {"a": 0.01, "b": 0.01}, {"a": 0.01, "b": 0.2}]),
    allowed_m=st.just(0.04),
    interval_s=st.sampled_from([0.03, 0.6]),
    after_gap=st.booleans(),
)
ENDS = st.sampled_from(["runs on", "detects", "detects nothing", "is given up"])
PAUSES = st.sampled_from([0.0, 1 / 30, 0.1, 0.25, 2.0])
HISTORY = st.lists(st.tuples(PAUSES, st.sampled_from(EVENTS), RESULTS, ENDS), max_size=20)


class Executor:
    """Does what the state machine says, with results from outside; checks that each order can be obeyed."""

    def __init__(self, state: TrackState, policy: Policy) -> None:
        self.state, self.policy = state, policy
        self.searches = False

    def send(self, event: Event) -> Instructions:
        """An event, and what to do then."""
        self.state, todo = step(self.state, event, self.policy)
        if "search" in todo:
            assert not self.searches, "a second search at once"
            self.searches = True
        if "stop searching" in todo:
            self.searches = False
        return todo

    def end_search(self, how: str) -> None:
        """The end of a search that runs, if it does not run on."""
        if not self.searches or how == "runs on":
            return
        self.searches = False
        if how == "is given up":
            assert self.send(SearchGivenUp()) == ()
        elif isinstance(self.state, Body):
            assert self.send(SearchEnded()) == ()
        elif how == "detects":
            assert self.send(SearchEnded(DETECTED)) == ("update the background",)
        else:
            assert self.send(SearchEnded(why="no")) == ()

    def track(self, segmented: FrameSegmented, refined: FrameRefined, how: str, *, waits: bool) -> None:
        """A frame; a search ends in it, if the frame waits for it, or before the next one."""
        todo = self.send(segmented)
        if waits:
            self.end_search("detects nothing" if how == "runs on" else how)
            if isinstance(self.state, Found) and "refine" not in todo and segmented.pixels:
                todo = self.send(segmented)
        if "refine" in todo:
            assert segmented.pixels
            assert "refine" not in self.send(refined)
            assert isinstance(self.state, Tracked | Lost)
        if not waits:
            self.end_search(how)


def check(state: TrackState, policy: Policy, *, searches: bool) -> None:
    """What holds after every frame, and that the state comes back whole from its record."""
    record = msgspec.msgpack.encode(state, enc_hook=pack_array)
    decoder = msgspec.msgpack.Decoder(TrackState, dec_hook=unpack_array)
    assert msgspec.msgpack.encode(decoder.decode(record), enc_hook=pack_array) == record
    status = status_of(state, is_ambiguous=False)
    assert status in get_args(Status)
    assert (status == "tracked") == (isinstance(state, Tracked) and not state.unexplained_s)
    match state:
        case Absent():
            assert not searches
        case Searching():
            assert state.awaits_search == searches
            assert state.searches
        case Found() | Tracked() | Lost():
            assert state.awaits_search == searches
            assert policy.recovers or not searches
            pose = state.next_segmentation.pose
            assert pose is None or not np.isnan(pose).any()
    if isinstance(state, TrackedBefore):
        assert isinstance(state, Lost) or (state.visibility == "body" and state.unexplained_s < 0.1)
        assert policy.recovers or not state.may_be_anywhere


@settings(derandomize=False, suppress_health_check=[HealthCheck.too_slow])
@given(st.sampled_from([Absent(), GIVEN, DETECTED, TRACKED, LOST]), st.booleans(), st.booleans(), HISTORY)
def test_any_history_ends_in_a_valid_state(
    first: TrackState,
    recovers: bool,
    waits: bool,
    history: list[tuple[float, FrameSegmented, FrameRefined, str]],
) -> None:
    """For recorded input, which waits for searches, and for live input, which does not."""
    executor, now = Executor(first, POLICY._replace(recovers=recovers)), 1.0
    for pause, view, result, how in history:
        now += pause
        segmented, refined = replace(view, time_s=now), replace(result, time_s=now)
        executor.track(segmented, refined, how, waits=waits)
        check(executor.state, executor.policy, searches=executor.searches)
