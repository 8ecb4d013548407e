"""A run on a timeline, or live frames, in the rerun viewer."""

from __future__ import annotations

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from matplotlib.colors import to_rgb

from gepf.common.arrays import Array
from gepf.common.body import ROTATION, BodyModel, vertex_normals
from gepf.common.camera import Intrinsics, level_from_camera
from gepf.common.frame import View
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.coordinator.palette import PALETTE, STATUS, Colour
from gepf.coordinator.pictures.overlay import bones
from gepf.coordinator.results.track import Track

NUMBER, SINCE = "frame", "time"  # timelines: number of the frame, seconds since the start

SURFACE_COLOUR = (*PALETTE.body, 150)  # transparent, so that the points are visible
DOUBT_COLOUR = to_rgb(STATUS["ambiguous"])


def layout(middle: Array | None = None, up: Array | None = None, *, live: bool = False) -> rrb.Blueprint:
    """The scene to the left; depth, angles, residual and status to the right.

    The eye looks at `middle` (3,), and `up` (3,) points away from the ground, camera frame; None if unknown.
    Live frames are shown as they come.
    """
    now = rrb.TimeRangeBoundary.cursor_relative
    shown = rrb.VisibleTimeRange(SINCE, start=now(seconds=-10.0), end=now()) if live else None
    named = {"/angles": "joint angles", "/root": "root", "/quality": "hypotheses"}
    curves = rrb.Tabs(
        *(rrb.TimeSeriesView(origin=o, name=name, time_ranges=shown) for o, name in named.items())
    )
    depth = rrb.Spatial2DView(origin="/camera/image", name="depth")
    level = level_from_camera(up).T
    eye = rrb.EyeControls3D(
        position=level @ [0.9, -0.5, 0.0], look_target=middle, eye_up=level @ [0.0, -1.0, 0.0]
    )
    scene = rrb.Spatial3DView(origin="/", name="scene", eye_controls=eye)
    side = rrb.Vertical(depth, curves, rrb.TextLogView(origin="/status", name="status"))
    time = rrb.TimePanel(timeline=NUMBER)
    if live:
        time = rrb.TimePanel(timeline=SINCE, play_state="following", state="collapsed")
    return rrb.Blueprint(rrb.Horizontal(scene, side), time, collapse_panels=True)


class FrameLog:
    """Logs times, depth images and their camera."""

    def __init__(self, to: rr.RecordingStream) -> None:
        self._to = to
        self._camera: Intrinsics | None = None
        to.log("/", rr.ViewCoordinates.RDF, static=True)

    def log(self, number: int, since_s: float, view: View | None) -> None:
        """Set the frame number and time of everything logged next; log the depth image, if there is one."""
        self._to.set_time(NUMBER, sequence=number)
        self._to.set_time(SINCE, duration=since_s)
        if view is None:
            return
        if view.intrinsics != self._camera:
            self._camera = camera = view.intrinsics
            pinhole = rr.Pinhole(
                focal_length=(camera.fx, camera.fy),
                principal_point=(camera.cx, camera.cy),
                width=camera.width,
                height=camera.height,
            )
            self._to.log("/camera/image", pinhole, static=True)
            placed = view.T_rig_camera
            self._to.log(
                "/camera", rr.Transform3D(translation=placed[:3, 3], mat3x3=placed[:3, :3]), static=True
            )
        self._to.log("/camera/image/depth", rr.DepthImage(view.depth, meter=view.depth_scale))


class PersonLog:
    """Logs one person frame by frame, from a run or live; each of several people under a name of its own."""

    def __init__(self, to: rr.RecordingStream, name: str = "") -> None:
        self._to, self._name = to, name and f"/{name}"
        self._status = ""

    def log(self, track: Track, f: int, model: BodyModel | None) -> None:
        """Log frame `f` of a track; without the body only joints."""
        status = str(track.status[f])
        if status != self._status:
            self._log("status", "", rr.TextLog(status, color=to_rgb(STATUS[status])))
        self._status = status
        if not track.placed[f]:
            for what in ("model", "hypotheses"):
                self._log(what, "", rr.Clear(recursive=True))
            return
        self._log_joints(track, f)
        if model is not None:
            self._log_body(track, f, model)

    def _log(self, what: str, part: str, value: rr.AsComponents, *, static: bool = False) -> None:
        self._to.log(f"/{what}{self._name}{part and f'/{part}'}", value, static=static)

    def _log_joints(self, track: Track, f: int) -> None:
        """Log the skeleton of the reported pose; joints that may be wrong are labelled with their names."""
        joints = track.joint_positions[f]
        skeleton = skeletons(track.joint_names, joints[None], np.ones(1), PALETTE.skeleton)
        self._log("model", "skeleton", skeleton)
        doubted = np.flatnonzero(track.flagged[f])
        names = [track.joint_names[j].replace("_", " ") for j in doubted]
        marks = rr.Points3D(joints[doubted], colors=DOUBT_COLOUR, radii=0.03, labels=names, show_labels=True)
        self._log("model", "doubtful", marks)

    def _log_body(self, track: Track, f: int, model: BodyModel) -> None:
        """Log the surface, the degrees of freedom in degrees and metres, and the hypotheses."""
        surface = pose_vertices(model, track.pose[f][None])[0]
        mesh = rr.Mesh3D(
            vertex_positions=surface.astype(np.float32),
            triangle_indices=model.triangles.astype(np.uint32),
            vertex_normals=vertex_normals(surface, model.triangles),
            albedo_factor=SURFACE_COLOUR,
        )
        self._log("model", "surface", mesh)
        values = np.where(model.kinds == ROTATION, np.rad2deg(track.pose[f]), track.pose[f])
        root = np.array([name.startswith("root_") for name in track.dof_names])
        for what, chosen in (("root", root), ("angles", ~root)):
            self._log(what, "", rr.SeriesLines(names=np.array(track.dof_names)[chosen].tolist()), static=True)
            self._log(what, "", rr.Scalars(values[chosen]))
        weights = track.hypothesis_weight[f][np.isfinite(track.hypothesis_weight[f])]
        self._log("quality", "hypotheses", rr.Scalars(float(len(weights))))
        joints = joint_positions(model, track.hypothesis_pose[f, : len(weights)])
        strength = weights / weights.max(initial=1e-9)
        self._log("hypotheses", "", skeletons(track.joint_names, joints, strength, PALETTE.hypotheses))


def skeletons(names: tuple[str, ...], joints: Array, strength: Array, colour: Colour) -> rr.LineStrips3D:
    """Lines between named joints (M, J, 3), whose thickness shows their strength (M,), from 0 to 1."""
    pairs = np.array(bones(names), dtype=np.int64).reshape(-1, 2)
    strips = joints[:, pairs].reshape(-1, 2, 3).astype(np.float32)
    radii = np.repeat(0.006 * np.sqrt(strength), len(pairs))
    return rr.LineStrips3D([*strips], colors=colour, radii=radii)
