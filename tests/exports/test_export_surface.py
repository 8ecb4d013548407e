"""Meshes and point clouds of one frame, read again with Open3D, are the tracked surface."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import open3d as o3d
import pytest

from gepf.common.body import BodyModel
from gepf.common.errors import InputError
from gepf.common.kinematics import pose_vertices
from gepf.coordinator.exports import export_run
from tests.support.bodies import person, random_body
from tests.support.runs import swing, write_run

FRAMES = 5
TEXT = 1e-5  # metres, of the digits that formats of text have
BODIES = {"person": person(), "random": random_body(np.random.default_rng(5))}


@pytest.fixture(params=BODIES)
def model(request: pytest.FixtureRequest) -> BodyModel:
    """A person, or any body."""
    return BODIES[request.param]


@pytest.fixture
def run(model: BodyModel, tmp_path: Path) -> Path:
    """The folder of a run with the frames 100 to 104, of which the first is lost."""
    write_run(tmp_path / "run", model, swing(model, FRAMES), lost=(0,))
    return tmp_path / "run"


@pytest.mark.parametrize("form", ["ply", "obj"])
def test_a_mesh_is_the_tracked_surface(run: Path, model: BodyModel, form: str) -> None:
    """Triangles with outward normals, in the camera's frame, of the frame that was asked for."""
    file = run / f"body.{form}"
    export_run(run, form, file, frame=103)
    mesh = o3d.io.read_triangle_mesh(file)
    expected = pose_vertices(model, swing(model, FRAMES)[3, None])[0]
    assert np.allclose(
        expected[model.triangles], np.asarray(mesh.vertices)[np.asarray(mesh.triangles)], atol=TEXT
    )
    normals = np.asarray(mesh.vertex_normals)
    assert len(normals) == len(mesh.vertices)
    mesh.compute_vertex_normals()
    assert np.median(np.sum(normals * np.asarray(mesh.vertex_normals), axis=1)) > 0.95


@pytest.mark.parametrize("form", ["pcd", "xyz"])
def test_a_point_cloud_has_the_vertices(run: Path, model: BodyModel, form: str) -> None:
    """All of them, in their order; PCD also has their normals. Without --frame, of the first tracked one."""
    export_run(run, form, run / f"body.{form}")
    cloud = o3d.io.read_point_cloud(run / f"body.{form}")
    expected = pose_vertices(model, swing(model, FRAMES)[1, None])[0]
    assert np.allclose(np.asarray(cloud.points), expected, atol=TEXT)
    assert cloud.has_normals() == (form == "pcd")


@pytest.mark.parametrize(
    ("form", "frame", "message"),
    [
        ("ply", 7, r"frame 7 has no pose; give --frame 100 to 104"),
        ("bvh", 101, "bvh holds all frames, not frame 101 alone; leave --frame out"),
    ],
)
def test_a_frame_that_cannot_be_written_has_one_line(run: Path, form: str, frame: int, message: str) -> None:
    """A number that the run does not have, and a format of all frames; nothing is written."""
    with pytest.raises(InputError, match=message):
        export_run(run, form, run / "body", frame=frame)
    assert not (run / "body").exists()
