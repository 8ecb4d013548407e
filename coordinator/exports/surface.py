"""The surface of the body in one frame, written by Open3D: meshes as PLY and OBJ, points as PCD and XYZ.

Metres, in the frame of the camera or rig, so that the surface coincides with the measured points.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import open3d as o3d

from gepf.common.arrays import Array
from gepf.common.body import BodyModel, vertex_normals
from gepf.common.errors import GepfError
from gepf.common.kinematics import pose_vertices
from gepf.coordinator.exports.recorded import RecordedRun


def triangle_mesh(model: BodyModel, pose: Array) -> Any:
    """The body in a pose (D,) as an `open3d.geometry.TriangleMesh` with normals of its vertices."""
    vertices = pose_vertices(model, pose[None])[0]
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(vertices), o3d.utility.Vector3iVector(model.triangles.astype(np.int32))
    )
    normals = vertex_normals(vertices, model.triangles).astype(np.float64)
    mesh.vertex_normals = o3d.utility.Vector3dVector(normals)
    return mesh


def write_ply(run: RecordedRun, file: BinaryIO) -> None:
    """A binary mesh with normals."""
    write(".ply", o3d.io.write_triangle_mesh, surface_of(run), file)


def write_obj(run: RecordedRun, file: BinaryIO) -> None:
    """A mesh with normals, as text."""
    write(".obj", o3d.io.write_triangle_mesh, surface_of(run), file)


def write_pcd(run: RecordedRun, file: BinaryIO) -> None:
    """The vertices with their normals, binary."""
    write(".pcd", o3d.io.write_point_cloud, vertices_of(run), file)


def write_xyz(run: RecordedRun, file: BinaryIO) -> None:
    """The vertices, one per line."""
    write(".xyz", o3d.io.write_point_cloud, vertices_of(run), file)


def surface_of(run: RecordedRun) -> Any:
    """The body in the first frame of the track."""
    return triangle_mesh(run.body().model, run.track.pose[0])


def vertices_of(run: RecordedRun) -> Any:
    """The vertices of the body in the first frame of the track, with normals."""
    mesh = surface_of(run)
    cloud = o3d.geometry.PointCloud(mesh.vertices)
    cloud.normals = mesh.vertex_normals
    return cloud


def write(suffix: str, writer: Any, geometry: Any, file: BinaryIO) -> None:
    """Write by way of a temporary file: Open3D chooses the format by the suffix of a path."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"body{suffix}"
        if not writer(str(path), geometry):
            raise GepfError(f"Open3D could not write {suffix[1:]}; is {tempfile.gettempdir()} full?")
        file.write(path.read_bytes())
