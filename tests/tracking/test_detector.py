"""The detector in a single rendered frame, and the distinction of front and back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.camera import back_project
from gepf.common.frame import SubjectFrame
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.common.refinement import Particles, Refined
from gepf.coordinator.bodies.family import Bodies
from gepf.coordinator.bodies.human.people import people_network
from gepf.coordinator.bodies.human.shape_space import Size
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.mechanisms import MECHANISMS
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.bodies.urdf import read_urdf
from gepf.coordinator.scene.noise import NO_NOISE
from gepf.coordinator.scene.planes import Planes
from gepf.coordinator.settings import preset
from gepf.coordinator.tracking.detector import Detector
from gepf.coordinator.tracking.judgement import Gate
from gepf.coordinator.tracking.pose_candidates import Detection, PoseCandidates
from gepf.coordinator.tracking.refiner import Request
from gepf.coordinator.tracking.segmenter import UntrackedPerson
from gepf.coordinator.tracking.state import start_at
from gepf.coordinator.tracking.warm_up import unmoved
from gepf.refiners import DirectRefiner
from tests.support.people import (
    SETTINGS,
    STANDING,
    OnePerson,
    changed,
    complete,
    empty,
    frame_of,
    known,
    people,
    rendered,
    show,
    subject_of,
)

BRACKET = Path(__file__).parents[2] / "examples" / "bracket.urdf"
KNEELING = {
    "root_tz": 2.6, "root_ty": 0.2, "root_ry": 2.6, "r_shoulder_flexion": 2.7, "l_shoulder_abduct": 1.3,
    "l_knee_flexion": 1.6, "r_knee_flexion": 1.6,
}  # fmt: skip
MODEL = human(1.82)
NAMES = MODEL.joint_names
FRONT, BACK = 0.0, np.pi  # of the root's turn
NO_SHAPE = np.empty((0, 0))


class Plain(DirectRefiner):
    """Is never asked for a covariance."""

    def submit(self, subject: SubjectFrame, model: BodyModel, particles: Particles) -> Request:
        """As in the base class."""
        assert not particles.covariance
        return super().submit(subject, model, particles)


def detect(bodies: Bodies, model: BodyModel, pose: Array) -> tuple[Detection, BodyModel]:
    """What is detected in a frame that shows a pose. Candidates are never asked for their covariance."""
    subject = subject_of(show(model, pose[None]).frames[0], 2_000)
    found = complete(
        Detector(bodies, Plain(), preset("default")).detect(UntrackedPerson(subject), NO_NOISE, Planes())
    )
    return found, found.start.model


@pytest.mark.parametrize(
    ("values", "size"),
    [
        (KNEELING, Size(1.75, 1.05)),
        ({"root_tz": 2.6, "root_rz": np.pi, "r_shoulder_abduct": 1.0}, Size(1.75, 1.05)),
        ({"root_tz": 2.0}, Size(1.1, 1.05)),
        ({"root_tz": 2.0}, Size(1.1, 1.05, 1.0)),
        ({"root_tz": 2.0}, Size(1.44, 1.05, 1.0)),
    ],
    ids=["kneels", "head down", "child", "small adult", "short adult"],
)
def test_a_person_is_detected_in_an_unusual_pose_and_of_any_size(
    values: dict[str, float], size: Size
) -> None:
    """Kneeling with the back to the camera and an arm overhead; upside down, as the camera may be; small."""
    model = people().for_start(*size)
    pose = name_pose(model, values)
    found, tracked = detect(people(), model, pose)
    off = found.candidates.joints[0] - joint_positions(model, pose[None])[0]
    assert np.median(np.linalg.norm(off, axis=-1)) < 0.05
    assert Size(*found.start.size).stature == pytest.approx(size.stature, rel=0.1)
    assert Size(*found.start.size).maturity == pytest.approx(size.maturity, abs=0.4)
    assert np.all(np.diff(found.candidates.log_posterior) <= 0.0)
    assert tracked.joint_names == model.joint_names


def test_the_front_of_a_seat_is_not_taken_for_a_part_of_the_person() -> None:
    """A box half a metre wide below a person who sits on it, turned by 40 degrees.

    The pixels that look like a body are searched first.
    """
    model = people().for_start(1.75, 1.05)
    bent = dict.fromkeys((f"{side}_{joint}_flexion" for side in "lr" for joint in ("hip", "knee")), 1.5)
    pose = name_pose(model, {"root_tz": 2.8, "root_ty": 0.3, "root_ry": 0.7, **bent})
    truth = joint_positions(model, pose[None])[0]
    pelvis, ankle = truth[NAMES.index("pelvis")], truth[NAMES.index("right_ankle")]
    frame = show(model, pose[None]).frames[0]
    (view,), front = frame.views, pelvis[2] - 0.12
    x, y, _ = np.moveaxis(back_project(np.full(view.depth.shape, front), view.intrinsics), -1, 0)
    box = (np.abs(x - pelvis[0]) < 0.25) & (pelvis[1] + 0.08 < y) & (y < ankle[1] + 0.05)
    depth = np.where(box & (view.depth == 0), np.uint16(front * view.depth_scale), view.depth)
    whole = changed(frame, depth=depth)
    metres, camera = whole.views[0].metres(), whole.views[0].intrinsics
    seen, down = depth > 0, np.array([0.0, 1.0])
    own = people_network().probabilities(metres.astype(np.float32), camera, seen, seen, down) > 0.5
    body = subject_of(changed(frame, depth=np.where(own, depth, np.uint16(0))), 2_000)
    person = UntrackedPerson(subject_of(whole, 2_000), body=body)
    found = complete(Detector(people(), DirectRefiner(), SETTINGS).detect(person, NO_NOISE, Planes()))
    assert found.gate.passes
    assert found.subject is body
    assert np.linalg.norm(found.candidates.joints[0] - truth, axis=-1).max() < 0.05
    assert Size(*found.start.size).stature == pytest.approx(1.75, rel=0.04)


def test_any_other_body_is_detected_however_it_is_turned() -> None:
    """A bracket of a URDF file: its whole surface lies where it is shown."""
    model = read_urdf(BRACKET)
    body = MECHANISMS.given(model, None, "default")
    poses = MECHANISMS.draw_poses(model, 3, np.random.default_rng(4))
    poses[:, 2] = 0.8
    for pose in poses:
        found, tracked = detect(body, model, pose)
        off = pose_vertices(tracked, found.candidates.poses[:1])[0] - pose_vertices(model, pose[None])[0]
        assert np.linalg.norm(off, axis=-1).max() < 0.01


def test_a_known_person_is_detected_elsewhere_in_slices_between_other_work() -> None:
    """A metre to the side, in another posture. Frames published between slices change nothing.

    The result moves to a later frame.
    """
    bodies = known()
    start = start_at(STANDING, bodies)
    values = {**STANDING, "root_tx": 0.9, "l_elbow_flexion": 1.2}
    moved = np.array([name_pose(start.model, {**values, "root_tx": x}) for x in (0.9, 0.7)])
    before, now = (subject_of(frame, 2_000) for frame in show(start.model, moved).frames)
    truth = joint_positions(start.model, moved)
    refiner = DirectRefiner()
    detector = Detector(bodies, refiner, SETTINGS)
    searches = [
        detector.redetect(before, start, SETTINGS.refine, start.pose, NO_SHAPE, lost=True) for _ in range(2)
    ]
    for _ in range(3):
        next(searches[1])
        refiner.publish(now)
    whole, found = map(complete, searches)
    np.testing.assert_array_equal(found.candidates.poses, whole.candidates.poses)
    assert found.is_elsewhere(joint_positions(start.model, start.pose[None])[0], 0.15)
    later = detector.transfer(found, now, SETTINGS.refine)
    for each, joints in zip((found, later), truth, strict=True):
        assert each.gate.passes
        assert np.linalg.norm(each.candidates.joints[0] - joints, axis=-1).max() < 0.1


@pytest.mark.parametrize("extra", ["arm", "board"])
def test_what_may_be_the_persons_is_used_if_a_body_explains_it(extra: str) -> None:
    """A raised arm that was left out belongs to the person, and a board that hangs beside them does not."""
    pose = name_pose(MODEL, {**STANDING, "l_shoulder_abduct": 1.5})
    (whole,) = show(MODEL, pose[None]).frames
    depth = whole.views[0].depth.copy()
    columns = np.flatnonzero(depth.any(axis=0))
    first = columns[-1] - len(columns) // 3
    if extra == "arm":
        depth[:, first:] = 0
    else:
        whole = changed(whole, depth=depth.copy())
        whole.views[0].depth[40:160, columns[-1] + 1 : columns[-1] + 60] = 2600
    wider = subject_of(whole, 2_000)
    subject, detector = (
        subject_of(changed(whole, depth=depth), 2_000),
        Detector(people(), DirectRefiner(), SETTINGS),
    )
    found = complete(detector.detect(UntrackedPerson(subject, (wider,)), NO_NOISE, Planes()))
    assert (found.subject is wider) is (extra == "arm")
    off = found.candidates.joints[0] - joint_positions(MODEL, pose[None])[0]
    assert np.linalg.norm(off, axis=-1).max() < 0.12


def candidates(log_likelihood: list[float], *turns: float, model: BodyModel = MODEL) -> PoseCandidates:
    """Candidates whose root is turned so, with these log likelihoods."""
    poses = np.array([name_pose(model, {**STANDING, "root_ry": turn}) for turn in turns])
    prior, residual = np.zeros((2, len(turns)))
    return PoseCandidates(poses, np.array(log_likelihood), prior, residual, joint_positions(model, poses))


def test_only_candidates_that_differ_go_on_and_one_that_faces_the_other_way() -> None:
    """The likeliest first; one that faces away is kept to the end, however unlikely."""
    alike = candidates([-1.0, -2.0, -3.0, -30.0, -40.0], FRONT, FRONT + 0.01, 1.0, BACK, BACK + 0.6)
    kept = alike.distinct(MODEL, 2, 0.05)
    assert kept.log_posterior.tolist() == [-1.0, -3.0, -30.0]
    assert alike.distinct(MODEL, 9, 0.05).log_posterior.tolist() == [-1.0, -3.0, -30.0, -40.0]


@pytest.mark.parametrize(("behind", "ambiguous"), [(0.5, True), (20.0, False)])
def test_front_and_back_are_ambiguous_where_the_frame_does_not_tell_them_apart(
    behind: float, ambiguous: bool
) -> None:
    """A candidate that faces away counts only if it explains the frame about as well."""
    start = start_at(STANDING, known())
    found = candidates([-5.0, -5.0 - behind], FRONT, BACK, model=start.model)
    subject = subject_of(show(start.model, found.poses[:1]).frames[0], 300)
    detection = Detection(subject, start, found, Gate(0.5))
    assert detection.facing_is_ambiguous(found.joints[0], -5.0, 2.0) is ambiguous


@pytest.mark.parametrize("turn", [FRONT, BACK])
def test_a_person_who_comes_back_faces_the_way_that_is_seen(turn: float) -> None:
    """After frames that show nothing, as before or turned round, with arms hanging alike."""
    rng = np.random.default_rng(0)
    poses = np.array([name_pose(MODEL, {**STANDING, "root_ry": each}) for each in (FRONT, turn)])
    truth = joint_positions(MODEL, poses)
    first, then = rendered(MODEL, poses)
    shown_frames = [(first, truth[0])] * 2 + [None] * 3 + [(then, truth[1])] * 3
    tracker = OnePerson(DirectRefiner(), SETTINGS, known(), start=STANDING)
    sides = [NAMES.index(f"{side}_shoulder") for side in ("left", "right")]
    for number, each in enumerate(shown_frames):
        if each is None:
            assert tracker.track(empty(number)).status == "absent"
            continue
        depth, joints = each
        noisy = np.where(depth > 0.0, depth + 0.03 * rng.standard_normal(depth.shape), 0.0)
        estimate = tracker.track(frame_of(number, noisy))
        assert estimate.status in ("tracked", "ambiguous")
        found = estimate.joint_positions
        assert (found[sides[0]] - found[sides[1]]) @ (joints[sides[0]] - joints[sides[1]]) > 0.0
        assert np.linalg.norm(found - joints, axis=-1).mean() < 0.05


def test_a_smaller_body_in_a_part_of_the_person_is_not_preferred() -> None:
    """Raised arms hide where the upper part continues; a child would explain the rest a little better."""
    model = human(1.9, 0.9)
    raised = {
        "l_shoulder_abduct": 1.8,
        "l_elbow_flexion": 1.5,
        "r_shoulder_flexion": 2.0,
        "r_elbow_flexion": 1.5,
    }
    pose = name_pose(model, {**STANDING, **raised, "root_ry": -0.7})
    (whole,) = show(model, pose[None]).frames
    depth = whole.views[0].depth.copy()
    rows = np.flatnonzero(depth.any(axis=1))
    depth[: rows[int(0.4 * len(rows))]] = 0
    wider = subject_of(whole, 2_000)
    subject, detector = (
        subject_of(changed(whole, depth=depth), 2_000),
        Detector(people(), DirectRefiner(), SETTINGS),
    )
    found = complete(detector.detect(UntrackedPerson(subject, (wider,)), NO_NOISE, Planes()))
    assert found.subject is wider
    assert Size(*found.start.size).stature == pytest.approx(1.9, rel=0.03)


class Blind(DirectRefiner):
    """Workers to which no body is visible."""

    def refine(self, _subject: SubjectFrame, _model: BodyModel, particles: Particles) -> Refined:
        """The poses as they were, infinitely unlikely, as the kernel answers."""
        count = len(particles.poses)
        return replace(
            unmoved(particles), log_likelihood=np.full(count, -np.inf), residual=np.full(count, np.nan)
        )


def test_a_search_in_which_no_candidate_is_visible_finds_nobody() -> None:
    """A first one, with any size, and one for a known body; the reason is that none fits."""
    subject = subject_of(show(MODEL, name_pose(MODEL, STANDING)[None]).frames[0], 2_000)
    detector = Detector(people(), Blind(), SETTINGS)
    first = complete(detector.detect(UntrackedPerson(subject), NO_NOISE, Planes()))
    start = start_at(STANDING, people(), Size(1.82, 1.05))
    later = complete(detector.redetect(subject, start, SETTINGS.refine, start.pose, NO_SHAPE, lost=True))
    for found in (first, later, detector.transfer(later, replace(subject), SETTINGS.refine)):
        assert not found.gate.passes
        assert found.gate.why == "the body does not fit the observed points"
        assert not found.facing_is_ambiguous(found.candidates.joints[0], 0.0, 2.0)


def test_a_person_in_whom_no_candidate_is_visible_is_searched_for() -> None:
    """The run goes on without an error."""
    still = show(MODEL, name_pose(MODEL, STANDING)[None]).frames[0]
    tracker = OnePerson(Blind(), SETTINGS, people())
    frames = (changed(still, number=n, time_s=n / 30) for n in range(3))
    assert [tracker.track(frame).status for frame in frames] == ["searching"] * 3
