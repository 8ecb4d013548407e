"""Bounds on what a worker accepts; within them kernels need no checks of indices and overflow."""

from __future__ import annotations

from common.errors import ProtocolError
from common.refinement import triangle_size
from common.settings import RefineSettings

MAX_PARTICLES = 100_000  # of one batch
MAX_ITERATIONS = 100
GAUSS_NEWTON_ITERATIONS = 5  # of an iteration of ICP, at the most
MAX_PIXELS = 2**23  # of a frame
MAX_DOFS = 1_000
LARGEST_LENGTH = 1e3  # metres, in a model
LARGEST_POSE = 1e5  # metres or radians
LARGEST_PIXEL = 1e6  # of a camera's focal lengths and centre
LARGEST_SETTING = 1e6
LARGEST_LOG_LIKELIHOOD = 1e100
LARGEST_COVARIANCES = 2**25  # bytes of a reply, half of what a message may have
LARGEST_DEVIATION = 1.0  # radians or metres: a standard deviation of where a pose may be
MOST_PIXELS = 2**26  # that may be drawn into a depth buffer
MOST_WORK = 1e13  # of a request: points compared, pixels drawn and products summed; some 20 minutes
POSITIVE_SETTINGS = {"noise_depth", "noise_lateral", "likelihood_scale"}
SMALLEST_POSITIVE = 1e-6


def most_covariances(dofs: int) -> int:
    """Of how many poses with so many degrees of freedom one reply may hold covariances."""
    return LARGEST_COVARIANCES // (4 * triangle_size(dofs))


def check_work(settings: RefineSettings, poses: tuple[int, ...], points: int, vertices: int) -> None:
    """ProtocolError if refining poses of shape (N, D) on so many points would take too long."""
    update, iteration = work_of(poses, points, vertices)
    work = update + settings.icp_iterations * iteration
    if work > MOST_WORK:
        raise ProtocolError(f"the request asks for up to {work:.0e} steps of work, expected {MOST_WORK:.0e}")


def most_iterations(poses: tuple[int, ...], points: int, vertices: int) -> int:
    """Of ICP, that a worker accepts for poses of shape (N, D) on so many points."""
    update, iteration = work_of(poses, points, vertices)
    return max(0, min(MAX_ITERATIONS, int((MOST_WORK - update) // iteration)))


def work_of(poses: tuple[int, ...], points: int, vertices: int) -> tuple[float, float]:
    """Steps of work of weighing poses (N, D) on so many points, and of each iteration of ICP."""
    count, dofs = poses
    update = 2.0 * count * (points * vertices + MOST_PIXELS)  # with soft correspondences
    return update, update + count * GAUSS_NEWTON_ITERATIONS * dofs**3
