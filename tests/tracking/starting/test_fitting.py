"""`gepf fit`: a person of other proportions than the template's is measured from rendered frames."""

from __future__ import annotations

import json
from contextlib import nullcontext
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from common.activation import activate
from common.body import BodyModel
from common.camera import Intrinsics
from common.frame import DepthFrame
from common.kinematics import joint_positions, pose_vertices
from common.settings import preset
from coordinator.bodies.choice import USUAL as USUAL_DOFS
from coordinator.bodies.choice import choose_bodies, load_body, person, read_person, write_person
from coordinator.bodies.human.measures import Measures
from coordinator.bodies.human.shape_space import shape_space
from coordinator.bodies.human.template import human_of
from coordinator.bodies.tracked import name_pose
from coordinator.cli import main
from coordinator.cli.surroundings import on_stderr
from coordinator.commands.fit import builder, explained_well, run_fit
from coordinator.commands.options.arguments import FitOptions
from coordinator.synthesis.rendering import DepthRenderer
from coordinator.tracking.observing.subject import isolate
from coordinator.tracking.starting.fitting import (
    FARTHEST,
    MEASURES,
    Fit,
    Fitter,
    Posed,
    Sweeps,
    better,
    change,
    rarity,
)
from gepf.direct import DirectRefiner
from tests.support.refusals import refused
from tests.support.small_sequence import write_small_sequence

Array = NDArray[np.float64]

CAMERA = Intrinsics(320, 240, 290.0, 290.0, 159.5, 119.5)
USUAL = Measures.of(1.75)
OTHER = Measures.of(1.75, upper_arm=0.90 * USUAL.upper_arm, thigh=1.10 * USUAL.thigh)
POSTURES = (
    {"r_shoulder_abduct": 0.9, "r_elbow_flexion": 1.2, "l_shoulder_abduct": 0.3, "l_elbow_flexion": 0.8},
    {"r_shoulder_abduct": 0.4, "l_shoulder_abduct": 1.0, "l_elbow_flexion": 1.3, "r_hip_abduct": 0.4},
    {"r_elbow_flexion": 1.0, "l_shoulder_abduct": 0.6, "l_elbow_flexion": 0.4, "l_hip_abduct": 0.35},
)


@cache
def build(measures: Measures) -> BodyModel:
    """The tracked body of a person who is meshed anew: not the surface that is moved to fit."""
    full = human_of(measures)
    return activate(full, USUAL_DOFS["default"], np.zeros(len(full.dof_names)))


def seen(measures: Measures) -> tuple[list[Posed], Array]:
    """Frames of a person with the poses that they were rendered in, and the joints (F, J, 3)."""
    model = build(measures)
    poses = np.array([name_pose(model, {"root_tz": 2.7, **posture}) for posture in POSTURES])
    with DepthRenderer(CAMERA) as renderer:
        pictures = [renderer.depth(v, model.triangles) for v in pose_vertices(model, poses)]
    frames = []
    for n, picture in enumerate(pictures):
        depth = np.rint(picture * 1000.0).astype(np.uint16)
        subject = isolate(DepthFrame(n, n / 30.0, depth, 1000.0, CAMERA), None, 2000)
        assert subject is not None
        frames.append(Posed(subject, poses[n]))
    return frames, joint_positions(model, poses)


def test_a_person_of_other_proportions_is_measured() -> None:
    """Short upper arms and long thighs are found, and the joints come nearer to the truth."""
    frames, truth = seen(OTHER)
    fitted, sweeps = builder({}, "default"), Sweeps(("upper_arm", "thigh"))
    fitter = Fitter(frames, fitted, DirectRefiner(), preset("default").refine, sweeps)
    before, after = fitter.fit(USUAL)
    assert after.measures.upper_arm < 0.96 * USUAL.upper_arm
    assert after.measures.thigh > 1.04 * USUAL.thigh
    assert after.residual.mean() < before.residual.mean()

    def joint_error(fit: Fit) -> float:
        joints = joint_positions(fitted(fit.measures), np.array(fit.poses))
        return float(np.linalg.norm(joints - truth, axis=-1).mean())

    assert joint_error(after) < 0.75 * joint_error(before)


def test_a_gain_by_chance_changes_nothing() -> None:
    """A change is taken for gaining a little in every frame, not for gaining more in a few of them."""

    def fit(measures: Measures, log_likelihood: list[float]) -> Fit:
        return Fit(measures, [], np.array(log_likelihood), np.zeros(4))

    stays = fit(USUAL, [-9.0, -9.0, -9.0, -9.0])
    longer = change(USUAL, "thigh", 1.02)
    assert better(stays, fit(longer, [-8.8, -8.9, -8.8, -8.9])).measures is longer
    assert better(stays, fit(longer, [-5.0, -9.2, -9.1, -9.2])) is stays
    assert better(stays, fit(longer, [-9.1, -9.0, -9.0, -9.0])) is stays


def test_frames_that_are_explained_badly_are_left_out() -> None:
    """Half of them, those with the larger residuals; all where all are alike."""
    subject = isolate(DepthFrame(0, 0.0, np.ones((4, 4), np.uint16), 1000.0, CAMERA), None, 9)
    assert subject is not None
    frames = [Posed(subject, np.zeros(3)) for _ in range(4)]
    chosen = explained_well(list(zip([4.0, 1.0, 3.0, 2.0], frames, strict=True)))
    assert [frames.index(frame) for frame in chosen] == [1, 3]
    assert len(explained_well([(1.0, frame) for frame in frames])) == 4


@pytest.mark.parametrize("out", ["person.txt", "person", "taken.json", "file/person.json"])
def test_a_place_that_cannot_be_written_is_refused_before_anything_is_tracked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], out: str
) -> None:
    """A name that --model would not know, a folder, a place below a file; the sequence is not looked at."""
    (tmp_path / "taken.json").mkdir()
    (tmp_path / "file").write_text("")
    assert main(["fit", str(tmp_path / "nowhere"), "--out", str(tmp_path / out)]) == 2
    said = capsys.readouterr().err
    assert str(tmp_path / out) in said
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize("name", MEASURES)
def test_no_measure_leaves_what_people_have(name: str) -> None:
    """Enlarged again and again, a length ends at the farthest from what stature implies, and costs more."""
    changed = USUAL
    for _ in range(10):
        changed = change(changed, name, 1.04)
    if name == "stature":
        assert rarity(changed) == pytest.approx(0.0)
        assert changed.thigh / changed.stature == pytest.approx(USUAL.thigh / USUAL.stature)
    else:
        most = 1 + (2 * FARTHEST if name == "girth" else FARTHEST)
        assert getattr(changed, name) == pytest.approx(most * getattr(USUAL, name))
        assert (rarity(changed) > 0.0) == (name != "girth")


def test_a_person_file_holds_what_was_measured(tmp_path: Path) -> None:
    """Written and read again: the same to a tenth of a millimetre, and a model that is tracked with them."""
    write_person(OTHER, tmp_path / "new" / "person.json")
    read = read_person(tmp_path / "new" / "person.json")
    assert read.thigh == pytest.approx(OTHER.thigh, abs=6e-5)
    bodies = choose_bodies(None, "default", str(tmp_path / "new" / "person.json"))
    assert bodies.measures == (1.75, 1.0)
    assert bodies.people
    model = bodies.tracked(1.0, 1.0, {})[0]  # measures of a file are not changed by what is sought
    np.testing.assert_allclose(model.joint_points, build(OTHER).joint_points, atol=1e-3)


def test_what_was_fitted_is_what_is_tracked(tmp_path: Path) -> None:
    """Byte by byte: the body of fitted measures, of their file, and of the library given the measures."""
    write_person(change(OTHER, "girth", 1.07), tmp_path / "person.json")
    measures = read_person(tmp_path / "person.json")
    fitted = builder({}, "default")(measures)
    for bodies in (
        choose_bodies(None, "default", str(tmp_path / "person.json")),
        person(measures, None, "default"),
    ):
        assert bodies.tracked(measures.stature, measures.girth, {})[0].hash == fitted.hash
    assert load_body(str(tmp_path / "person.json")).hash == shape_space().person(measures).hash


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('{"stature": 1.8, "nose": 0.05}', "unknown measure 'nose'"),
        ('{"stature": 9}', "no person's"),
        ('{"stature": 1.8, "thigh": 1.4}', "does not fit a stature"),
        ('{"stature": "tall"}', 'stature is "tall"; give a finite number'),
        ("[]", "write {measure: metres}"),
        ("{", "write {measure: metres}"),
    ],
)
def test_what_is_no_person_is_refused(text: str, says: str, tmp_path: Path) -> None:
    """One line names the file, what is wrong and what to give."""
    file = tmp_path / "person.json"
    file.write_text(text)
    with refused(says) as caught:
        read_person(file)
    assert str(file) in str(caught.value)


def test_the_command_writes_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`gepf fit SEQ --out FILE` writes measures that --model reads, and reports the residuals."""
    write_small_sequence(tmp_path / "seq", 2)
    options = FitOptions(tmp_path / "seq", tmp_path / "person.json", as_json=True)
    run_fit(options, on_stderr(), lambda *_: nullcontext(DirectRefiner()), Sweeps(("girth",), (0.05,)))
    out, err = capsys.readouterr()
    assert out == (tmp_path / "person.json").read_text()
    said = " ".join(err.split())
    assert "mm before" in said
    assert "track with --model" in said
    assert (
        json.loads((tmp_path / "person.json").read_text())["girth"]
        == read_person(tmp_path / "person.json").girth
    )
