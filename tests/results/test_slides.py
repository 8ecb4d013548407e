"""Joints that slide: how far out, how far that may be off, in the report and in the picture of errors."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from common.body import BodyModel
from coordinator.bodies.urdf.reading import read_urdf
from coordinator.pictures.errors import draw_errors
from coordinator.report import write_report
from coordinator.results.slides import read_slides, slides_of
from coordinator.results.spread import UNSEEN
from coordinator.results.truth import Truth
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


def test_what_slides_is_off_by_what_hypotheses_disagree(gantry: BodyModel, tmp_path: Path) -> None:
    """Twice the root mean square of their distances, nothing where it is lost; the root's place is none."""
    track = write_run(tmp_path / "run", gantry, swing(gantry, FRAMES), lost=(2,))
    at = gantry.dof("main_lift")
    poses = np.repeat(track.pose[:, None], 3, axis=1)
    poses[:, 1, at] += 0.04
    poses[:, 2] = np.nan
    weight = np.tile([0.75, 0.25, np.nan], (FRAMES, 1))
    slides = slides_of(replace(track, hypothesis_pose=poses, hypothesis_weight=weight), gantry)
    assert slides.names == ("main_lift",)
    assert np.array_equal(slides.value[:, 0], track.pose[:, at])
    assert np.isnan(slides.deviation[2, 0])
    assert np.delete(slides.deviation[:, 0], 2) == pytest.approx(UNSEEN * 0.02)
    (tmp_path / "run" / "model.npz").unlink()
    assert read_slides(tmp_path / "run", track).names == ()


def test_the_report_shows_what_slides_in_centimetres(gantry: BodyModel, tmp_path: Path) -> None:
    """A drawing beside those of the angles, and a word on the unit; 3 cm of way have whole numbers."""
    poses = np.zeros((FRAMES, len(gantry.dof_names)))
    poses[:, gantry.dof("main_lift")] = np.linspace(0.10, 0.13, FRAMES)
    write_run(tmp_path / "run", gantry, poses)
    (tmp_path / "run" / "summary.json").write_text(json.dumps({"sequence": "gantry"}))
    write_report(tmp_path / "run", tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert "of what slides centimetres" in page
    assert ">10.0 cm … 13.0 cm (3.0 cm)</td><td>15.0 cm/s</td><td>0.0 cm</td>" in page
    drawing = page.partition("<summary>sliding joints</summary>")[2].partition("</svg>")[0]
    assert ">main lift, cm</text>" in drawing
    assert all(f">{centimetres}</text>" in drawing for centimetres in (10, 11, 12, 13))


def test_the_picture_of_errors_has_a_column_for_what_slides(gantry: BodyModel, tmp_path: Path) -> None:
    """Where the truth says what slides; three columns are wider than two."""
    track = write_run(tmp_path / "run", gantry, swing(gantry, FRAMES))
    truth = Truth(track.frame, track.joint_names, track.joint_positions, track.dof_names, track.pose)
    sizes = []
    for slides in (truth.slides, (*truth.slides, "main_lift")):
        draw_errors(track, replace(truth, slides=slides), tmp_path / "errors.png")
        with Image.open(tmp_path / "errors.png") as picture:
            sizes.append(picture.width)
    assert sizes[1] > 1.3 * sizes[0]
