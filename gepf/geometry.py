"""Frames, bodies and runs as Open3D geometry: to view, to measure, and to write in Open3D's formats."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.camera import points_of
from gepf.common.errors import InputError
from gepf.common.frame import Frame
from gepf.common.kinematics import joint_positions
from gepf.common.packages import needs
from gepf.coordinator.pictures.overlay import bones
from gepf.coordinator.results.track import read_tracked_body
from gepf.named import Estimate
from gepf.run import Run

NEIGHBOURS = 16  # points around a point from which its normal is estimated


def to_open3d(
    shown: Frame | BodyModel | Estimate | Run, pose: ArrayLike | None = None, *, skeleton: bool = False
) -> Any:
    """Convert to Open3D geometry, in metres, in the frame of the camera or rig.

    A frame becomes an `open3d.geometry.PointCloud` of all its cameras, with normals towards the camera that
    measured the point. A body in a `pose` (D,), or an estimate, becomes a `TriangleMesh` with normals. A run
    becomes a list of meshes, one per frame; those before the body was found are empty. With `skeleton`, each
    mesh is a `LineSet` instead: its points are the joints in the order of `joint_names`, and lines connect
    those of a person.

    Raises InputError for a body without a valid pose, and MissingPackage without Open3D.
    """
    with needs("open3d", "to_open3d"):
        import open3d  # noqa: F401 only so that MissingPackage is raised here, for all functions below

    if isinstance(shown, Frame):
        return point_cloud(shown)
    if isinstance(shown, Run):
        model = read_tracked_body(shown.folder).model
        return [
            body(model, one, skeleton=skeleton) if placed else empty(skeleton=skeleton)
            for one, placed in zip(shown.track.pose, shown.placed, strict=True)
        ]
    if isinstance(shown, Estimate):
        if not np.isfinite(shown.pose).all():
            return empty(skeleton=skeleton)
        return body(shown.model, shown.pose, skeleton=skeleton)
    values = np.asarray(np.nan if pose is None else pose, dtype=np.float64)
    if values.shape != (len(shown.dof_names),) or not np.isfinite(values).all():
        raise InputError(
            f"the pose is missing or invalid; give {len(shown.dof_names)} finite numbers, "
            "in the order of dof_names"
        )
    return body(shown, values, skeleton=skeleton)


def point_cloud(frame: Frame) -> Any:
    """The points of all cameras, in the rig's frame, with normals that face the camera."""
    import open3d as o3d

    whole = o3d.geometry.PointCloud()
    for view in frame.views:
        depth = view.metres()
        seen = o3d.geometry.PointCloud(
            o3d.utility.Vector3dVector(points_of(depth, view.intrinsics, depth > 0).astype(np.float64))
        )
        if len(seen.points):
            seen.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS))
            seen.orient_normals_towards_camera_location(np.zeros(3))
        seen.transform(np.asarray(view.T_rig_camera))
        whole += seen
    return whole


def body(model: BodyModel, pose: Array, *, skeleton: bool) -> Any:
    """The surface or the skeleton of a body in a pose (D,)."""
    if skeleton:
        return line_set(joint_positions(model, pose[None])[0], bones(model.joint_names))
    from gepf.coordinator.exports.surface import triangle_mesh

    return triangle_mesh(model, pose)


def empty(*, skeleton: bool) -> Any:
    """Empty geometry, for a frame in which no body was found."""
    import open3d as o3d

    return o3d.geometry.LineSet() if skeleton else o3d.geometry.TriangleMesh()


def line_set(points: Array, pairs: Sequence[tuple[int, int]]) -> Any:
    """Points (n, 3), and lines between pairs of them."""
    import open3d as o3d

    lines = np.array(pairs, dtype=np.int32).reshape(-1, 2)
    return o3d.geometry.LineSet(o3d.utility.Vector3dVector(points), o3d.utility.Vector2iVector(lines))
