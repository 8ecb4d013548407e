"""The state of a track, and how events change it: a state machine without a clock, images or workers.

`step` returns the state after an event, and instructions; if there are none, the frame is done.
`coordinator/tracking/target.py` executes them, and generates the events. The table of transitions is in
docs/states.md.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Literal, NamedTuple, TypeAlias

import msgspec
from msgspec.structs import replace

from gepf.common.arrays import Array
from gepf.coordinator.colour.clothes import Clothes, alike_nats, remember
from gepf.coordinator.filters.belief import USUAL_INTERVAL, Belief
from gepf.coordinator.settings import ColourSettings, TrackSettings
from gepf.coordinator.tracking.cameras import Agreement
from gepf.coordinator.tracking.judgement import Gate

ROUNDING_S = 1e-3  # tolerance for times that were rounded when they were written to a file
FACING_DOUBT = "front and back look alike: the body may face the other way"
DUPLICATE = "everything visible of the body belongs to other bodies"
CLOTHES_DOUBT = "the clothes are a different colour than before: this may be somebody else"

Instruction = Literal["search", "stop searching", "update the background", "refine"]
"""search: begin a search in this frame; its end is an event. stop searching: give up the running search.
update the background: add to it everything that was searched, except the person. refine: refine the particles
of this frame; the result is an event."""

Instructions = tuple[Instruction, ...]

Visibility = Literal["body", "something", "nothing"]
"""What a frame shows where a body is expected."""


class Absent(msgspec.Struct, frozen=True, tag="absent"):
    """The body is unknown, and nothing that might be a body is visible."""


class Searching(msgspec.Struct, frozen=True, tag="searching"):
    """The body is unknown, and something that might be a body is visible."""

    searches: int = 1  # number of searches that have begun
    searched_s: float = 0.0  # time of the frame in which the last one began
    why: str = ""  # reason why the last one detected nothing
    awaits_search: bool = False  # whether a search has begun whose result has not been taken yet
    visibility: Visibility = "something"

    def is_due(self, time_s: float, settings: TrackSettings) -> bool:
        """Whether the next search may begin."""
        due_s = self.searched_s + settings.search_interval_s - ROUNDING_S
        return not self.awaits_search and time_s >= due_s


class NextSegmentation(msgspec.Struct, frozen=True):
    """What is known about a body when the next frame is segmented.

    The next frame is segmented while the current one is refined. For frame n + 1:

        frame n is submitted (`FrameSegmented`): this struct is set, from the state after frame n - 1
        frame n is refined, and meanwhile frame n + 1 is segmented
        frame n is updated (`FrameRefined`): at low frame rates, it is set again, from the state after n
    """

    pose: Array | None = None  # (D,), around which the frame is segmented; None: the body may be anywhere
    excluded: tuple[str, ...] = ()  # cameras that are not used for the body
    is_new: bool = True  # whether the body was detected, or a camera came back, a short time ago
    is_confirmed: bool = False  # whether colour has confirmed the body, or its start was given
    followed_s: float = 0.0  # time for which its pose has explained the frames since it was last lost


class Body(msgspec.Struct, frozen=True, kw_only=True):
    """A body with a pose: the fields that found, tracked and lost bodies share."""

    belief: Belief
    next_segmentation: NextSegmentation
    time_s: float | None = None  # of the last frame that showed the body
    agreement: Agreement = msgspec.field(default_factory=Agreement)  # of the cameras, on the last pose
    awaits_search: bool = False  # whether a search for it has begun whose result has not been taken yet
    unshown_s: float | None = 0.0
    """Time without confirmation by colour since the detection; None once confirmed, or for a given start."""
    clothes: Clothes | None = None  # None until colour has shown them

    @property
    def may_be_anywhere(self) -> bool:
        """Whether the next frame is not segmented around a pose."""
        return self.next_segmentation.pose is None


class Found(Body, frozen=True, kw_only=True, tag="found"):
    """A body that was detected, or whose start is given, before it is tracked in a first frame.

    A detected body has a place (3,), the median of its observed points in the searched image, metres,
    and a number of pixels there.
    """

    place: Array | None = None
    detected_pixels: int = 0
    is_lost: bool = False  # whether a frame showed nothing at a given start pose

    @property
    def is_given(self) -> bool:
        """Whether the start was given, not detected."""
        return self.place is None


class TrackedBefore(Body, frozen=True, kw_only=True):
    """The fields that tracked and lost bodies share."""

    check_clock_s: float = 0.0
    """The clock of checks: time in frames that show the body since its detection.

    For a given start, which needs no first check, it begins past that check; when a camera comes back, it is
    set to just before the first check.
    """
    unexplained_s: float = 0.0  # time for which no frame was explained
    normalised_residual: float = 0.0  # of the last frame that showed the body
    why: str = ""  # reason to doubt the pose in that frame
    pixels: int = 0  # number of the body's pixels in the last explained frame
    doubtful_s: float = 0.0  # time for which a joint in view has been in doubt, since the last detection
    ambiguous_facing: bool = False
    """Whether front and back explained the depth about equally well in the last search."""
    sides_s: float = 0.0
    """Time for which colour showed left and right correctly, minus the time for which they were swapped."""
    unlike_s: float = 0.0
    """Time for which the clothes were unlike those remembered, minus the time for which they were alike."""
    followed_s: float = 0.0  # time for which the pose has explained the frames since the body was last lost
    was_established: bool = False  # whether this has ever been longer than a check interval
    faulty: tuple[str, ...] = ()  # cameras with a fault in the last frame that showed the body
    visibility: Visibility = "body"  # in the last frame

    def is_new(self, settings: TrackSettings) -> bool:
        """Whether the body was detected, or a camera came back, a short time ago."""
        return self.check_clock_s < settings.check_interval_s - ROUNDING_S

    def is_facing_known(self, settings: ColourSettings) -> bool:
        """Whether front and back are told apart, by depth, or by colour over a sufficiently long time."""
        if self.ambiguous_facing:
            return self.sides_s >= settings.facing_s - ROUNDING_S
        is_swapped = self.sides_s <= ROUNDING_S - settings.exchanged_s
        return not is_swapped

    def has_other_clothes(self, settings: ColourSettings) -> bool:
        """Whether the clothes are those of somebody else."""
        return self.unlike_s >= settings.clothes.unlike_s - ROUNDING_S

    def doubt(self, settings: ColourSettings) -> str:
        """Why the pose, or the identity of the person, is in doubt; empty if neither is."""
        if self.why or not self.is_facing_known(settings):
            return self.why or FACING_DOUBT
        return CLOTHES_DOUBT if self.has_other_clothes(settings) else ""


class Tracked(TrackedBefore, frozen=True, kw_only=True, tag="tracked"):
    """The pose explains the frames, except that the last few may be unexplained."""

    is_lost: ClassVar[bool] = False


class Lost(TrackedBefore, frozen=True, kw_only=True, tag="lost"):
    """The body may be anywhere."""

    is_lost: ClassVar[bool] = True


TrackState: TypeAlias = Absent | Searching | Found | Tracked | Lost


@dataclass(frozen=True, slots=True, eq=False)
class FrameSegmented:
    """A frame is segmented: the number of pixels that show the body, and of the points picked from them.

    Both are 0 if nothing shows it. `has_depth`: whether the frame shows anything at all. `is_elsewhere`:
    whether these pixels are not where the body was expected. `moved`: the belief about a detected body, moved
    to where the body is now. `is_duplicate`: whether the body gets no pixels, because others explain
    everything visible of it.
    """

    time_s: float
    pixels: int = 0
    points: int = 0
    has_depth: bool = True
    is_elsewhere: bool = False
    moved: Belief | None = None
    is_duplicate: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class SearchEnded:
    """A search has ended.

    The first search for a body ends with the `detected` body, or the reason `why` nothing was detected; the
    result of a repeated search comes with `FrameRefined`.
    """

    detected: Found | None = None
    why: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class SearchGivenUp:
    """The search that may be under way is given up, without a result."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameRefined:
    """The particles of a frame are refined, and the pose is gated.

    `redetected`: the pose is that of a search, and not where the body was tracked. `ambiguous_facing`: front
    and back look alike in that search; None without a search. `is_doubtful`: a joint in view may be wrong.
    `is_confirmed`: whether colour confirms the person; None if unknown. `sides`: 1 if colour shows left and
    right correctly, -1 if swapped, 0 if unknown. `clothes`: their colour (3,); None if unknown. `faulty`:
    cameras whose fault has lasted (`faults_of`). `residuals`: of each compared camera, metres; cameras agree
    up to `allowed_m`, and the frame stands for `interval_s` seconds of agreement (see `Agreement.after`).
    `after_gap`: the next frame has not been segmented yet.
    """

    belief: Belief
    gate: Gate
    pixels: int
    time_s: float
    redetected: bool = False
    ambiguous_facing: bool | None = None
    is_doubtful: bool = False
    is_confirmed: bool | None = None
    sides: int = 0
    clothes: Array | None = None
    faulty: tuple[str, ...] = ()
    residuals: Mapping[str, float] = field(default_factory=dict)
    allowed_m: float = 0.0
    interval_s: float = 0.0
    after_gap: bool = False


Event: TypeAlias = FrameSegmented | SearchEnded | SearchGivenUp | FrameRefined


class Policy(NamedTuple):
    """What does not change while a body is tracked."""

    min_points: int  # minimum number of points that can show a body
    settings: TrackSettings
    colour: ColourSettings
    recovers: bool = True  # whether a lost body is searched for


def step(state: TrackState, event: Event, policy: Policy) -> tuple[TrackState, Instructions]:
    """The state after an event, and what to do now."""
    match event:
        case FrameSegmented():
            return _on_segmented(state, event, policy)
        case SearchEnded():
            return _on_search_ended(state, event)
        case SearchGivenUp():
            return _on_search_given_up(state), ()
        case FrameRefined():
            assert isinstance(state, Found | Tracked | Lost)  # only a body is refined
            return _on_refined(state, event, policy)


def _on_segmented(
    state: TrackState, event: FrameSegmented, policy: Policy
) -> tuple[TrackState, Instructions]:
    if not isinstance(state, Body):
        return _look_for_anybody(state, event, policy)
    if policy.recovers and (state.unshown_s or 0.0) > policy.colour.unshown_s - ROUNDING_S:
        return Absent(), ("stop searching",)
    if event.is_duplicate and policy.recovers and not (isinstance(state, Found) and state.is_given):
        return _end_duplicate(state, event, policy)
    if event.is_elsewhere and isinstance(state, TrackedBefore):
        state = _lose(state, policy)
    if not event.pixels:
        return _handle_unseen(state, event, policy), ()
    return _handle_seen(state, event, policy)


def _look_for_anybody(
    state: Absent | Searching, event: FrameSegmented, policy: Policy
) -> tuple[TrackState, Instructions]:
    """An unknown body: search for it at intervals while there is something to search in."""
    if isinstance(state, Searching) and state.awaits_search:
        if event.pixels or event.has_depth:
            return replace(state, visibility="something"), ()
        return replace(state, searches=1, why="", visibility="nothing"), ()
    if event.points < policy.min_points:
        return Absent(), ()
    if isinstance(state, Absent):
        return Searching(searched_s=event.time_s, awaits_search=True), ("search",)
    state = replace(state, visibility="something")
    if not state.is_due(event.time_s, policy.settings):
        return state, ()
    state = replace(state, searches=state.searches + 1, searched_s=event.time_s, awaits_search=True)
    return state, ("search",)


def _end_duplicate(
    state: Found | Tracked | Lost, event: FrameSegmented, policy: Policy
) -> tuple[TrackState, Instructions]:
    """A duplicate of other bodies: it may be anywhere or, if it was never established, does not exist."""
    if isinstance(state, Found) or not state.was_established:
        return Searching(searched_s=event.time_s, why=DUPLICATE), ("stop searching",)
    lost = _lose(state, policy)
    lost = replace(
        lost,
        belief=state.belief.unseen(),
        next_segmentation=_next_segmentation(lost, policy),
        awaits_search=False,
        visibility="something",
    )
    return lost, ("stop searching",)


def _handle_unseen(state: Found | Tracked | Lost, event: FrameSegmented, policy: Policy) -> TrackState:
    """A body that is not seen: its hypotheses stay where they are, without velocity.

    The next frame is still segmented around its pose; if it is not seen there, it may be anywhere.
    """
    shows_something = not state.may_be_anywhere and event.has_depth
    upcoming = _next_segmentation(state, policy)  # before `_lose`: a lost body may be anywhere
    if isinstance(state, Found) and state.is_given:
        is_lost = state.is_lost or not shows_something
        return replace(state, next_segmentation=replace(upcoming, pose=None), is_lost=is_lost)
    return replace(
        _lose(state, policy),
        belief=state.belief.unseen(),
        next_segmentation=upcoming,
        visibility="something" if shows_something else "nothing",
    )


def _handle_seen(
    state: Found | Tracked | Lost, event: FrameSegmented, policy: Policy
) -> tuple[TrackState, Instructions]:
    """A body that is seen: refine it, and search for it as well if it is new, lost or in doubt."""
    state = replace(state, belief=event.moved or state.belief)
    state = replace(state, next_segmentation=_next_segmentation(state, policy))
    if isinstance(state, Found):
        return state, ("refine",)
    if state.awaits_search or not (policy.recovers and _check_due(state, event.time_s, policy)):
        return replace(state, visibility="body"), ("refine",)
    return replace(state, visibility="body", awaits_search=True), ("search", "refine")


def _check_due(state: Tracked | Lost, time_s: float, policy: Policy) -> bool:
    """Whether to search for a body again: lost, new, or in doubt.

    If the pose explains the frame badly, a check is due whenever the check clock reaches a multiple of the
    check interval. While a joint may be wrong, a check that changes nothing makes the next one wait twice as
    long.
    """
    settings, interval = policy.settings, _interval(state, time_s)
    before = state.check_clock_s + ROUNDING_S
    after = before + interval
    is_first_check = before < settings.search_interval_s <= after
    due = after // settings.check_interval_s > before // settings.check_interval_s
    is_bad = state.normalised_residual > 1.0 or not state.is_facing_known(policy.colour)
    in_doubt = _doubt_is_due(state.doubtful_s, interval, settings)
    return state.is_lost or is_first_check or (due and is_bad) or in_doubt


def _doubt_is_due(doubtful_s: float, interval_s: float, settings: TrackSettings) -> bool:
    """Whether the time in doubt reaches 1, 2, 4, ... check intervals in this frame."""
    if not doubtful_s:
        return False
    before, after = (
        (time_s + ROUNDING_S) / settings.check_interval_s for time_s in (doubtful_s, doubtful_s + interval_s)
    )
    # the binary exponent grows when a power of two is reached
    return after >= 1.0 and (before < 1.0 or math.frexp(after)[1] > math.frexp(before)[1])


def _interval(state: Found | Tracked | Lost, time_s: float) -> float:
    """Seconds since the last frame that showed the body; the usual interval if it was not tracked then."""
    since = 0.0 if isinstance(state, Found) or state.time_s is None else time_s - state.time_s
    return since if since > 0.0 else USUAL_INTERVAL


def _next_segmentation(state: Found | Tracked | Lost, policy: Policy) -> NextSegmentation:
    """What the next frame is segmented with if nothing more is known by then."""
    pose = None if state.is_lost and policy.recovers else state.belief.reported
    is_new = isinstance(state, Found) or state.is_new(policy.settings)
    return NextSegmentation(
        pose,
        state.agreement.contradicting,
        is_new,
        is_confirmed=state.unshown_s is None,
        followed_s=0.0 if isinstance(state, Found) else state.followed_s,
    )


def _on_search_ended(state: TrackState, event: SearchEnded) -> tuple[TrackState, Instructions]:
    """A first search has detected a body or nothing; a repeated one is over."""
    if isinstance(state, Body):
        return replace(state, awaits_search=False), ()
    if event.detected is not None:
        return event.detected, ("update the background",)
    if isinstance(state, Absent) or not state.awaits_search:
        return state, ()
    return replace(state, why=event.why, awaits_search=False), ()


def _on_search_given_up(state: TrackState) -> TrackState:
    """A first search that is given up does not count."""
    if isinstance(state, Body):
        return replace(state, awaits_search=False)
    if isinstance(state, Absent) or not state.awaits_search:
        return state
    if state.searches == 1:
        return Absent()
    return replace(state, searches=state.searches - 1, searched_s=-math.inf, awaits_search=False)


def _on_refined(
    state: Found | Tracked | Lost, event: FrameRefined, policy: Policy
) -> tuple[TrackState, Instructions]:
    """A body is tracked if it explains the frame, and lost if it has not done so for some frames."""
    settings, colour, agreement = policy.settings, policy.colour, state.agreement
    before, interval = _as_tracked_before(state, settings), _interval(state, event.time_s)
    if state.is_lost and not agreement.contradicting:
        agreement = Agreement()
    is_explained = event.gate.normalised_residual <= (1.0 if state.is_lost else settings.lost_residual)
    unexplained_s = 0.0 if is_explained else before.unexplained_s + interval
    is_lost = not is_explained and (state.is_lost or unexplained_s > settings.patience_s - ROUNDING_S)
    followed_s = 0.0 if is_lost else before.followed_s + interval * (is_explained and not state.is_lost)
    after = _become(
        Lost if is_lost else Tracked,
        before,
        belief=event.belief,
        time_s=event.time_s,
        agreement=agreement.after(
            event.residuals, event.allowed_m, event.interval_s, settings.camera_confirmed_s
        ),
        check_clock_s=0.0 if is_explained and event.redetected else before.check_clock_s + interval,
        unexplained_s=unexplained_s,
        normalised_residual=event.gate.normalised_residual,
        why=event.gate.why,
        doubtful_s=before.doubtful_s + interval if event.is_doubtful and not event.redetected else 0.0,
        pixels=event.pixels if is_explained else before.pixels,
        ambiguous_facing=(
            before.ambiguous_facing if event.ambiguous_facing is None else event.ambiguous_facing
        ),
        followed_s=followed_s,
        was_established=before.was_established or followed_s > settings.check_interval_s - ROUNDING_S,
        faulty=event.faulty,
        unshown_s=_next_unshown_s(
            0.0 if event.redetected and state.is_lost else before.unshown_s, event, interval, colour
        ),
        sides_s=0.0 if event.redetected else _next_sides_s(before.sides_s, event.sides, interval, colour),
        clothes=_next_clothes(before, event, interval, colour) if is_explained else before.clothes,
        unlike_s=0.0 if event.redetected else _next_unlike_s(before, event, interval, colour),
    )
    if event.after_gap:
        after = replace(after, next_segmentation=_next_segmentation(after, policy))
    if set(before.faulty) - set(event.faulty) and policy.recovers:  # a camera is back
        # a running search began without it; check the body in the next frame
        after = replace(after, check_clock_s=settings.search_interval_s - USUAL_INTERVAL, awaits_search=False)
        return after, ("stop searching",)
    return after, ()


def _next_unshown_s(
    before_s: float | None, event: FrameRefined, interval_s: float, settings: ColourSettings
) -> float | None:
    """Seconds since a body's detection without confirmation by colour; None once colour has confirmed it."""
    if event.is_confirmed or before_s is None:
        return None
    return before_s if event.is_confirmed is None else before_s + min(interval_s, settings.max_step_s)


def _next_sides_s(before_s: float, sides: int, interval_s: float, settings: ColourSettings) -> float:
    """`TrackedBefore.sides_s` after a frame, seconds."""
    after_s = before_s + sides * min(interval_s, settings.max_step_s)
    return min(max(after_s, -settings.exchanged_s), max(settings.facing_s, settings.exchanged_s))


def _next_clothes(
    before: TrackedBefore, event: FrameRefined, interval_s: float, settings: ColourSettings
) -> Clothes | None:
    """What is remembered about the clothes after a frame."""
    if event.clothes is None:
        return before.clothes
    return remember(before.clothes, event.clothes, min(interval_s, settings.max_step_s), settings.clothes)


def _next_unlike_s(
    before: TrackedBefore, event: FrameRefined, interval_s: float, settings: ColourSettings
) -> float:
    """`TrackedBefore.unlike_s` after a frame, seconds."""
    if before.clothes is None or event.clothes is None:
        return before.unlike_s
    step_s = min(interval_s, settings.max_step_s)
    alike = alike_nats(before.clothes, event.clothes, settings.clothes) > -settings.clothes.unlike_nats
    return min(max(before.unlike_s + (-step_s if alike else step_s), 0.0), settings.clothes.unlike_s)


def _as_tracked_before(state: Found | Tracked | Lost, settings: TrackSettings) -> Tracked | Lost:
    """A found body as a tracked one; a given start is checked only while in doubt."""
    if not isinstance(state, Found):
        return state
    return _become(Tracked, state, check_clock_s=settings.check_interval_s if state.is_given else 0.0)


def _lose(state: Found | Tracked | Lost, policy: Policy) -> Tracked | Lost:
    """The body as a lost one, without doubts about its old pose."""
    return _become(
        Lost,
        _as_tracked_before(state, policy.settings),
        why="",
        ambiguous_facing=False,
        sides_s=0.0,
        unlike_s=0.0,
        followed_s=0.0,
    )


def _become(kind: type[Tracked] | type[Lost], state: Body, **changes: object) -> Tracked | Lost:
    """A tracked or lost body that keeps the fields it shares with its previous state."""
    shared = {
        name: getattr(state, name) for name in kind.__struct_fields__ if name in state.__struct_fields__
    }
    return kind(**(shared | changes))
