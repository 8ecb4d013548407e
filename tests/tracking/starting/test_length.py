"""How long a person who stands is, from rendered frames: whatever the size of the model that looks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.body import ROOT_DOFS, BodyModel
from common.camera import Intrinsics
from common.frame import HIDDEN, SUBJECT, SubjectFrame
from common.kinematics import pose_vertices
from coordinator.bodies.choice import choose_bodies
from coordinator.bodies.human.measures import Measures
from coordinator.bodies.human.template import human_of
from coordinator.bodies.tracked import name_pose, scaled
from coordinator.synthesis.rendering import DepthRenderer
from coordinator.tracking.observing.subject import isolate
from coordinator.tracking.starting.length import measure_length
from coordinator.tracking.starting.person_size import PersonSize, is_held_bent, stature_by_length
from coordinator.tracking.starting.start import Start
from coordinator.tracking.starting.uprightness import stance_of
from gepf.direct import DirectRefiner
from tests.support.people import CAMERA, SETTINGS, STANDING, frame_of

STATURE = 1.7
TEMPLATE_SHOWN = 0.967  # of a rendered template's stature, whose crown is narrow; of people it is SHOWN
POSTURE = {**STANDING, "root_tz": 2.7}
BODIES = choose_bodies(None, "default")
MODEL = BODIES.tracked(STATURE, 1.0, {})[0]


def subject_in(posture: dict[str, float], camera: Intrinsics = CAMERA) -> SubjectFrame:
    """A rendered person of STATURE in a posture."""
    body = human_of(Measures.of(STATURE, 1.0))
    surface = pose_vertices(body, name_pose(body, posture)[None])[0]
    with DepthRenderer(camera) as renderer:
        frame = replace(frame_of(0, renderer.depth(surface, body.triangles)), intrinsics=camera)
    subject = isolate(frame, None, 3000)
    assert subject is not None
    return subject


def length_in(posture: dict[str, float], model: BodyModel = MODEL) -> float | None:
    """The length that a frame shows of a person in a posture, looked at with a model in the same."""
    return measure_length(model, name_pose(model, posture), subject_in(posture))


@pytest.mark.parametrize("factor", [0.94, 1.0, 1.06])
def test_length_is_the_persons_not_the_models(factor: float) -> None:
    """A model that is too small or too large by 6 % measures the same, but for 1 cm, and nearly all of it."""
    length = length_in(POSTURE, scaled(MODEL, factor))
    assert length == pytest.approx(length_in(POSTURE), abs=0.01)
    assert length == pytest.approx(TEMPLATE_SHOWN * STATURE, abs=0.01)


@pytest.mark.parametrize("finer", [2, 3])
def test_length_is_the_persons_not_the_cameras(finer: int) -> None:
    """A camera of more pixels measures the same, but for 1.5 cm."""
    width, height, focal = finer * CAMERA.width, finer * CAMERA.height, finer * CAMERA.fx
    sharp = Intrinsics(width, height, focal, focal, 0.5 * (width - 1), 0.5 * (height - 1))
    length = measure_length(MODEL, name_pose(MODEL, POSTURE), subject_in(POSTURE, sharp))
    assert length == pytest.approx(length_in(POSTURE), abs=0.015)


def test_legs_apart_are_as_long() -> None:
    """Who stands astride is as long as with the feet together."""
    astride = {**POSTURE, "l_hip_abduct": 0.25, "r_hip_abduct": 0.25}
    assert length_in(astride) == pytest.approx(length_in(POSTURE), abs=0.03)


def test_nothing_is_said_without_head_or_feet() -> None:
    """With the feet cut off by something nearer, outside of the picture, or a hand at the head."""
    whole = subject_in(POSTURE)
    rows = whole.frame.depth.shape[0]
    depth = whole.frame.depth.copy()
    depth[rows * 17 // 20 :] = 0
    kinds = np.where(depth > 0, SUBJECT, 0).astype(np.uint8)
    kinds[rows * 17 // 20 :] = HIDDEN
    pose = name_pose(MODEL, POSTURE)
    covered = replace(whole, frame=replace(whole.frame, depth=depth), kinds=kinds)
    assert measure_length(MODEL, pose, whole) is not None
    assert measure_length(MODEL, pose, covered) is None
    left, top, right, _ = whole.view
    outside = replace(whole, frame=covered.frame, view=(left, top, right, rows * 17 // 20))
    assert measure_length(MODEL, pose, outside) is None
    assert length_in({**POSTURE, "l_shoulder_flexion": 2.0, "l_elbow_flexion": 1.8}) is None


def test_stature_follows_from_length() -> None:
    """To within 4.5 % of a rendered person's; who squats is bent, and who stands is not."""
    squat = {**POSTURE, **{f"{s}_{joint}_flexion": 1.2 for s in "rl" for joint in ("hip", "knee")}}
    start = Start(MODEL, name_pose(MODEL, POSTURE), STATURE, 1.0)
    stature = stature_by_length(start, start.pose, subject_in(POSTURE))
    assert stature == pytest.approx(np.log(STATURE), abs=0.045)
    assert not stance_of(MODEL, start.pose).bent
    assert stance_of(MODEL, name_pose(MODEL, squat)).bent


@pytest.mark.parametrize(("neck", "bent"), [(0.1, False), (0.9, True)])
def test_who_is_held_looking_down_is_held_bent(neck: float, bent: bool) -> None:
    """Where the neck does not move, nothing else says later that the head was low."""
    bodies = choose_bodies(tuple(name for name in MODEL.dof_names if name != "vc7_tilt"), "default")
    held = {**STANDING, "vc7_tilt": neck}
    model, pose = bodies.tracked(STATURE, 1.0, held)
    assert is_held_bent(Start(model, pose, STATURE, 1.0, held), bodies) == bent


def test_who_sits_with_legs_that_do_not_move_is_not_taken_for_short() -> None:
    """Straight as the rest of the body is, head and soles are as far apart as the held legs have them."""
    sitting = {**POSTURE, **{f"{s}_{joint}_flexion": 1.4 for s in "rl" for joint in ("hip", "knee")}}
    bodies = choose_bodies((*ROOT_DOFS, "r_shoulder_flexion", "l_shoulder_flexion"), "default")
    model, pose = bodies.tracked(STATURE, 1.0, sitting)
    start, subject = Start(model, pose, STATURE, 1.0, sitting), subject_in(sitting)
    assert not stance_of(model, pose).bent
    shown = stature_by_length(start, pose, subject)
    assert shown is not None
    assert shown < np.log(0.9 * STATURE)
    refiner = DirectRefiner()
    refiner.publish(subject)
    size = PersonSize(bodies)
    start = size.guess(start)
    for n in range(12):
        later = replace(subject, frame=replace(subject.frame, time_s=0.1 * n))
        question = size.ask(start, pose, 0.1 * n, SETTINGS.refine)
        assert question is not None
        answer = refiner.submit(question.bodies, question.poses, SETTINGS.refine).result()
        size.hear(question, answer, start, pose, later)
        start = size.give(start)
    assert size.measured is not None
    assert size.measured.frames == 12
    assert size.measured.size[0] == pytest.approx(STATURE, rel=0.03)


@pytest.mark.parametrize("leaning", [0.1, 0.2])
def test_who_leans_a_little_is_as_tall(leaning: float) -> None:
    """At the waist, or with bent knees above flat feet: straightened, within 1 cm."""
    bends = {"hip": leaning, "knee": 2.0 * leaning, "ankle": leaning}
    knees = {f"{side}_{joint}_flexion": bend for side in "rl" for joint, bend in bends.items()}
    standing = Start(MODEL, name_pose(MODEL, POSTURE), STATURE, 1.0)
    expected = stature_by_length(standing, standing.pose, subject_in(POSTURE))
    assert expected is not None
    for lean in ({"vl3_tilt": 2.0 * leaning}, knees):
        posture = {**POSTURE, **lean}
        start = replace(standing, pose=name_pose(MODEL, posture))
        stature = stature_by_length(start, start.pose, subject_in(posture))
        assert stature == pytest.approx(expected, abs=0.006)
