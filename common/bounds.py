"""Bounds on the content of messages; within them kernels need no checks of indices and overflow."""

from __future__ import annotations

MAX_BYTES = 64 * 2**20  # of a message
MAX_PIXELS = 2**23  # of a frame
MAX_CAMERAS = 16  # of a rig
MAX_DOFS = 128  # of a body
MAX_PARTICLES = 1024  # of a request
MAX_ITERATIONS = 100  # of ICP
SMALLEST = 1e-4  # of positive values: focal lengths, units of depth, noise and scale in settings
LARGEST = 1e5  # of a pose, a length in a model (metres or radians), a camera's numbers (pixels), a setting
LARGEST_LOG_LIKELIHOOD = 1e100
LARGEST_PRECISION = 1e12  # of a prior
MOST_PIXELS = 2**26  # drawn into a depth buffer
MOST_WORK = 1e13  # of a request: comparisons of points, and pixels drawn
POSITIVE_SETTINGS = {"noise_depth", "noise_lateral", "likelihood_scale"}
