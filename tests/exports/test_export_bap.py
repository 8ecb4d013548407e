"""MPEG-4 body animation parameters: the file's fields, the standard's axes, and back to the same body."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from common.body import ROOT_DOFS, BodyModel
from common.errors import InputError
from common.kinematics import joint_positions
from coordinator.bodies.human.dofs import BODY_ANIMATION_PARAMETERS
from coordinator.bodies.human.template import human
from coordinator.exports import export_run
from coordinator.exports.bap import sign_of
from coordinator.exports.recorded import CAMERA_TO_Y_UP
from tests.support.bodies import person, puppet
from tests.support.runs import RATE, swing, write_run

Array = NDArray[np.float64]

X, Y, Z = np.eye(3)
STANDARD_AXES = {
    # The axis that decoders of the standard turn each motion about, x to the body's left, y up, z front.
    "hip_flexion": -X, "hip_abduct": Z, "hip_twisting": -Y, "knee_flexion": -X, "knee_twisting": -Y,
    "ankle_flexion": -X, "ankle_twisting": -Y, "subtalar_flexion": Z, "midtarsal_twisting": Z,
    "metatarsal_flexion": -X, "sternoclavicular_abduct": Z, "sternoclavicular_rotate": Y,
    "acromioclavicular_abduct": Z, "acromioclavicular_rotate": Y, "shoulder_flexion": -X,
    "shoulder_abduct": Z, "shoulder_twisting": -Y, "elbow_flexion": -X, "elbow_twisting": -Y,
    "wrist_flexion": -Z, "wrist_pivot": -X, "wrist_twisting": -Y, "tilt": -X, "torsion": Y, "roll": Z,
}  # fmt: skip


def read_bap(path: Path) -> tuple[list[str], list[dict[int, int] | None]]:
    """Header, and parameter -> value of each frame; None where the mask is empty."""
    head, *lines = path.read_text().splitlines()
    frames: list[dict[int, int] | None] = []
    for mask_line, value_line in zip(lines[::2], lines[1::2], strict=True):
        mask = [int(cell) for cell in mask_line.split()]
        number, *values = [int(cell) for cell in value_line.split()]
        assert len(mask) == 186
        assert set(mask) <= {0, 1}
        assert number == len(frames)
        named = [n for n, bit in enumerate(mask, start=1) if bit]
        assert len(values) == len(named)
        frames.append(dict(zip(named, values, strict=True)) or None)
    return head.split(), frames


def pose_of(frame: dict[int, int], model: BodyModel) -> Array:
    """The pose (D,) of a body that a frame describes, from the standard's definitions alone."""
    vertical, lateral, frontal, turn, roll, tilt = (frame[n] for n in range(181, 187))
    place = CAMERA_TO_Y_UP @ np.array([lateral, vertical, frontal]) / 1000.0
    turned = np.eye(3)
    for axis, angle in ((Y, turn), (Z, roll), (X, tilt)):  # the first is the outermost
        turned = turned @ Rotation.from_rotvec(axis * angle * 1e-5).as_matrix()
    root = Rotation.from_matrix(CAMERA_TO_Y_UP @ turned @ CAMERA_TO_Y_UP).as_euler("XYZ")
    values = dict(zip(ROOT_DOFS, [*place, *root], strict=True))
    for number, name in BODY_ANIMATION_PARAMETERS.items():
        values[name] = sign_of(name) * frame.get(number, 0) * 1e-5
    return np.array([values[name] for name in model.dof_names])


def test_joints_lie_where_they_were_after_the_way_there_and_back(tmp_path: Path) -> None:
    """Joints within a millimetre, angles within a hundredth of a degree; lost frames are empty."""
    model = person()
    track = write_run(tmp_path / "some run", model, swing(model, 8), lost=(5,))
    export_run(tmp_path / "some run", "bap", tmp_path / "x.bap")
    head, frames = read_bap(tmp_path / "x.bap")
    assert head == ["3.1", "some_run", f"{RATE:g}", "8"]
    assert [f for f, frame in enumerate(frames) if frame is None] == [5]
    for f, frame in enumerate(frames):
        if frame is not None:
            pose = pose_of(frame, model)
            places = joint_positions(model, pose[None])[0]
            assert np.abs(places - track.joint_positions[f]).max() < 1e-3
            assert np.degrees(np.abs(pose - track.pose[f])[6:]).max() < 0.01


@pytest.fixture(scope="module")
def full() -> BodyModel:
    """The template with every degree of freedom."""
    return human()


@pytest.mark.parametrize("number", [n for n in BODY_ANIMATION_PARAMETERS if n < 123])
def test_each_angle_turns_about_the_standard_s_axis(full: BodyModel, number: int) -> None:
    """In the rest pose, but for the arm that hangs a little off the vertical; fingers excepted."""
    name = BODY_ANIMATION_PARAMETERS[number]
    stem = name.partition("_")[2] if name[:2] in ("l_", "r_") else name.rpartition("_")[2]
    axis = CAMERA_TO_Y_UP @ full.axes[full.dof(name)] * sign_of(name)
    assert axis @ STANDARD_AXES[stem] > np.cos(np.radians(12.0))


def test_what_is_held_is_written_too(tmp_path: Path) -> None:
    """An angle that does not move but is not zero is part of the posture."""
    write_run(tmp_path / "run", person(), swing(person(), 2), held={"vl3_tilt": 0.5})
    export_run(tmp_path / "run", "bap", tmp_path / "x.bap")
    _, frames = read_bap(tmp_path / "x.bap")
    number = next(n for n, name in BODY_ANIMATION_PARAMETERS.items() if name == "vl3_tilt")
    assert [frame[number] for frame in frames if frame] == [-50_000, -50_000]


def test_a_body_that_mpeg4_does_not_know_is_refused(tmp_path: Path) -> None:
    """A robot has no parameters, and a pelvis that carries the trunk no number: one line says what to do."""
    write_run(tmp_path / "robot", puppet(), swing(puppet(), 2))
    with pytest.raises(InputError, match="not a body with 'waist_1'; choose bvh, csv"):
        export_run(tmp_path / "robot", "bap", tmp_path / "x.bap")
    write_run(tmp_path / "bent", person(), swing(person(), 2), held={"sacroiliac_tilt": 0.5})
    with pytest.raises(InputError, match="track vl5_tilt"):
        export_run(tmp_path / "bent", "bap", tmp_path / "x.bap")
    assert not (tmp_path / "x.bap").exists()
