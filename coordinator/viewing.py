"""A run on a time line, in the rerun viewer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from matplotlib import colormaps
from matplotlib.colors import to_rgb
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from common.body import ROTATION, BodyModel, vertex_normals
from common.camera import back_project, level_from_camera
from common.frame import DepthFrame
from common.kinematics import joint_positions, pose_vertices
from coordinator.pictures.overlay import bones
from coordinator.pictures.plots import STATUS
from coordinator.results.track import Track
from coordinator.sources import Source
from coordinator.tracking.segmenter import PosedBody, Segmenter

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Correspondences:
    """Observed points, the nearest vertices that face the camera, and the distances between them, metres."""

    observed: Array  # (P, 3) in the camera frame
    nearest: Array  # (P, 3)
    residual: Array  # (P,)


def correspond(segmenter: Segmenter, frame: DepthFrame, body: PosedBody) -> Correspondences | None:
    """For the points of the subject near a body in the next frame; None where nothing of it was seen."""
    subject = segmenter.segment(frame, [body]).subjects[0]
    if subject is None:
        return None
    surface = body.surface
    cropped = subject.frame
    observed = back_project(cropped.metres(), cropped.intrinsics).reshape(-1, 3)[subject.picked]
    faced = surface[facing(surface, body.model.triangles)]
    distance, at = KDTree(faced).query(observed)
    return Correspondences(observed, faced[at], distance)


def facing(surface: Array, triangles: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which vertices (V,) belong to a triangle whose outside the camera sees, occlusion aside."""
    corners = surface[triangles]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    towards = np.einsum("ti,ti->t", outward, corners[:, 0]) < 0.0
    seen = np.zeros(len(surface), dtype=np.bool_)
    seen[triangles[towards]] = True
    return seen


SMALLEST = 0.002  # metres, so that a joint all agree on can still be seen


def ellipsoids(joints: Array, reported: Array, weights: Array) -> tuple[Array, Array]:
    """One standard deviation of joints (M, J, 3) with weights (M,) about the reported (J, 3).

    Returns:
        Half axes (J, 3), metres, and the rotations (J, 4) of those axes as quaternions x, y, z, w.
    """
    away = joints - reported
    covariance = np.einsum("m,mji,mjk->jik", weights / weights.sum(), away, away)
    squares, axes = np.linalg.eigh(covariance)
    axes[np.linalg.det(axes) < 0.0, :, 0] *= -1.0
    return np.maximum(np.sqrt(np.maximum(squares, 0.0)), SMALLEST), Rotation.from_matrix(axes).as_quat()


Advance = Callable[[int, int], None]

POINTS = 4000  # of the subject
LINES = 800  # correspondences
LARGEST_RESIDUAL = 0.1  # metres, at which the colours end
SURFACE, REPORTED, HYPOTHESIS = (232, 140, 70, 150), (255, 255, 255), (59, 130, 196)


def layout(track: Track) -> rrb.Blueprint:
    """The scene to the left; depth, angles, residual and status to the right."""
    curves = rrb.Tabs(
        rrb.TimeSeriesView(origin="/angles", name="joint angles"),
        rrb.TimeSeriesView(origin="/root", name="root"),
        rrb.TimeSeriesView(origin="/quality", name="residual and hypotheses"),
    )
    side = rrb.Vertical(
        rrb.Spatial2DView(origin="/camera/image", name="depth"),
        curves,
        rrb.TextLogView(origin="/status", name="status"),
        row_shares=[3, 4, 2],
    )
    start = np.nanmean(track.joint_positions[:1], axis=(0, 1))
    level = level_from_camera(track.up).T
    eye = rrb.EyeControls3D(
        position=level @ [0.9, -0.5, 0.0], look_target=start, eye_up=level @ [0.0, -1.0, 0.0]
    )
    seen = ["+ /**", "- /camera/**"]  # the depth image would hang in the air as a second cloud
    scene = rrb.Spatial3DView(
        origin="/", contents=seen, name="scene", eye_controls=eye, background=[18, 22, 30]
    )
    return rrb.Blueprint(
        rrb.Horizontal(scene, side, column_shares=[3, 2]),
        rrb.TimePanel(state="collapsed", timeline="frame"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )


def log_run(
    to: rr.RecordingStream, track: Track, model: BodyModel, source: Source | None, advance: Advance
) -> None:
    """Write all frames; without a source, what was tracked alone."""
    to.log("/", rr.ViewCoordinates.RDF, static=True)
    if source is not None:
        log_camera(to, source)
    segmenter = Segmenter(POINTS)
    for f in range(len(track.frame)):
        to.set_time("frame", sequence=int(track.frame[f]))
        to.set_time("time", duration=float(track.time_s[f]))
        log_pose(to, track, model, f)
        log_numbers(to, track, model, f)
        if source is not None:
            frame, body = source.frame(int(track.frame[f])), PosedBody(model, track.pose[f])
            log_observation(to, frame, correspond(segmenter, frame, body))
        advance(f + 1, len(track.frame))


def log_camera(to: rr.RecordingStream, source: Source) -> None:
    """Where the depth image hangs."""
    camera = source.intrinsics
    pinhole = rr.Pinhole(
        focal_length=(camera.fx, camera.fy),
        principal_point=(camera.cx, camera.cy),
        width=camera.width,
        height=camera.height,
        image_plane_distance=0.3,
    )
    to.log("/camera/image", pinhole, static=True)


def log_pose(to: rr.RecordingStream, track: Track, model: BodyModel, f: int) -> None:
    """The surface in the reported pose, skeletons of all hypotheses, and how far these lie apart."""
    surface = pose_vertices(model, track.pose[f][None])[0]
    mesh = rr.Mesh3D(
        vertex_positions=surface.astype(np.float32),
        triangle_indices=model.triangles.astype(np.uint32),
        vertex_normals=vertex_normals(surface, model.triangles),
        albedo_factor=SURFACE,
    )
    to.log("/model/surface", mesh)
    reported = track.joint_positions[f]
    to.log("/model/skeleton", skeletons(model, reported[None], np.ones(1), REPORTED, 0.006))
    weights = track.hypothesis_weight[f][np.isfinite(track.hypothesis_weight[f])]
    joints = joint_positions(model, track.hypothesis_pose[f, : len(weights)])
    to.log("/hypotheses", skeletons(model, joints, weights / weights.max(), HYPOTHESIS, 0.003))
    half_sizes, turns = ellipsoids(joints, reported, weights)
    to.log(
        "/covariance",
        rr.Ellipsoids3D(centers=reported, half_sizes=half_sizes, quaternions=turns, colors=[HYPOTHESIS]),
    )


def skeletons(
    model: BodyModel, joints: Array, strength: Array, colour: tuple[int, int, int], radius: float
) -> rr.LineStrips3D:
    """Lines between joints (M, J, 3), the fainter the less their strength (M,) from 0 to 1."""
    pairs = np.array(bones(model.joint_names), dtype=np.int64).reshape(-1, 2)
    strips = joints[:, pairs].reshape(-1, 2, 3)
    alpha = np.repeat(np.clip(60 + 195 * strength, 0, 255), len(pairs))
    colours = np.column_stack([np.tile(colour, (len(strips), 1)), alpha]).astype(np.uint8)
    return rr.LineStrips3D([*strips.astype(np.float32)], colors=colours, radii=radius)


def log_numbers(to: rr.RecordingStream, track: Track, model: BodyModel, f: int) -> None:
    """Angles in degrees, the root, the number of hypotheses, and the status where it changes."""
    for d, name in enumerate(track.dof_names):
        turns = model.kinds[d] == ROTATION
        value = float(np.rad2deg(track.pose[f, d]) if turns else track.pose[f, d])
        to.log(f"/{'root' if name.startswith('root_') else 'angles'}/{name}", rr.Scalars(value))
    to.log("/quality/hypotheses", rr.Scalars(float(np.isfinite(track.hypothesis_weight[f]).sum())))
    status = str(track.status[f])
    if f == 0 or status != track.status[f - 1]:
        to.log("/status", rr.TextLog(status, color=to_rgb(STATUS[status])))


def log_observation(to: rr.RecordingStream, frame: DepthFrame, found: Correspondences | None) -> None:
    """The depth image, the subject's points and lines from some of them to the model.

    Points are coloured from blue (explained) to yellow (10 cm off). Without correspondences they are cleared.
    """
    to.log("/camera/image/depth", rr.DepthImage(frame.depth, meter=frame.depth_scale))
    if found is None:
        to.log("/observed", rr.Clear(recursive=True))
        return
    to.log("/quality/residual_cm", rr.Scalars(100.0 * float(found.residual.mean())))
    share = np.clip(found.residual / LARGEST_RESIDUAL, 0.0, 1.0)
    colours = (255 * colormaps["viridis"](share)).astype(np.uint8)
    to.log("/observed/points", rr.Points3D(found.observed, colors=colours, radii=0.003))
    some = np.linspace(0, len(share) - 1, min(LINES, len(share))).astype(np.int64)
    strips = np.stack([found.observed[some], found.nearest[some]], axis=1)
    to.log(
        "/observed/correspondences",
        rr.LineStrips3D([*strips.astype(np.float32)], colors=colours[some], radii=0.001),
    )
