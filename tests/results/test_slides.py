"""Prismatic joints in results, pictures, exports and library."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gepf
from gepf.common.body import BodyModel
from gepf.coordinator.bodies.urdf import read_urdf
from gepf.coordinator.pictures.plots import curves_of
from gepf.coordinator.results.evaluation import Truth
from gepf.coordinator.results.track import TrackedBody
from gepf.coordinator.tracking.certainty import unknown_certainty
from tests.support.runs import swing, write_run

FRAMES = 6
GANTRY = """<robot name="gantry">
<link name="foot"><visual><geometry><box size="0.4 0.3 0.1"/></geometry></visual></link>
<link name="arm"><visual><geometry><box size="0.1 0.1 0.4"/></geometry></visual></link>
<link name="hand"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>
<joint name="turn" type="revolute"><parent link="foot"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="main_lift" type="prismatic"><parent link="arm"/><child link="hand"/><axis xyz="0 0 1"/>
<limit lower="0" upper="0.4" effort="1" velocity="1"/></joint>
</robot>"""


@pytest.fixture
def gantry(tmp_path: Path) -> BodyModel:
    """One joint that turns and one that slides, on a base that is free."""
    (tmp_path / "gantry.urdf").write_text(GANTRY)
    return read_urdf(tmp_path / "gantry.urdf")


def test_the_library_gives_metres_and_never_degrees(gantry: BodyModel, tmp_path: Path) -> None:
    """For a run, an estimate and a table; the root's position is not an angle; rotations are unchanged."""
    poses = swing(gantry, FRAMES)
    poses[:, gantry.dof("root_tx")] = np.linspace(0.0, 8.0, FRAMES)  # which no turn may be taken off
    track = write_run(tmp_path / "run", gantry, poses)
    run = gepf.load(tmp_path / "run")
    joints = track.joint_positions[0]
    certainty = unknown_certainty(len(joints))
    estimate = gepf.Estimate(
        0, 0.0, "tracked", poses[0], joints, poses[:1], np.ones(1), 0.01, certainty, flexible=gantry
    )
    for name in ("main_lift", "root_tx"):
        at = gantry.dof(name)
        assert np.array_equal(run.angle(name), track.pose[:, at])
        assert estimate.angle(name) == poses[0, at]
        for holder in (run, estimate):
            with pytest.raises(
                gepf.InputError, match=f"'{name}' is a sliding joint, whose values are metres"
            ):
                holder.angle(name, degrees=True)
    for holder in (run, estimate):
        with pytest.raises(gepf.InputError, match=r"unknown angle 'lift'; choose from .*\bmain_lift\b"):
            holder.angle("lift")
    assert run.angle("turn", degrees=True)[0] == pytest.approx(estimate.angle("turn", degrees=True))
    table = run.to_dataframe()
    assert np.array_equal(table["main_lift"], run.angle("main_lift"))
    assert not {"main_lift_deg", "root_tx_deg"} & set(table.columns)


def test_opensims_file_has_what_slides_in_metres(gantry: BodyModel, tmp_path: Path) -> None:
    """A column beside the angles, as OpenSim has it of translations in a file in degrees."""
    track = write_run(tmp_path / "run", gantry, swing(gantry, FRAMES))
    gepf.load(tmp_path / "run").export(tmp_path / "run.mot")
    lines = (tmp_path / "run.mot").read_text().partition("endheader\n")[2].splitlines()
    at = lines[0].split("\t").index("main_lift")
    values = [float(line.split("\t")[at]) for line in lines[1:]]
    assert np.allclose(values, track.pose[:, gantry.dof("main_lift")], atol=1e-8)


def test_the_picture_of_hypotheses_shows_what_slides(gantry: BodyModel, tmp_path: Path) -> None:
    """One drawing more than without it, in centimetres, with every hypothesis and the truth."""
    track = write_run(tmp_path / "run", gantry, swing(gantry, FRAMES))
    at = gantry.dof("main_lift")
    other = track.pose.copy()
    other[:, at] += 0.05
    track = replace(
        track,
        hypothesis_pose=np.stack([track.pose, other], axis=1),
        hypothesis_weight=np.tile([0.7, 0.3], (FRAMES, 1)),
    )
    truth = Truth(track.frame[1:], track.joint_names, track.joint_positions[1:], track.dof_names, other[1:])
    *_, curve = curves_of(track, TrackedBody(gantry, {}), truth)
    assert (curve.name, curve.unit) == ("main_lift", " cm")
    assert curve.hypotheses is not None
    assert curve.true is not None
    assert np.allclose(curve.hypotheses, 100.0 * np.stack([track.pose[:, at], other[:, at]], axis=1))
    assert np.isnan(curve.true[0])
    assert np.allclose(curve.true[1:], 100.0 * other[1:, at])
