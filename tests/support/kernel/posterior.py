"""A person and an arm before a camera, and the posterior of Eq. 7 there, computed in plain numpy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import msgspec
import numpy as np
from numpy.typing import NDArray

from gepf.common.activation import activate
from gepf.common.arrays import Array, Indices, Mask
from gepf.common.body import ROTATION, BodyModel
from gepf.common.camera import Intrinsics, project
from gepf.common.frame import EMPTY, HIDDEN, SUBJECT, UNMEASURED, SubjectFrame
from gepf.common.kinematics import keypoint_positions, link_transforms, pose_vertices, retract, within_limits
from gepf.common.refinement import KEYPOINT_OUTLIER, KEYPOINT_WEIGHT
from gepf.common.settings import RefineSettings
from gepf.coordinator.bodies.human.template import DEFAULT_ACTIVE, human
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.scene.noise import SensorNoise
from gepf.coordinator.synthesis.noise import add_noise
from gepf.coordinator.synthesis.scenes import ARM_DOFS
from gepf.worker.kernel.surface import Surface
from gepf.worker.kernel.terms.soft import OUTLIER_DENSITY, sample_window
from gepf.worker.kernel.visibility import DepthImage
from tests.support.kernel import plain_path
from tests.support.kernel.kernel_cases import DEFAULT, PAPER
from tests.support.people import alone, frame_of, rendered, subject_of

CAMERA = Intrinsics(320, 240, 300.0, 300.0, 159.5, 119.5)
POINTS = 800
FAR, NEAR = 0.3, 0.03  # radians and metres: how far the random poses are off
STANDING = {"root_tz": 2.9, "r_shoulder_flexion": 0.9, "r_shoulder_abduct": 0.7, "r_elbow_flexion": 1.1}
CLEAN, HEAVY = SensorNoise(0.004, 0.004), SensorNoise(0.15, 0.01)
ROOM, COLOUR = "in a room", "with keypoints"
SETTINGS = {
    "default": DEFAULT,
    ROOM: DEFAULT,
    COLOUR: DEFAULT,
    "other noise along than across": msgspec.structs.replace(DEFAULT, noise_depth=0.015, noise_lateral=0.008),
    "clothed": msgspec.structs.replace(DEFAULT, outside_weight=0.5),
    "paper": PAPER,
    "soft": msgspec.structs.replace(DEFAULT, noise_depth=HEAVY.depth, noise_lateral=HEAVY.lateral),
}
BODIES = ("person", "arm")


@dataclass(frozen=True, slots=True, eq=False)
class PosteriorCase:
    """A body before a camera, its truth and the settings."""

    model: BodyModel
    truth: Array  # (D,)
    subject: SubjectFrame
    settings: RefineSettings


@cache
def posterior_case(body: str, name: str) -> PosteriorCase:
    """The person with all of the usual degrees of freedom, or with the paper's arm alone, seen with noise."""
    whole, settings = human(), SETTINGS[name]
    model = activate(whole, ARM_DOFS if body == "arm" else DEFAULT_ACTIVE, name_pose(whole, STANDING))
    truth = np.array([STANDING.get(dof, 0.0) for dof in model.dof_names])
    noise = HEAVY if settings.is_soft else CLEAN
    noisy = add_noise(rendered(model, truth[None], CAMERA)[0], CAMERA, noise, np.random.default_rng(0))
    subject = subject_of(frame_of(0, noisy, CAMERA, 1e4), POINTS)
    if name == COLOUR:
        view = subject.largest
        subject = alone(replace(view, keypoints=seen_keypoints(model, truth, view.image.intrinsics)))
    return PosteriorCase(model, truth, in_a_room(subject) if name == ROOM else subject, settings)


def seen_keypoints(model: BodyModel, pose: Array, camera: Intrinsics) -> NDArray[np.float32]:
    """Keypoints (K, 3) of a pose (D,) with errors, two of them exchanged, and one that was not seen."""
    rng, pixels = np.random.default_rng(4), project(keypoint_positions(model, pose[None])[0], camera)
    deviations = rng.uniform(1.0, 6.0, len(pixels))
    pixels += deviations[:, None] * rng.normal(size=pixels.shape)
    pixels[[7, 8]] = pixels[[8, 7]]
    precisions = deviations**-2.0
    precisions[9] = 0.0
    return np.column_stack([pixels, precisions]).astype(np.float32)


def in_a_room(subject: SubjectFrame) -> SubjectFrame:
    """The frame with patches beside the subject of which the camera measured nothing, or something nearer."""
    rng, depth = np.random.default_rng(2), subject.largest.image.depth
    patches = rng.choice([EMPTY, EMPTY, UNMEASURED, HIDDEN], size=-(-np.array(depth.shape) // 6))
    beside = np.kron(patches, np.ones((6, 6), dtype=np.uint8))[: depth.shape[0], : depth.shape[1]]
    kinds = np.where(depth > 0, SUBJECT, beside).astype(np.uint8)
    return alone(replace(subject.largest, labels=kinds))


def random_poses(of: PosteriorCase, count: int) -> Array:
    """Poses (count, D) around the truth, near and far; single axes within their limits, balls beyond, too."""
    rng, turning = np.random.default_rng(1), of.model.kinds == ROTATION
    spread = np.where(turning, FAR, NEAR) * rng.uniform(0.1, 1.0, size=(count, 1))
    return within_limits(of.model, of.truth + spread * rng.normal(size=(count, len(of.truth))))


STEP = 1e-6  # radians and metres


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """The samples around each point (P, K): which link carries them, where on it, and their areas."""

    links: Indices  # (P, K)
    at_rest: Array  # (P, K, 3)
    angles: Array  # (P, K) solid angles that they stand for; 0 where there is none


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """What is fixed at a pose: points, correspondences, visibility."""

    model: BodyModel
    settings: RefineSettings
    points: Array  # (P, 3)
    closest: Indices  # (P,) vertices
    normals: Array  # (V, 3) of the surface
    visible: Indices  # (Q,) vertices
    rays: Array  # (Q, 2) of the outline's nearest pixels, for each metre of depth
    free: Mask  # (Q,) whether each of them is in free space
    samples: Samples | None  # of soft correspondences
    subject: SubjectFrame


def hold(
    model: BodyModel,
    pose: Array,
    subject: SubjectFrame,
    settings: RefineSettings,
    drawn: tuple[DepthImage, Surface] | None = None,
) -> Held:
    """Visibility and correspondences at a pose (D,); soft ones with its depth image and surface."""
    posed, visible = plain_path.visible_vertices(model, pose)
    points, camera = plain_path.observed_points(subject), subject.largest.image.intrinsics
    index = plain_path.closest_points(points, posed[visible], settings)
    facing = plain_path.is_measurable(model, pose, posed)[visible]
    outline, free = plain_path.nearest_outline(posed[visible], facing, subject)
    rays = (outline - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    samples = None if drawn is None else take_samples(model, pose, points, settings, *drawn)
    normals = plain_path.posed_normals(model, pose)
    return Held(model, settings, points, visible[index], normals, visible, rays, free, samples, subject)


def take_samples(
    model: BodyModel, pose: Array, points: Array, settings: RefineSettings, grid: DepthImage, surface: Surface
) -> Samples:
    """The pixels of a depth image of a pose (D,) around the ray of each point (P, 3)."""
    radius, apart = sample_window(settings.noise_lateral)
    rays = points[:, :2] / points[:, 2:]
    middle = np.floor(grid.focal * rays - (grid.left, grid.top) + 0.5).astype(int)
    around = np.arange(-radius, radius + 1, apart)
    window = np.stack(np.meshgrid(around, around, indexing="xy"), axis=-1).reshape(-1, 2)
    size = np.array(grid.depth.shape[::-1])
    place = middle[:, None] + window  # (P, K, 2)
    inside = np.all((place >= 0) & (place < size), axis=-1)
    place = np.where(inside[..., None], place, 0)
    z = grid.depth[place[..., 1], place[..., 0]].astype(np.float64)
    there = inside & np.isfinite(z)
    triangles = np.where(there, grid.triangles[place[..., 1], place[..., 0]], 0)
    links = surface.skin_links[surface.triangles[triangles, 0], 0].astype(np.int64)
    z, links = np.where(there, z, 1.0), np.where(there, links, 0)
    x, y = (place[..., a] + edge for a, edge in enumerate((grid.left, grid.top)))
    at = np.stack([x * z / grid.focal, y * z / grid.focal, z], axis=-1)
    carriers = link_transforms(model, pose[None])[0][links]
    at_rest = np.einsum("pkba,pkb->pka", carriers[..., :3], at - carriers[..., 3])
    return Samples(links, at_rest, there * (apart / grid.focal) ** 2)


def log_posterior(held: Held, poses: Array) -> Array:
    """The log posterior (N,) of poses (N, D)."""
    settings = held.settings
    soft = held.samples is not None  # without a prior for rest
    rules = msgspec.structs.replace(settings, pose_deviation=0.0) if soft else settings
    prior = plain_path.prior_costs(held.model, poses, rules)
    if held.samples is not None:
        density = log_density(held, held.samples, poses).mean(axis=1)
        return np.asarray(settings.independent_points * (density - 0.5 * prior / settings.noise_lateral**2))
    posed = pose_vertices(held.model, poses)
    cost = point_cost(held, posed) + free_space_cost(held, posed) + prior
    return np.asarray(-0.5 * cost / settings.likelihood_scale**2 - keypoint_cost(held, poses))


def keypoint_cost(held: Held, poses: Array) -> Array:
    """Half the robust squared distances (N,) of the keypoints, in deviations."""
    if held.subject.largest.keypoints is None:
        return np.zeros(len(poses))
    offsets = keypoint_offsets(held.model, poses, held.subject)
    squared = held.subject.largest.keypoints[:, 2] * np.sum(offsets**2, axis=-1)
    costs = KEYPOINT_OUTLIER**2 * squared / (KEYPOINT_OUTLIER**2 + squared)
    return np.asarray(0.5 * KEYPOINT_WEIGHT * np.sum(costs, axis=1))


def keypoint_offsets(model: BodyModel, poses: Array, subject: SubjectFrame) -> Array:
    """From where keypoints were seen to where the body has them (N, K, 2), pixels."""
    assert subject.largest.keypoints is not None
    pixels = project(keypoint_positions(model, poses), subject.largest.image.intrinsics)
    return np.asarray(pixels - subject.largest.keypoints[:, :2])


def point_cost(held: Held, posed: Array) -> Array:
    """Mean robust cost (N,) of the points, in the metric of the noise, for surfaces (N, V, 3)."""
    settings = held.settings
    radii, normals = plain_path.disc_radii(held.model)[held.closest], held.normals[held.closest]
    offsets = plain_path.surface_offsets(held.points, posed[:, held.closest], normals, radii, settings)
    return np.asarray(plain_path.robust_cost(np.sum(offsets**2, axis=-1), settings).mean(axis=1))


def free_space_cost(held: Held, posed: Array) -> Array:
    """Mean robust cost (N,) of visible vertices that lie where the camera saw nothing."""
    seen = posed[:, held.visible]
    off = held.rays * seen[..., 2:] - seen[..., :2]
    cost = plain_path.robust_cost(np.sum(off**2, axis=-1), held.settings) * held.free
    return np.asarray((held.settings.sensor == "camera") * cost.mean(axis=1))


def log_density(held: Held, samples: Samples, poses: Array) -> Array:
    """Log p(p_i) (N, P) of the points, the samples carried along by their links."""
    noise = held.settings.noise_lateral, held.settings.noise_depth
    found = np.empty((len(poses), len(held.points)))
    for n, transforms in enumerate(link_transforms(held.model, poses)):
        carriers = transforms[samples.links]
        at = np.einsum("pkab,pkb->pka", carriers[..., :3], samples.at_rest) + carriers[..., 3]
        rays = held.points[:, None, :2] / held.points[:, None, 2:]
        across = np.sum((rays * at[..., 2:] - at[..., :2]) ** 2, axis=-1) / noise[0] ** 2
        along = (held.points[:, None, 2] - at[..., 2]) ** 2 / noise[1] ** 2
        areas = samples.angles * (at[..., 2] / noise[0]) ** 2
        each = areas / (2.0 * np.pi) * np.exp(-0.5 * (across + along))
        found[n] = np.log(each.sum(axis=1) + OUTLIER_DENSITY)
    return found


def slope(held: Held, pose: Array) -> Array:
    """Its derivative (D,) by every degree of freedom's step from a pose (D,)."""
    return finite_differences(held.model, pose, lambda poses: log_posterior(held, poses))


def finite_differences(model: BodyModel, pose: Array, value: Callable[[Array], Array]) -> Array:
    """The derivative (D,) at a pose (D,) of a value (N,) of poses (N, D), by steps."""
    steps = STEP * np.eye(len(pose))
    sides = [retract(model, np.tile(pose, (len(pose), 1)), way) for way in (steps, -steps)]
    ahead, behind = np.split(value(np.concatenate(sides)), 2)
    return np.asarray((ahead - behind) / (2.0 * STEP))
