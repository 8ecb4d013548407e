"""The Cramer-Rao bound of the moving angles from one noisy frame, computed with the renderer.

The noise is that of `gepf synth`: a pixel reads the exact depth image at a place displaced by Gaussian
noise, plus Gaussian noise along depth, independently of all others. So its reading z has the density

    p(z) = sum over pixels q of g_lateral(q) N(z; d(q), depth noise)

with d the rendered depth near it. The probability of no reading is the weight of the empty pixels. The
Fisher information of angles i, j is the sum over pixels and readings of (dp/di) (dp/dj) / p, with derivatives
from central differences of rendered images. It includes all information of the image: depth, slopes, the
outline against the background (blurred by the lateral noise) and the arm's outline against the body.

Simplifications: the sampled points are treated as drawn independently from all measured pixels (a Poisson
process). So they have their share of the measured pixels' information, and empty pixels count only for the
whole image. The width of the lateral noise in pixels is that at the shoulder's depth. The shape, the noise
and all other angles are known exactly, as for the tracker. A biased estimator, for example one that knows
joint limits, can be better than the bound. One that does not use the whole image does not reach it.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from scipy.ndimage import gaussian_filter

from gepf.common.arrays import Array
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.coordinator.scene.noise import SensorNoise
from gepf.coordinator.synthesis.rendering import DepthRenderer
from gepf.coordinator.synthesis.scenes import ARM_DOFS, Scene

STEP = np.radians(1.0)  # of the central differences: a hand moves by a few pixels, less than the noise
EVERY = 4  # frames between those whose information is rendered
LEVELS_PER_DEVIATION, REACH = 2.0, 4.0  # of the readings that are summed over
EXPECTED_ABSOLUTE = np.sqrt(2.0 / np.pi)  # of a Gaussian with standard deviation 1


class Bound(msgspec.Struct, frozen=True):
    """Smallest mean absolute error in degrees, by angle and over all angles."""

    points: int | None  # None for every pixel, including empty ones
    by_angle_deg: dict[str, float]
    mean_deg: float


def information(
    renderer: DepthRenderer, scene: Scene, active: Sequence[str], noise: SensorNoise, frame: int
) -> tuple[Array, Array, int]:
    """Fisher information (A, A) of the angles in one frame, 1/rad^2.

    Returns:
        That of all measured pixels, that of all pixels, and the number of measured pixels.
    """
    pose, dofs = scene.poses[frame], [scene.model.dof(name) for name in active]
    steps = STEP * np.eye(len(pose))[dofs]
    images = [exact_depth(renderer, scene, p) for p in (pose, *(pose + steps), *(pose - steps))]
    window = moving_window(images, noise, scene)
    cut = [image[window] for image in images]
    width = noise.lateral * scene.camera.fx / shoulder_depth(scene, pose)
    levels = readings(cut, noise)
    measured, nothing = np.zeros((len(dofs),) * 2), np.zeros((len(dofs),) * 2)
    for level in levels:
        measured += gather([density(image, level, noise.depth, width) for image in cut])
    nothing += gather([gaussian_filter((image <= 0.0).astype(float), width) for image in cut])
    spacing = levels[1] - levels[0]
    return measured * spacing, measured * spacing + nothing, int(np.sum(images[0] > 0.0))


def exact_depth(renderer: DepthRenderer, scene: Scene, pose: Array) -> Array:
    """Depth (H, W) in metres."""
    vertices = pose_vertices(scene.model, pose[None])[0]
    return renderer.depth(vertices, scene.model.triangles).astype(np.float64)


def moving_window(images: Sequence[Array], noise: SensorNoise, scene: Scene) -> tuple[slice, slice]:
    """Rows and columns that differ between images, and a margin as wide as the lateral noise."""
    changed = np.any([image != images[0] for image in images[1:]], axis=0)
    rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
    nearest = images[0][images[0] > 0.0].min()
    reach = int(np.ceil(REACH * noise.lateral * scene.camera.fx / nearest))
    return slice(max(0, rows[0] - reach), rows[-1] + reach + 1), slice(
        max(0, columns[0] - reach), columns[-1] + reach + 1
    )


def shoulder_depth(scene: Scene, pose: Array) -> float:
    """Depth of the right shoulder in metres."""
    joint = scene.model.joint_names.index("right_shoulder")
    return float(joint_positions(scene.model, pose[None])[0, joint, 2])


def readings(images: Sequence[Array], noise: SensorNoise) -> Array:
    """Depths (K,) in metres that cover all that a noisy pixel may read."""
    depths = np.concatenate([image[image > 0.0] for image in images])
    low, high = depths.min() - REACH * noise.depth, depths.max() + REACH * noise.depth
    return np.arange(low, high, noise.depth / LEVELS_PER_DEVIATION)


def density(image: Array, level: float, depth_noise: float, width: float) -> Array:
    """Density (H, W) of every pixel's reading at one depth, 1/m."""
    off = (level - image) / depth_noise
    sharp = np.where(image > 0.0, np.exp(-0.5 * off * off) / (depth_noise * np.sqrt(2.0 * np.pi)), 0.0)
    blurred: Array = gaussian_filter(sharp, width)
    return blurred


def gather(densities: Sequence[Array]) -> Array:
    """Fisher information (A, A) summed over pixels, from the density and those after steps ahead and back.

    It is 4 r_i r_j of the root's derivatives, which stay bounded where the density itself is next to nothing.
    """
    count = (len(densities) - 1) // 2
    roots = [np.sqrt(one) for one in densities]
    slopes = np.array([(roots[1 + a] - roots[1 + count + a]).ravel() for a in range(count)]) / (2.0 * STEP)
    gathered: Array = 4.0 * slopes @ slopes.T
    return gathered


def bounds(scene: Scene, noise: SensorNoise) -> list[Bound]:
    """What single frames of the arm allow on average, from picked points and from all pixels."""
    frames = range(0, len(scene.poses), EVERY)
    with DepthRenderer(scene.camera) as renderer:
        parts = [information(renderer, scene, ARM_DOFS, noise, frame) for frame in frames]
    measured, everything, counts = (np.array(column) for column in zip(*parts, strict=True))
    found = []
    for points in (4_000, 10_000, None):
        told = everything if points is None else measured * np.minimum(1.0, points / counts)[:, None, None]
        deviations = np.sqrt(np.diagonal(np.linalg.inv(told), axis1=1, axis2=2))
        by_angle = np.degrees(EXPECTED_ABSOLUTE * deviations).mean(axis=0)
        named = dict(zip(ARM_DOFS, by_angle.round(3).tolist(), strict=True))
        found.append(Bound(points, named, round(float(by_angle.mean()), 3)))
    return found
