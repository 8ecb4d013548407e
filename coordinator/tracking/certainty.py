"""The certainty of each joint in a frame: a logistic function of nine features, fitted to data of people.

Three features come from the frame: the visible share of the surface around the joint that faces the camera,
the normalised residual of the body, and the share of the points within reach of the joint that no surface
explains. Two come from the filter: the spread of the hypotheses, and the speed of the joint. Four come from
the pose: joints are wrong more often in bent limbs and folded bodies, near other joints, and far in front of
or behind the body. Joints that colour confirms are wrong less often.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from gepf.common.activation import nearest_in
from gepf.common.arrays import Array, Mask
from gepf.common.body import KEYPOINTS, ROOT_DOFS, ROTATION, BodyModel
from gepf.common.camera import Pinhole
from gepf.common.compiling import numba
from gepf.common.frame import SubjectFrame
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.coordinator.colour.matching import ExpectedBody, deviations_of
from gepf.coordinator.filters.exploration import mark_near
from gepf.coordinator.settings import CertaintySettings
from gepf.coordinator.tracking.estimate import Certainty
from gepf.coordinator.tracking.observation import SAMPLED_POINTS, camera_points

NEGLIGIBLE = -30.0  # logarithm of a weight that changes no result
STILL_M = 1e-9  # joints that move less than this are fixed (rounding error)


@dataclass(frozen=True, slots=True, eq=False)
class FrameContext:
    """The data from which the pose of a frame was estimated, apart from the hypotheses."""

    subject: SubjectFrame
    past: Array  # (D,) the pose reported for the previous frame
    predicted: Array  # (D,) the pose that the motion model predicts from it
    interval: float  # seconds since that frame
    stretch: float  # ratio of lateral to depth noise
    past_is_guess: bool = False


class Features(NamedTuple):
    """Features of each joint (J,). Features of the whole body are the same for all joints."""

    seen: Array  # visible share of the camera-facing surface around it, in the camera that sees it best
    residual: Array  # normalised residual of the body
    unexplained: Array  # log of the share of the points within reach that are not near the surface
    spread: Array  # log of the weighted RMS distance of the hypotheses from the reported joint, metres
    speed: Array  # log of the speed of the joint, metres per second
    bend: Array  # sum of the squared angles from the root to the joint, rad^2
    folding: Array  # of the body: mean deviation of inter-joint distances from those at rest, metres
    crowding: Array  # number of nearby joints minus that in the rest pose
    protrusion: Array  # metres in front of or behind the mean joint


def log_odds(features: Features, settings: CertaintySettings) -> Array:
    """Log odds that joints are wrong, for features of any shape."""
    weights = msgspec.structs.asdict(settings.fit.weights)
    logit = sum(
        (weight * getattr(features, name) for name, weight in weights.items()), settings.fit.intercept
    )
    return np.asarray(np.clip(logit, -settings.max_nats, settings.max_nats))


def judge(
    features: Features,
    settings: CertaintySettings,
    joints_in_view: Mask | None = None,
    shown: Array | None = None,
) -> Certainty:
    """The certainty of joints (J,).

    Joints that are not among `joints_in_view` are outside the image, or hidden. `shown` is how well colour
    confirms the position of each joint, from 0 to 1.
    """
    fit, logit = settings.fit, log_odds(features, settings)
    hidden = fit.log_deviation_hidden * (1.0 - features.seen)
    deviation = np.exp(fit.log_deviation + fit.log_deviation_odds * logit + hidden)
    if joints_in_view is not None:
        logit = logit + np.where(joints_in_view, 0.0, settings.out_of_view_nats)
    if shown is not None:
        logit = logit - settings.shown_nats * shown
    return Certainty(features.seen, 1.0 / (1.0 + np.exp(-logit)), deviation)


def unknown_certainty(joints: int) -> Certainty:
    """The certainty in a frame without a known pose."""
    return Certainty(*np.full((3, joints), np.nan))


def measure_features(
    model: BodyModel,
    pose: Array,
    joints: Array,
    weights: Array,
    context: FrameContext,
    residual: float,
    seen_by: Array,
    settings: CertaintySettings,
) -> Features:
    """The features of a reported pose (D,), with normalised residual `residual` and visible shares `seen_by`.

    `seen_by` is (C, J). `joints` (1 + M, J, 3) are the joints of the pose and of the hypotheses, which have
    `weights` (M,).
    """
    distances_at_rest, upstream = rest_geometry(model)
    past = joint_positions(model, context.past[None])[0]
    reported, hypotheses = joints[0], joints[1:]
    squares = np.sum((hypotheses - reported) ** 2, axis=-1)
    spread = np.sqrt(weights @ squares / weights.sum())
    speed = np.linalg.norm(reported - past, axis=1) / context.interval
    distances = joint_distances(reported)
    depths = context.subject.largest.image.to_camera(reported)[:, 2]
    folding = np.sqrt(np.mean((distances - distances_at_rest) ** 2, axis=1)).mean()
    return Features(
        seen=seen_by.max(axis=0),
        residual=np.full(len(reported), residual),
        unexplained=log_unexplained_shares(model, pose, reported, context.subject, context.stretch, settings),
        spread=np.log(spread + settings.spread_floor_m),
        speed=np.log(speed + settings.speed_floor_m_s),
        bend=upstream @ pose**2,
        folding=np.full(len(reported), folding),
        crowding=count_near(distances, settings.crowded_m)
        - count_near(distances_at_rest, settings.crowded_m),
        protrusion=np.abs(depths - depths.mean()),
    )


def shown_in_colour(body: ExpectedBody, subject: SubjectFrame, max_deviations: float) -> Array:
    """How well colour confirms the position of each joint (J,) of a body, from 0 to 1; 0 without colour.

    The precision of the keypoint of the same name, relative to the most precise keypoint of the body; 0 if
    the keypoint is not at the joint.
    """
    names = body.model.joint_names
    shown = np.zeros(len(names))
    pairs = [(names.index(name), k) for k, name in enumerate(KEYPOINTS) if name in names]
    for view in subject.views:
        if view.keypoints is not None and pairs:
            joints, points = np.array(pairs).T
            precision = view.keypoints[:, 2].astype(np.float64)
            precision = precision / np.maximum(precision.max(), np.finfo(np.float64).tiny)
            off = deviations_of(body.pixels(view.image), view.keypoints)
            here = np.where(off < max_deviations, precision, 0.0)
            shown[joints] = np.maximum(shown[joints], here[points])
    return shown


def joint_distances(joints: Array) -> Array:
    """Distances (J, J) between joints (J, 3)."""
    return np.asarray(np.linalg.norm(joints[:, None] - joints, axis=-1))


def count_near(distances: Array, near_m: float) -> Array:
    """Number of joints near each joint (J,), from their distances (J, J)."""
    return np.asarray(np.exp(-0.5 * (distances / near_m) ** 2).sum(axis=1))


@lru_cache(maxsize=16)
def movable_joints(model: BodyModel) -> Mask:
    """Which joints (J,) some degree of freedom moves: not those of a held base, nor the first one on it."""
    poses = np.stack([np.zeros(len(model.kinds)), np.linspace(0.3, 0.7, len(model.kinds))])
    rest, pose = joint_positions(model, poses)
    return np.asarray(np.linalg.norm(pose - rest, axis=1) > STILL_M)


@lru_cache(maxsize=16)
def rest_geometry(model: BodyModel) -> tuple[Array, Mask]:
    """Distances (J, J) between a body's joints at rest, metres, and which angles (J, D) precede each joint.

    An angle precedes the joints that it moves.
    """
    count = len(model.kinds)
    turns = (model.kinds == ROTATION) & ~np.isin(model.dof_names, ROOT_DOFS)
    upstream = np.zeros((count + 1, count), dtype=np.bool_)  # the last row is for fixed joints
    for dof, parent in enumerate(model.parents):
        upstream[dof] = upstream[parent]
        upstream[dof, dof] = turns[dof]
    at_rest = joint_positions(model, np.zeros((1, count)))[0]
    return joint_distances(at_rest), upstream[model.link_dofs[model.joint_links]]


class Tolerance(NamedTuple):
    """When measured depth agrees with a surface."""

    agrees_m: float  # largest difference of depth, after multiplication by `stretch`
    stretch: float
    aside_m: float  # radius across the line of sight


def seen_shares(
    model: BodyModel, pose: Array, subject: SubjectFrame, stretch: float, settings: CertaintySettings
) -> Array:
    """Visible share (C, J) of the surface around each joint of pose (D,) that faces each camera.

    A triangle is visible if the subject's depth was measured at its position. `stretch`, the ratio of lateral
    to depth noise, scales differences of depth.
    """
    vertices, regions = pose_vertices(model, pose[None])[0], regions_of(model, settings.region_m)
    tolerance = Tolerance(settings.agrees_m, stretch, settings.aside_m)
    areas = np.zeros((len(subject.views), 2, regions.shape[1]))
    for view, seen in zip(subject.views, areas, strict=True):
        image = view.image
        add_areas(
            np.ascontiguousarray(image.to_camera(vertices)),
            model.triangles,
            regions,
            np.array(image.depth, order="C"),  # a kernel is compiled for one memory layout
            image.depth_scale,
            image.intrinsics.pinhole,
            tolerance,
            seen,
        )
    return np.asarray(areas[:, 1] / np.maximum(areas[:, 0], np.finfo(float).tiny))


def log_unexplained_shares(
    model: BodyModel,
    pose: Array,
    joints: Array,
    subject: SubjectFrame,
    stretch: float,
    settings: CertaintySettings,
) -> Array:
    """For each joint (J,), the log of the share of points within its reach that pose (D,) does not explain.

    A limb that is elsewhere, or under loose clothes, leaves points without a surface. A point is unexplained
    if the nearest vertex is far away, with lengths along the line of sight scaled by `stretch`. `joints`
    (J, 3) are those of the pose.
    """
    vertices, scale = pose_vertices(model, pose[None]), np.array([1.0, 1.0, stretch])
    weights, unexplained = np.ones(len(joints)), np.zeros(len(joints))
    stride = max(1, sum(len(view.picked) for view in subject.views) // SAMPLED_POINTS)
    for view in subject.views:
        points = camera_points(view, stride) * scale
        explained = mark_near(points, view.image.to_camera(vertices) * scale, settings.unexplained_m)[0]
        add_near(
            points, explained, view.image.to_camera(joints) * scale, settings.reach_m, weights, unexplained
        )
    return np.log(unexplained / weights + settings.share_floor)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_near(
    points: Array, explained: Mask, joints: Array, reach_m: float, weights: Array, unexplained: Array
) -> None:
    """Add each point's weight near a joint to weights (J,) and, if not explained, to unexplained (J,)."""
    scale = -0.5 / (reach_m * reach_m)
    for p in range(len(points)):
        for j in range(len(joints)):
            dx, dy, dz = points[p, 0] - joints[j, 0], points[p, 1] - joints[j, 1], points[p, 2] - joints[j, 2]
            exponent = scale * (dx * dx + dy * dy + dz * dz)
            if exponent > NEGLIGIBLE:
                near = np.exp(exponent)
                weights[j] += near
                unexplained[j] += 0.0 if explained[p] else near


@numba.njit(cache=True, nogil=True)
def add_areas(
    vertices: Array,
    triangles: NDArray[np.integer],
    regions: Array,
    depth: NDArray[np.uint16],
    scale: float,
    pinhole: Pinhole,
    tolerance: Tolerance,
    areas: Array,
) -> None:
    """Add the area that faces the camera, and its visible part, to areas (2, J); regions (T, J) weight it."""
    middle, normal = np.empty(3), np.empty(3)
    for t in range(len(triangles)):
        a, b, c = vertices[triangles[t, 0]], vertices[triangles[t, 1]], vertices[triangles[t, 2]]
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            middle[i] = (a[i] + b[i] + c[i]) / 3.0
            normal[i] = (b[j] - a[j]) * (c[k] - a[k]) - (b[k] - a[k]) * (c[j] - a[j])
        x, y, z = middle
        if z <= 0.0:
            continue
        facing_area = -(normal[0] * x + normal[1] * y + normal[2] * z)
        if facing_area <= 0.0:
            continue
        facing_area /= np.sqrt(x * x + y * y + z * z)
        shown = 1.0 if agrees_with_depth(x, y, z, depth, scale, pinhole, tolerance) else 0.0
        for joint in range(regions.shape[1]):
            areas[0, joint] += regions[t, joint] * facing_area
            areas[1, joint] += regions[t, joint] * facing_area * shown


@numba.njit(cache=True, nogil=True)
def agrees_with_depth(
    x: float,
    y: float,
    z: float,
    depth: NDArray[np.uint16],
    scale: float,
    pinhole: Pinhole,
    tolerance: Tolerance,
) -> bool:
    """Whether the subject's measured depth (H, W) agrees with a point, at its pixel or next to it."""
    aside_m = tolerance.aside_m
    fx, fy, cx, cy = pinhole
    for dy in (-aside_m, 0.0, aside_m):
        row = int(np.floor(cy + fy * (y + dy) / z + 0.5))
        if row < 0 or row >= depth.shape[0]:
            continue
        for dx in (-aside_m, 0.0, aside_m):
            column = int(np.floor(cx + fx * (x + dx) / z + 0.5))
            if column < 0 or column >= depth.shape[1] or depth[row, column] == 0:
                continue
            if abs(depth[row, column] / scale - z) * tolerance.stretch <= tolerance.agrees_m:
                return True
    return False


@lru_cache(maxsize=16)
def regions_of(model: BodyModel, region_m: float) -> Array:
    """The weight (T, J) of each triangle for each joint: high if it is near, on a link that meets the joint.

    `region_m` is the standard deviation of the weight by distance, metres.
    """
    joints = joint_positions(model, np.zeros((1, len(model.kinds))))[0]
    middles, links = model.vertices[model.triangles].mean(axis=1), model.skin_links[model.triangles[:, 0], 0]
    links_with_triangles = np.unique(links)
    # for each degree of freedom, the first link with triangles that it moves; the last assignment wins
    first = {int(model.link_dofs[link]): int(link) for link in links_with_triangles[::-1]}
    dofs = model.link_dofs.tolist()
    # for each link, the nearest ancestor degree of freedom that moves a link with triangles
    ends = [d if d < 0 else nearest_in(model, first, int(model.parents[d])) for d in dofs]
    above = np.array([-1 if d < 0 else first.get(end, -1) for d, end in zip(dofs, ends, strict=True)])
    weights = np.zeros((len(links), len(joints)))
    for j, link in enumerate(model.joint_links):
        meet = (links == link) | (links == above[link]) | (above[links] == link)
        near = np.flatnonzero(meet | ~meet.any())
        squares = np.sum((middles[near] - joints[j]) ** 2, axis=1)
        weights[near, j] = np.exp(-0.5 * (squares - squares.min()) / region_m**2)
    return weights
