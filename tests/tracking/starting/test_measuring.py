"""A person's size from many frames: evidence adds up, and rendered people of other sizes are measured."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from common.frame import DepthFrame
from common.kinematics import joint_positions, pose_vertices
from common.settings import preset
from coordinator.bodies.choice import choose_bodies
from coordinator.bodies.human.measures import Measures
from coordinator.bodies.human.template import human_of
from coordinator.bodies.tracked import name_pose
from coordinator.filters.belief import Belief
from coordinator.filters.methods import METHODS
from coordinator.pool.statistics import PoolStatistics
from coordinator.results.recording.log import Began, Entry, append_records
from coordinator.results.recording.recorded import read_log
from coordinator.synthesis.rendering import DepthRenderer
from coordinator.tracking.inference import Situation
from coordinator.tracking.known import Known
from coordinator.tracking.observing.subject import isolate
from coordinator.tracking.refiner import Pending
from coordinator.tracking.search.seeker import Seeker
from coordinator.tracking.search.watch import Watch
from coordinator.tracking.single import SingleTracker as Tracker
from coordinator.tracking.starting.asking import Asker, grain
from coordinator.tracking.starting.measuring import (
    BELIEVED,
    CHANGES,
    GUESS,
    LARGEST,
    LARGEST_STEP,
    LENGTH_SHARE,
    PRIOR,
    SMALLEST,
    USUAL,
    Measured,
    Shown,
)
from coordinator.tracking.starting.person_size import PersonSize, stature_by_length
from coordinator.tracking.starting.start import Start
from coordinator.tracking.starting.uprightness import BENT, Stance, stance_of
from gepf.direct import DirectRefiner
from tests.support.asked import Asked
from tests.support.people import CAMERA, SETTINGS, STANDING, as_bytes, frame_of, shown
from tests.support.processes.still_workers import StillWorkers
from tests.support.stand_ins import Direct, Ready

BODIES = choose_bodies(None, "default")
RULES = preset("default").refine


def start_of(stature: float, girth: float) -> Start:
    """A start with a body of this size."""
    model, pose = BODIES.tracked(stature, girth, STANDING)
    return Start(model, pose, stature, girth, values={})


class InPart(StillWorkers):
    """Leaves the last particle without an answer, or one that did not come to rest."""

    def __init__(self, missing: float) -> None:
        super().__init__()
        self._missing = missing

    def answer(self, asked: Asked) -> Ready:
        """The same poses, one of them of this log likelihood."""
        ready = super().answer(asked)
        ready.refined.log_likelihood[-1] = self._missing
        return ready


class Counting(Direct):
    """Counts the particles of each request."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[int] = []

    def answer(self, asked: Asked) -> Pending:
        """As it is."""
        self.asked.append(len(asked.poses))
        return super().answer(asked)


def test_evidence_adds_up_to_the_weighted_mean() -> None:
    """Of the peaks of parabolas, however sharp, of the first guess and of what is usual."""
    peaks, weights = np.log([[1.615, 1.08], [1.63, 1.06]]), np.array([0.5, 1.0])
    measured = Measured.guessed(1.62, 1.07)
    for n, (peak, weight) in enumerate(zip(peaks, weights, strict=True)):
        curvature = np.array([2000.0, 300.0]) * (n + 1)
        told = Shown(curvature * (peak - np.log(measured.about)), curvature, float(weight))
        measured = measured.after(told, 0.1 * n)
    guess = np.array([GUESS, 0.0])
    total = PRIOR * np.log(USUAL) + guess * np.log(1.62) + weights @ peaks
    assert measured.frames == 2
    np.testing.assert_allclose(measured.weight, PRIOR + guess + 1.5)
    np.testing.assert_allclose(np.log(measured.size), total / measured.weight)


def test_girth_is_asked_in_every_other_frame() -> None:
    """A frame that was asked about stature alone leaves girth as it was."""
    before = Measured.guessed(1.7, 1.07)
    assert before.asks_girth
    after = before.after(Shown(np.array([30.0]), np.array([1000.0]), 1.0), 0.0)
    assert not after.asks_girth
    assert after.size[0] > before.size[0]
    assert after.size[1] == pytest.approx(before.size[1], rel=1e-12)


def test_no_frame_may_ask_for_much() -> None:
    """A flat or hollow log likelihood counts as a weak one, with a bounded step."""
    told = Shown(np.array([1e5, -1e5]), np.array([-100.0, 0.0]), 1.0)
    before = Measured.guessed(1.7, 1.07)
    step = np.log(before.after(told, 0.0).size) - np.log(before.size)
    assert np.all(np.abs(step) < LARGEST_STEP)


def test_length_has_its_share_of_what_a_frame_says() -> None:
    """Points ask for 1 % more, length for 3 %; a length that is far off is bounded."""
    about, curvature = (1.7, 1.07), np.array([1000.0, 100.0])
    points = Shown(0.01 * curvature, curvature, 1.0)
    both = replace(points, by_length=float(np.log(1.7)) + 0.03)
    np.testing.assert_allclose(points.asks_for(about), np.log(about) + 0.01)
    asked = both.asks_for(about) - np.log(about)
    np.testing.assert_allclose(asked, [0.01 + LENGTH_SHARE * 0.02, 0.01])
    far = replace(points, by_length=float(np.log(2.4))).asks_for(about)
    assert far[0] - np.log(1.7) < LARGEST_STEP


@pytest.mark.parametrize("more", [0.015, 0.05])
def test_words_on_another_size_count_less(more: float) -> None:
    """A frame asks for more: the next is asked about that, and what came before counts less, the more so."""
    before = Measured.guessed(1.6, 1.07)
    after = before.after(Shown(np.array([1000.0 * more]), np.array([1000.0]), 1.0), 0.0)
    assert after.about == after.size
    off = np.log(after.size[0] / 1.6)
    assert off == pytest.approx(more, rel=0.1)
    kept = 1.0 / (1.0 + (off / BELIEVED) ** 2)
    np.testing.assert_allclose(after.weight, [kept * (PRIOR[0] + GUESS + 1.0), PRIOR[1]])


def test_noisy_words_settle() -> None:
    """Words 4 % apart that go six tenths of the way from what is asked about, for a minute: within 3 cm."""
    errors = []
    for seed in range(20):
        rng, measured = np.random.default_rng(seed), Measured.guessed(1.6, 1.07)
        for n in range(60 * 30):
            if measured.asks(n / 30.0):
                step = 0.6 * np.log(1.72 / measured.about[0]) + 0.04 * rng.standard_normal()
                measured = measured.after(Shown(np.array([1e3 * step]), np.array([1e3]), 1.0), n / 30.0)
        errors.append(measured.size[0] - 1.72)
    assert np.sqrt(np.mean(np.square(errors))) < 0.03
    assert measured.weight[0] > 10.0


def test_words_on_nearly_this_size_count_in_full() -> None:
    """Half a per cent off, the next frame is asked about the same."""
    before = Measured.guessed(1.6, 1.07)
    after = before.after(Shown(np.array([5.0]), np.array([1000.0]), 1.0), 0.0)
    assert after.about == before.about
    assert after.weight[0] == pytest.approx(before.weight[0] + 1.0)


@pytest.mark.parametrize(("sign", "bound"), [(1.0, LARGEST), (-1.0, SMALLEST)])
def test_no_evidence_makes_a_giant_or_a_dwarf(sign: float, bound: tuple[float, float]) -> None:
    """Frames that ask for more and more, by points and length, end at the limits of what people are."""
    measured = Measured.guessed(1.75, 1.07)
    assert not measured.is_extreme
    for n in range(60):
        told = Shown(sign * np.array([1e5, 1e5]), np.array([1e3, 1e2]), 1.0, float(np.log(1.75)) + sign)
        measured = measured.after(told, 0.1 * n)
        assert SMALLEST[0] <= measured.size[0] <= LARGEST[0]
        assert SMALLEST[1] <= measured.size[1] <= LARGEST[1]
    assert measured.size[0] == pytest.approx(bound[0], rel=0.01)
    assert measured.is_extreme
    for n in range(60, 120):
        measured = measured.after(Shown(-told.slope, told.curvature, 1.0), 0.1 * n)
    assert abs(np.log(measured.size[0] / bound[0])) > 0.1  # it comes back


def test_frames_are_asked_ever_more_rarely() -> None:
    """Twelve a tenth of a second apart, twelve a fifth, and so on; the body changes after every third."""
    measured, asked, changed = Measured.guessed(1.7, 1.07), [], []
    for n in range(20 * 30):
        if measured.asks(n / 30.0):
            measured = measured.after(Shown(np.zeros(2), np.ones(2), 1.0), n / 30.0)
            asked.append(n)
            changed += [measured.frames] if measured.changes(1.705, 1.07) else []
    apart = np.diff(asked)
    np.testing.assert_array_equal(apart[:11], 3)
    np.testing.assert_array_equal(apart[11:23], 6)
    np.testing.assert_array_equal(apart[23:35], 12)
    assert changed == list(range(3, len(asked) + 1, 3))
    assert 40 < len(asked) < 60  # of 600


def test_bent_frames_take_no_turn_from_upright_ones() -> None:
    """After many bent frames these are asked rarely, and the first upright ones as often as any."""
    measured = Measured.guessed(1.7, 1.07)
    for n in range(24):
        measured = measured.after(Shown(np.zeros(2), np.ones(2), BENT, bent=True), 0.1 * n)
    assert not measured.asks(2.5, bent=True)
    assert measured.asks(2.5)
    assert measured.may_ask(2.5)
    measured = measured.after(Shown(np.zeros(2), np.ones(2), 1.0), 2.5)
    assert (measured.frames, measured.bent) == (25, 24)
    assert not measured.may_ask(2.51)


def test_bent_frames_are_asked_where_there_are_no_others() -> None:
    """Once a few upright ones were, they are not, however long ago that was."""
    measured = Measured.guessed(1.7, 1.07)
    assert measured.asks(0.0, bent=True)
    assert measured.may_ask(0.0)
    for n in range(3):
        assert measured.asks(0.1 * n, bent=True)
        measured = measured.after(Shown(np.zeros(2), np.ones(2), 1.0), 0.1 * n)
    assert measured.asks(9.0)
    assert not measured.asks(9.0, bent=True)


def test_bent_frames_never_outweigh_an_upright_guess() -> None:
    """A hundred of them that ask for 5 % less move it by less than 1 %; a bent one gives way."""
    told = Shown(np.array([-50.0]), np.array([1000.0]), BENT, bent=True)
    upright, bent = Measured.guessed(1.7, 1.07), Measured.guessed(1.7, 1.07, bent=True)
    for n in range(100):
        upright, bent = upright.after(told, 0.1 * n), bent.after(told, 0.1 * n)
    assert upright.size[0] == pytest.approx(1.7, rel=0.01)
    assert bent.size[0] < 0.98 * 1.7
    upright_frame = Shown(np.zeros(1), np.array([1000.0]), 1.0)
    assert bent.after(upright_frame, 10.0).size[0] == pytest.approx(bent.about[0], rel=0.002)


def test_bent_frames_count_alike_whatever_their_order() -> None:
    """One that asks for 1.5 % less among twenty moves stature by half a twentieth of that, first or last."""
    right, wrong = (
        Shown(np.array([s, 0.0]), np.array([1000.0, 100.0]), BENT, bent=True) for s in (0.0, -15.0)
    )
    found = []
    for order in ([wrong, *[right] * 19], [*[right] * 19, wrong]):
        measured = Measured.guessed(*USUAL, bent=True)
        for n, told in enumerate(order):
            measured = measured.after(told, 0.1 * n)
        found.append(measured.size)
    assert found[0] == pytest.approx(found[1])
    assert np.log(USUAL[0] / found[0][0]) == pytest.approx(0.5 * 0.015 / 20.0, rel=0.05)


def test_bent_frames_do_not_lead_each_other_away() -> None:
    """Each says 5 % less than it is asked about: a hundred of them together less than that, not ever less."""
    told = Shown(np.array([-50.0]), np.array([1000.0]), BENT, bent=True)
    measured = Measured.guessed(1.7, 1.07, bent=True)
    for n in range(100):
        measured = measured.after(told, 0.1 * n)
    assert 0.95 * 1.7 < measured.size[0] < 0.98 * 1.7
    assert measured.about[0] == 1.7


def test_bent_frames_say_as_much_of_girth_as_they_weigh() -> None:
    """Their common error is one of stature: of the 5 % that a hundred of them ask for, they bring most."""
    told = Shown(np.array([0.0, 5.0]), np.array([1000.0, 100.0]), BENT, bent=True)
    measured = Measured.guessed(*USUAL)
    for n in range(100):
        measured = measured.after(told, 0.1 * n)
    assert measured.size[0] == pytest.approx(USUAL[0])
    assert measured.size[1] > 1.07 * np.exp(0.03)


def test_who_sits_all_the_time_is_taken_for_half_as_unusual_as_found() -> None:
    """A guess of somebody sitting is as wrong as people differ; the first upright frame decides."""
    found = Measured.guessed(1.41, 1.07, bent=True)
    assert np.log(found.size[0] / 1.41) == pytest.approx(0.5 * np.log(USUAL[0] / 1.41))
    assert found.about[0] == 1.41
    upright = Shown(np.array([50.0]), np.array([1000.0]), 1.0)
    assert found.after(upright, 0.0).size[0] == pytest.approx(1.41 * np.exp(0.05), rel=0.005)


def test_who_is_found_bent_guesses_as_a_bent_frame() -> None:
    """The first guess of who squats counts a tenth of that of who stands, both beside what is usual."""
    squat = {**STANDING, **{f"{side}_{joint}_flexion": 1.6 for side in "rl" for joint in ("hip", "knee")}}
    weights = []
    for posture in (STANDING, squat):
        size = PersonSize(BODIES)
        model, pose = BODIES.tracked(1.75, 1.0, posture)
        size.guess(Start(model, pose, 1.75, 1.0, values={}))
        assert size.measured is not None
        weights.append(size.measured.weight[0])
    np.testing.assert_allclose(weights, PRIOR[0] + np.array([GUESS, BENT]))


def test_who_looks_down_stands_upright() -> None:
    """A bent neck says nothing against the frame; a length that it shortens much is none of the body."""
    whole = choose_bodies(("vc7_tilt", *BODIES.dof_names), "default").full(1.75, 1.0)
    down, far = (stance_of(whole, name_pose(whole, {"vc7_tilt": angle})) for angle in (0.35, 0.9))
    assert down.upright == far.upright == pytest.approx(1.0)
    assert down.long < 1.0
    assert not down.looks_down
    assert far.looks_down
    assert not far.bent


def test_raised_arms_count_less() -> None:
    """A hand above its shoulder, of who stands and of who bends forwards; not one held out or hanging."""
    model = start_of(1.75, 1.0).model
    assert not stance_of(model, name_pose(model, {})).raised
    assert not stance_of(model, name_pose(model, {"r_shoulder_abduct": 1.3})).raised
    assert stance_of(model, name_pose(model, {"r_shoulder_abduct": 2.2})).raised
    assert stance_of(model, name_pose(model, {"l_shoulder_flexion": 2.5, "root_rx": 1.2})).raised


def test_a_body_stays_that_differs_by_a_millimetre() -> None:
    """After some frames it is laid out anew for 5 mm, or 1 % of girth; after each for 2 cm."""
    one = replace(Measured.guessed(1.7, 1.07), frames=1)
    some = replace(one, frames=CHANGES)
    assert not some.changes(1.701, 1.071)
    assert some.changes(1.705, 1.07)
    assert some.changes(1.7, 1.08)
    assert not one.changes(1.705, 1.08)
    assert one.changes(1.72, 1.07)


def test_bent_and_badly_explained_frames_count_less() -> None:
    """In full: upright, hands down, explained; an arm overhead bends nobody, but counts a fifth."""
    model = start_of(1.75, 1.0).model
    overhead = stance_of(model, name_pose(model, {"r_shoulder_flexion": 2.5}))
    assert overhead.upright == pytest.approx(1.0)
    squat = {f"{side}_{joint}_flexion": 1.6 for side in "rl" for joint in ("hip", "knee")}
    bent, straight = stance_of(model, name_pose(model, squat)), Stance(1.0, 1.0, raised=False)
    assert bent.upright < 0.85
    assert straight.weigh(-5.0) == 1.0
    assert bent.weigh(-5.0) < 0.1
    assert straight.weigh(-20.0) == pytest.approx(0.5)
    assert overhead.weigh(-5.0) == pytest.approx(0.2)
    assert type(straight.weigh(np.float64(-20.0))) is float  # or the run could not be recorded


@pytest.mark.parametrize(("length", "within"), [(False, 0.015), (True, 0.02)])
@pytest.mark.parametrize(("stature", "girth"), [(1.82, 1.15), (1.60, 0.9)])
def test_a_rendered_person_is_measured_from_a_wrong_guess(
    stature: float, girth: float, length: bool, within: float
) -> None:
    """From 5 % and 0.15 off, six frames: within 1.5 cm, with the length 2 cm, and a girth within 0.08."""
    posture = {**STANDING, "root_tz": 2.7}
    model = BODIES.tracked(stature, girth, {})[0]
    poses = np.array([name_pose(model, {**posture, "l_elbow_flexion": 0.4 * n}) for n in range(3)])
    body = human_of(Measures.of(stature, girth))
    full = np.array([name_pose(body, {**posture, "l_elbow_flexion": 0.4 * n}) for n in range(3)])
    with DepthRenderer(CAMERA) as renderer:
        pictures = [renderer.depth(v, body.triangles) for v in pose_vertices(body, full)]
    refiner, start = DirectRefiner(), start_of(0.95 * stature, girth + 0.15)
    asker, measured = Asker(BODIES), Measured.guessed(0.95 * stature, girth + 0.15)
    for n in range(6):
        subject = isolate(frame_of(n, pictures[n % 3]), None, 3000)
        assert subject is not None
        refiner.publish(subject)
        question = asker.ask(start, measured, poses[n % 3], RULES)
        refined = refiner.submit(question.bodies, question.poses, RULES).result()
        shown = question.read(start.model, refined)
        assert shown is not None
        told = stature_by_length(start, poses[n % 3], subject) if length else None
        measured = measured.after(replace(shown, by_length=told), 0.1 * n)
        start = asker.resize(start, *measured.size)
    assert measured.size[0] == pytest.approx(stature, abs=within)
    assert measured.size[1] == pytest.approx(girth, abs=0.08)


def test_a_resized_body_is_the_one_that_is_made() -> None:
    """Of another stature and girth, what does not move held as before: the same body to a micrometre."""
    values = {**STANDING, "l_wrist_flexion": 0.5}
    model, pose = BODIES.tracked(1.7, 1.2, values)
    start = Asker(BODIES).resize(Start(model, pose, 1.7, 1.2, values), 1.64, 0.93)
    made, _ = BODIES.tracked(1.64, 0.93, values)
    for field in ("vertices", "points", "joint_points"):
        np.testing.assert_allclose(getattr(start.model, field), getattr(made, field), atol=1e-6)
    assert (start.stature, start.girth) == (1.64, 0.93)


def test_a_finer_surface_is_no_better_body() -> None:
    """The grain is what the vertices' spacing costs: four times as large for a body twice as tall."""
    small, large = start_of(1.0, 1.0).model, start_of(2.0, 1.0).model
    assert grain(large) == pytest.approx(4.0 * grain(small), rel=1e-6)


def test_the_tracker_measures_whom_it_finds_and_resumes_amid(tmp_path: Path) -> None:
    """A person of unknown size comes nearer to the true one; from the log it goes on bit for bit."""
    frames = [
        replace(frame, number=n, time_s=0.1 * n) for n, frame in enumerate(shown("standing").frames * 2)
    ]
    whole = Tracker(DirectRefiner(), SETTINGS, BODIES)
    said = []
    for n, frame in enumerate(frames):
        estimate = whole.track(frame)
        said.append(as_bytes(estimate))
        with (tmp_path / f"{n}").open("ab") as file:
            entry = Entry(estimate, whole.state.checkpoint, PoolStatistics(), 0.0)
            append_records(file.fileno(), [Began(whole.start), entry])
    assert whole.start.stature == pytest.approx(1.82, abs=0.025)
    for last in (1, 2, 4):
        recorded = read_log(tmp_path / f"{last}")
        assert recorded is not None
        resumed = Tracker(DirectRefiner(), SETTINGS, BODIES, Known(state=recorded.state))
        assert [as_bytes(resumed.track(frame)) for frame in frames[last + 1 :]] == said[last + 1 :]


def carrying(frame: DepthFrame, thick_mm: int) -> DepthFrame:
    """The frame of somebody who holds something before the belly, a third of the body high."""
    rows = np.nonzero(frame.depth.any(axis=1))[0]
    depth, height = frame.depth.copy(), rows[-1] - rows[0]
    belly = depth[rows[0] + height // 4 : rows[0] + height * 11 // 20]
    belly[belly > 0] -= thick_mm
    return replace(frame, depth=depth)


def test_a_badly_explained_person_is_recorded_and_resumed(tmp_path: Path) -> None:
    """Frames that the body explains badly count in part; with them in its log a run goes on bit for bit."""
    frames = [replace(frame, number=n, time_s=0.1 * n) for n, frame in enumerate(shown("standing").frames)]
    frames = [frames[0], *(carrying(frame, 120) for frame in frames[1:4])]
    whole, estimates, log = Tracker(DirectRefiner(), SETTINGS, BODIES), [], tmp_path / "log"
    for frame in frames:
        estimates.append(whole.track(frame))
        if frame.number < 3:
            with log.open("ab") as file:
                entry = Entry(estimates[-1], whole.state.checkpoint, PoolStatistics(), 0.0)
                append_records(file.fileno(), [Began(whole.start), entry])
    measured, recorded = whole.state.checkpoint.measured, read_log(log)
    assert measured is not None
    assert measured.frames == len(frames)
    assert 1.5 < measured.weight[0] - GUESS - PRIOR[0] < 3.5  # one in full, three in part
    assert recorded is not None
    resumed = Tracker(DirectRefiner(), SETTINGS, BODIES, Known(state=recorded.state))
    assert as_bytes(resumed.track(frames[-1])) == as_bytes(estimates[-1])


def test_a_size_that_is_known_or_not_wanted_stays() -> None:
    """Neither a given person nor a run without measuring changes its body."""
    frames = [replace(frame, time_s=0.1 * n) for n, frame in enumerate(shown("standing").frames)]
    settings = msgspec.structs.replace(SETTINGS, measure_person=False)
    fresh = Tracker(DirectRefiner(), settings, BODIES)
    for frame in frames:
        fresh.track(frame)
    assert fresh.state.checkpoint.measured is None
    joints = joint_positions(fresh.model, np.zeros((1, len(fresh.model.dof_names))))
    assert np.isfinite(joints).all()


def test_a_frame_is_asked_together_with_its_particles() -> None:
    """The sizes are refined in the request of the particles: no frame takes a second one."""
    frames = [replace(frame, time_s=0.1 * n) for n, frame in enumerate(shown("standing").frames)]
    refiner = Counting()
    tracker = Tracker(refiner, SETTINGS, BODIES)
    particles = SETTINGS.filter.particles
    tracker.track(frames[0])
    assert refiner.asked[-1] == particles + 5  # stature and girth
    refiner.asked.clear()
    tracker.track(frames[1])
    assert refiner.asked == [particles + 3]  # stature
    measured = tracker.state.checkpoint.measured
    assert measured is not None
    assert measured.frames == 2


def test_a_frame_that_explains_nobody_is_asked_and_not_heard() -> None:
    """It is asked before it is known how badly the body explains it; then its answer counts for nothing."""
    frames = [replace(frame, time_s=0.1 * n) for n, frame in enumerate(shown("standing").frames)]
    refiner = Counting()
    tracker = Tracker(refiner, SETTINGS, BODIES)
    tracker.track(frames[0])
    refiner.asked.clear()
    assert tracker.track(carrying(frames[1], 300)).status == "lost"
    assert refiner.asked == [SETTINGS.filter.particles + 3]
    measured = tracker.state.checkpoint.measured
    assert measured is not None
    assert measured.frames == 1


@pytest.mark.parametrize("by", [0.0, 100.0])
def test_what_a_frame_says_of_a_pose_that_a_rival_replaced_is_dropped(by: float) -> None:
    """The sizes were asked in the pose that was followed: where another one is believed, they say nothing."""
    frames = [replace(frame, time_s=0.1 * n) for n, frame in enumerate(shown("standing").frames)]
    refiner = DirectRefiner()
    tracker = Tracker(refiner, SETTINGS, BODIES)
    tracker.track(frames[0])
    submitted = tracker.submit(frames[1])
    assert submitted.request is not None
    assert submitted.request.question is not None
    subject, last = submitted.request.sighted.subject, submitted.request.sighted.past
    rival = Seeker(BODIES, refiner, SETTINGS).find_again(
        subject, tracker.start, tracker.rules, last, lost=False
    )
    standing = replace(rival.standing, log_likelihood=rival.standing.log_likelihood + by)
    tracked = tracker.collect(replace(submitted, rival=replace(rival, standing=standing)))
    assert tracked.belief is not None
    assert bool(np.array_equal(tracked.belief.poses[0], standing.poses[0])) == (by > 0.0)
    measured = tracked.state.checkpoint.measured
    assert measured is not None
    assert measured.frames == (1 if by else 2)


@pytest.mark.parametrize("missing", [np.nan, -np.inf])
def test_a_size_that_was_not_answered_says_nothing(missing: float) -> None:
    """With a deadline some of the five may be missing, or one diverges: the frame is passed over."""
    subject = isolate(shown("standing").frames[0], None, 2000)
    assert subject is not None

    refiner, start = InPart(missing), start_of(1.82, 1.0)
    refiner.publish(subject)
    size = PersonSize(BODIES)
    start = size.guess(start)
    before, question = size.measured, size.ask(start, start.pose, 0.5, RULES)
    later = replace(subject, frame=replace(subject.frame, time_s=0.5))
    assert before is not None
    assert question is not None
    _, answer = refiner.submit(*question.beside(start.model, start.pose[None]), RULES).result().divide(1)
    size.hear(question, answer, start, start.pose, later)
    assert size.measured is not None
    assert (size.measured.frames, size.measured.size) == (0, before.size)
    assert not size.measured.asks(0.55)
    assert size.measured.asks(0.65)
    assert size.give(start) is start


@pytest.mark.parametrize(("joint", "settled"), [("r_elbow_flexion", True), ("r_knee_flexion", False)])
def test_hypotheses_have_to_agree_about_head_and_feet_alone(joint: str, settled: bool) -> None:
    """Where a hand is says nothing of stature; where a foot is does."""
    start = start_of(1.7, 1.0)
    other = start.pose.copy()
    other[start.model.dof(joint)] += 1.0
    belief = replace(start_belief(start), poses=np.stack([start.pose, other]), log_weights=np.zeros(2))
    assert Situation(start, belief, Watch(), RULES).is_settled is settled


def start_belief(start: Start) -> Belief:
    """In the pose of a start alone."""
    return METHODS["gepf"].begin(start.model, start.pose, preset("default").filter)
