"""A run on a timeline, in the rerun viewer."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from matplotlib import colormaps
from matplotlib.colors import to_rgb
from numpy.typing import NDArray
from scipy.spatial import KDTree

from common.body import ROTATION, BodyModel, vertex_normals
from common.camera import back_project, level_from_camera
from common.frame import DepthFrame
from common.kinematics import joint_positions, pose_vertices
from common.settings import preset
from coordinator.pictures.overlay import OTHERS_COLOUR, SKELETON_COLOUR, bones
from coordinator.pictures.plots import STATUS
from coordinator.pictures.shading import MODEL_COLOUR, Colour
from coordinator.results.track import Track
from coordinator.sources import Source
from coordinator.tracking.segmenter import PosedBody, Segmenter

Array = NDArray[np.float64]

SURFACE_COLOUR = (*MODEL_COLOUR, 150)  # transparent, so that the points are visible
LARGEST_RESIDUAL_M = 0.1  # end of the colour scale


def layout(track: Track) -> rrb.Blueprint:
    """The scene to the left; depth, angles, residual and status to the right."""
    curves = rrb.Tabs(
        rrb.TimeSeriesView(origin="/angles", name="joint angles"),
        rrb.TimeSeriesView(origin="/root", name="root"),
        rrb.TimeSeriesView(origin="/quality", name="residual and hypotheses"),
    )
    depth = rrb.Spatial2DView(origin="/camera/image", name="depth")
    level = level_from_camera(track.up).T
    eye = rrb.EyeControls3D(
        position=level @ [0.9, -0.5, 0.0],
        look_target=np.nanmean(track.joint_positions[:1], axis=(0, 1)),
        eye_up=level @ [0.0, -1.0, 0.0],
    )
    seen = ["+ /**", "- /camera/**"]  # the depth image would be shown as a second cloud
    scene = rrb.Spatial3DView(origin="/", contents=seen, name="scene", eye_controls=eye)
    side = rrb.Vertical(depth, curves, rrb.TextLogView(origin="/status", name="status"))
    return rrb.Blueprint(rrb.Horizontal(scene, side), rrb.TimePanel(timeline="frame"), collapse_panels=True)


def log_run(
    to: rr.RecordingStream,
    track: Track,
    model: BodyModel,
    source: Source | None,
    advance: Callable[[int, int], None],
) -> None:
    """Log all frames; without a source, only the results."""
    to.log("/", rr.ViewCoordinates.RDF, static=True)
    if source is not None:
        camera = source.intrinsics
        pinhole = rr.Pinhole(
            focal_length=(camera.fx, camera.fy),
            principal_point=(camera.cx, camera.cy),
            width=camera.width,
            height=camera.height,
        )
        to.log("/camera/image", pinhole, static=True)
    segmenter = Segmenter(preset("default").points)
    for f in range(len(track.frame)):
        to.set_time("frame", sequence=int(track.frame[f]))
        to.set_time("time", duration=float(track.time_s[f]))
        log_pose(to, track, model, f)
        log_numbers(to, track, model, f)
        if source is not None:
            frame = source.frame(int(track.frame[f]))
            log_observation(to, frame, observe(segmenter, frame, PosedBody(model, track.pose[f])))
        advance(f + 1, len(track.frame))


def log_pose(to: rr.RecordingStream, track: Track, model: BodyModel, f: int) -> None:
    """The surface in the reported pose, and the skeletons of all hypotheses."""
    surface = pose_vertices(model, track.pose[f][None])[0]
    mesh = rr.Mesh3D(
        vertex_positions=surface.astype(np.float32),
        triangle_indices=model.triangles.astype(np.uint32),
        vertex_normals=vertex_normals(surface, model.triangles),
        albedo_factor=SURFACE_COLOUR,
    )
    to.log("/model/surface", mesh)
    to.log("/model/skeleton", skeletons(model, track.joint_positions[f][None], np.ones(1), SKELETON_COLOUR))
    weights = track.hypothesis_weight[f][np.isfinite(track.hypothesis_weight[f])]
    joints = joint_positions(model, track.hypothesis_pose[f, : len(weights)])
    to.log("/hypotheses", skeletons(model, joints, weights / weights.max(), OTHERS_COLOUR))


def skeletons(model: BodyModel, joints: Array, strength: Array, colour: Colour) -> rr.LineStrips3D:
    """Lines between joints (M, J, 3), with opacity by strength (M,) from 0 to 1."""
    pairs = np.array(bones(model.joint_names), dtype=np.int64).reshape(-1, 2)
    strips = joints[:, pairs].reshape(-1, 2, 3)
    alpha = np.repeat(255 * np.sqrt(strength), len(pairs))
    colours = np.column_stack([np.tile(colour, (len(strips), 1)), alpha]).astype(np.uint8)
    return rr.LineStrips3D([*strips.astype(np.float32)], colors=colours)


def log_numbers(to: rr.RecordingStream, track: Track, model: BodyModel, f: int) -> None:
    """Log angles in degrees, the root, the number of hypotheses, and changes of the status."""
    for d, name in enumerate(track.dof_names):
        turns = model.kinds[d] == ROTATION
        value = float(np.rad2deg(track.pose[f, d]) if turns else track.pose[f, d])
        to.log(f"/{'root' if name.startswith('root_') else 'angles'}/{name}", rr.Scalars(value))
    to.log("/quality/hypotheses", rr.Scalars(float(np.isfinite(track.hypothesis_weight[f]).sum())))
    status = str(track.status[f])
    if f == 0 or status != track.status[f - 1]:
        to.log("/status", rr.TextLog(status, color=to_rgb(STATUS[status])))


def observe(segmenter: Segmenter, frame: DepthFrame, body: PosedBody) -> tuple[Array, Array] | None:
    """Points (P, 3) of the subject near a body in the next frame, and their distances (P,) from its vertices.

    None if nothing of it is visible. Camera frame, metres.
    """
    subject = segmenter.segment(frame, [body]).subjects[0]
    if subject is None:
        return None
    cropped = subject.frame
    points = back_project(cropped.metres(), cropped.intrinsics).reshape(-1, 3)[subject.picked]
    return points, KDTree(body.surface).query(points)[0]


def log_observation(to: rr.RecordingStream, frame: DepthFrame, found: tuple[Array, Array] | None) -> None:
    """The depth image, and the subject's points, from blue (explained) to yellow (10 cm off)."""
    to.log("/camera/image/depth", rr.DepthImage(frame.depth, meter=frame.depth_scale))
    if found is None:
        to.log("/observed", rr.Clear(recursive=True))
        return
    points, residual = found
    to.log("/quality/residual_cm", rr.Scalars(100.0 * float(residual.mean())))
    colours = (255 * colormaps["viridis"](residual / LARGEST_RESIDUAL_M)).astype(np.uint8)
    to.log("/observed/points", rr.Points3D(points, colors=colours, radii=0.003))
