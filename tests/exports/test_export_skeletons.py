"""Exports with a skeleton or markers, read by independent readers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trc

from gepf.common.body import BodyModel
from gepf.common.errors import InputError
from gepf.coordinator.exports import export_run
from gepf.coordinator.exports.axes import CAMERA_TO_OPENSIM, CAMERA_TO_Y_UP
from gepf.coordinator.results.track import write_track
from tests.support.bodies import hinges, person
from tests.support.export_readers import bvh_joints, bvhio, plain_bvh_joints
from tests.support.runs import RATE, swing, write_and_export, write_run

MILLIMETRE = 1e-3


@pytest.mark.parametrize("model", [person(), hinges()], ids=["person", "hinges"])
def test_a_bvh_reader_finds_every_joint_where_the_track_has_it(tmp_path: Path, model: BodyModel) -> None:
    """bvhio's own forward kinematics from the angles: within a tenth of a millimetre."""
    track, file = write_and_export(tmp_path, "bvh", model, 6)
    read = bvh_joints(file, model.joint_names, 6) / 100.0
    expected = track.joint_positions @ CAMERA_TO_Y_UP
    assert np.abs(read - expected).max() < 0.1 * MILLIMETRE


@pytest.mark.parametrize("translates", [False, True])
def test_a_person_s_bvh_needs_no_translations_of_joints(tmp_path: Path, translates: bool) -> None:
    """Importers that move only the root, and those that move all joints, find every joint, too.

    Only the root has six channels, and offsets are those of the rest pose.
    """
    model = person()
    track, file = write_and_export(tmp_path, "bvh", model, 6, lost=(2,))
    read = plain_bvh_joints(file, model.joint_names, translates=translates) / 100.0
    assert np.abs(read - track.joint_positions @ CAMERA_TO_Y_UP).max() < 0.1 * MILLIMETRE
    channels = [line.split()[1] for line in file.read_text().splitlines() if "CHANNELS" in line]
    assert channels == ["6", *["3"] * (len(channels) - 1)]


def test_a_bvh_has_the_rate_the_names_and_the_tree_of_the_run(tmp_path: Path) -> None:
    """Frame time, one root, a limb's joints in a row, and an end for each."""
    read = bvhio.readAsBvh(str(write_and_export(tmp_path, "bvh", person(), 3)[1]))
    assert (read.FrameTime, read.FrameCount) == (pytest.approx(1.0 / RATE), 3)
    assert read.Root.Name == "pelvis"
    above = {child.Name: joint.Name for joint, _, _ in read.Root.layout() for child in joint.Children}
    assert (above["right_wrist"], above["right_elbow"]) == ("right_elbow", "right_shoulder")
    assert set(person().joint_names) <= {"pelvis", *above}


def test_a_bvh_lasts_as_long_as_the_run(tmp_path: Path) -> None:
    """A gap of 27 frames and a frame that is late: whoever plays it sees every pose at its time.

    In the gap the body moves evenly.
    """
    model = person()
    poses = swing(model, 12)
    numbers = np.array([0, 1, 2, 3, 30, 31, 32, 34, 35, 36, 37, 38])
    track = write_run(tmp_path / "run", model, poses, frames=numbers)
    export_run(tmp_path / "run", "bvh", tmp_path / "run.bvh")
    read = bvhio.readAsBvh(str(tmp_path / "run.bvh"))
    assert (read.FrameTime, read.FrameCount) == (pytest.approx(1.0 / RATE), 39)
    places = bvh_joints(tmp_path / "run.bvh", model.joint_names, 39) / 100.0
    expected = track.joint_positions @ CAMERA_TO_Y_UP
    assert np.abs(places[numbers] - expected).max() < 0.1 * MILLIMETRE
    pelvis = places[3:31, model.joint_names.index("pelvis")]
    np.testing.assert_allclose(pelvis, np.linspace(pelvis[0], pelvis[-1], 28), atol=1e-5)


def test_a_bvh_of_a_clock_that_was_set(tmp_path: Path) -> None:
    """Back: one frame passes, as for who sees it. Far ahead: one line names a format that has times."""
    model = hinges()
    track = write_run(tmp_path / "run", model, swing(model, 6))
    is_later = np.arange(6) > 2

    def export(step_s: float) -> None:
        with (tmp_path / "run" / "track.npz").open("wb") as file:
            write_track(replace(track, time_s=track.time_s + step_s * is_later), file)
        export_run(tmp_path / "run", "bvh", tmp_path / "run.bvh")

    export(-9.0)
    assert bvhio.readAsBvh(str(tmp_path / "run.bvh")).FrameCount == 6
    with pytest.raises(InputError, match=r"the run lasts 277778 h, .* export it as glb"):
        export(1e9)


def test_a_trc_reader_finds_every_marker_where_the_track_has_it(tmp_path: Path) -> None:
    """Names, rate, times and positions; lost frames have no markers."""
    model = person()
    track, file = write_and_export(tmp_path, "trc", model, 5, lost=(2,))
    read: Any = trc.TRCData()
    read.load(str(file))
    assert tuple(read["Markers"]) == model.joint_names
    assert (read["DataRate"], read["Units"], read["NumFrames"]) == (RATE, "mm", 5)
    np.testing.assert_allclose(read["Time"], track.time_s, atol=1e-6)
    places = np.swapaxes([read[name] for name in model.joint_names], 0, 1) / 1000.0  # (F, J, 3)
    assert np.isnan(places[2]).all()
    kept = [0, 1, 3, 4]
    assert np.abs(places[kept] - track.joint_positions[kept] @ CAMERA_TO_OPENSIM.T).max() < 0.01 * MILLIMETRE


def test_both_turn_the_camera_without_mirroring_it() -> None:
    """A mirrored axis would exchange left and right; a person who faces the camera faces forward."""
    up, forward, left = (0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)
    for turn, axes in ((CAMERA_TO_Y_UP, "yzx"), (CAMERA_TO_OPENSIM, "yxz")):
        assert np.linalg.det(turn) == pytest.approx(1.0)
        for direction, axis in zip((up, forward), axes, strict=False):
            np.testing.assert_array_equal(turn @ direction, np.eye(3)["xyz".index(axis)])
        assert (turn @ left)["xyz".index(axes[2])] == (1.0 if turn is CAMERA_TO_Y_UP else -1.0)
