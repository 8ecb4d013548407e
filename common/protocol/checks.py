"""What comes off the wire is within the bounds of `common.bounds` or is refused."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.body import ROTATION, TRANSLATION
from common.bounds import (
    LARGEST_DEVIATION,
    LARGEST_LENGTH,
    LARGEST_LOG_LIKELIHOOD,
    LARGEST_PIXEL,
    LARGEST_POSE,
    LARGEST_SETTING,
    LARGEST_SIZE,
    MAX_DOFS,
    MAX_ITERATIONS,
    MAX_PARTICLES,
    MAX_PIXELS,
    MAX_SIZES,
    POSITIVE_SETTINGS,
    SMALLEST_POSITIVE,
    most_covariances,
)
from common.camera import Intrinsics
from common.errors import ProtocolError
from common.protocol.arrays import check_finite, check_indices, check_numbers
from common.protocol.replies import are_refined, are_roots
from common.refinement import Refined
from common.settings import RefineSettings
from common.triangles import row_starts


def check_camera(camera: Intrinsics, depth_scale: float) -> None:
    """ProtocolError unless the numbers make a camera."""
    check_finite("the camera", np.array([camera.fx, camera.fy, camera.cx, camera.cy, depth_scale]))
    if not (camera.width > 0 and camera.height > 0 and camera.width * camera.height <= MAX_PIXELS):
        raise ProtocolError(
            f"a frame has 1 to {MAX_PIXELS} pixels, this one {camera.width} by {camera.height}"
        )
    if min(camera.fx, camera.fy, depth_scale) <= 0.0:
        raise ProtocolError("focal lengths and depth scale must be above zero")
    check_range("a focal length", min(camera.fx, camera.fy), 1e-3, LARGEST_PIXEL)
    check_range("a focal length", max(camera.fx, camera.fy), 1e-3, LARGEST_PIXEL)
    check_range("the depth scale", depth_scale, 1e-3, LARGEST_PIXEL)
    check_range("the camera's centre", max(abs(camera.cx), abs(camera.cy)), 0.0, LARGEST_PIXEL)


def check_range(what: str, value: float, least: float, largest: float) -> None:
    """ProtocolError unless least <= value <= largest."""
    if not least <= value <= largest:
        raise ProtocolError(f"{what} is {value:g}, expected {least:g} to {largest:g}")


def check_poses(poses: NDArray[np.float64]) -> None:
    """ProtocolError unless there are poses (N, D) of a possible size and number."""
    if not 0 < len(poses) <= MAX_PARTICLES:
        raise ProtocolError(f"a batch has 1 to {MAX_PARTICLES} poses, this one {len(poses)}")
    if not 0 < poses.shape[1] <= MAX_DOFS:
        raise ProtocolError(f"a pose has 1 to {MAX_DOFS} values, these {poses.shape[1]}")
    check_magnitude("poses", poses, LARGEST_POSE)


def check_sizes(sizes: NDArray[np.float64]) -> None:
    """ProtocolError unless these are few sizes (N, 2) of possible bodies."""
    check_magnitude("sizes", sizes, LARGEST_SIZE)
    if not sizes[:, 1].min() > 0.0:
        raise ProtocolError("sizes hold a scale that is not above zero")
    changes = np.count_nonzero(np.any(sizes[1:] != sizes[:-1], axis=1))
    if changes >= MAX_SIZES:
        raise ProtocolError(f"a batch has {MAX_SIZES} sizes at the most, this one {changes + 1}")


def check_magnitude(what: str, array: NDArray[np.float64], largest: float) -> None:
    """ProtocolError if there is a value beyond plus or minus `largest`, or something that is no number."""
    if array.size and not np.abs(array).max() <= largest:  # nor for a NaN; one look at what is mostly right
        check_finite(what, array)
        raise ProtocolError(f"{what} holds values above {largest:g}")


def check_refined(refined: Refined) -> None:
    """ProtocolError unless these can be refined particles; where nothing was observed some are infinite."""
    log_likelihood, residual = refined.log_likelihood, refined.residual
    if are_refined(refined.poses, log_likelihood, residual):
        return
    check_magnitude("the reply's poses", refined.poses, LARGEST_POSE)
    if log_likelihood.min(initial=0.0) == -np.inf:
        log_likelihood = log_likelihood[log_likelihood != -np.inf]
    check_magnitude("the reply's log_likelihood", log_likelihood, LARGEST_LOG_LIKELIHOOD)
    if not residual.min(initial=0.0) >= 0.0:
        check_numbers("the reply's residual", residual)
        raise ProtocolError("the reply's residual holds values below zero")


def check_covariance_roots(roots: NDArray[np.float32], dofs: int) -> None:
    """ProtocolError unless these (N, D (D + 1) / 2) are factors of covariances, none of them too wide."""
    if are_roots(roots, dofs):
        return
    rows = row_starts(dofs)
    if not roots[:, rows + np.arange(dofs)].min(initial=1.0) > 0.0:  # nor for a NaN
        check_finite("the reply's covariance_roots", roots)
        raise ProtocolError("the reply's covariance_roots have a diagonal that is not above zero")
    largest = np.sqrt(np.add.reduceat(np.square(roots, dtype=np.float64), rows, axis=1).max(initial=0.0))
    if not largest <= LARGEST_DEVIATION:
        check_finite("the reply's covariance_roots", roots)
        raise ProtocolError(
            f"the reply's covariance has a deviation of {largest:g}, expected {LARGEST_DEVIATION:g}"
        )


def check_reply(poses: tuple[int, ...]) -> None:
    """ProtocolError if covariances of poses of shape (N, D) would not fit into a reply."""
    count, dofs = poses
    most = most_covariances(dofs)
    if count > most:
        raise ProtocolError(
            f"covariances of {count} poses of {dofs} values are too many, expected up to {most}"
        )


@lru_cache(maxsize=64)  # a run's are always the same
def check_settings(settings: RefineSettings) -> None:
    """ProtocolError for numbers that no refinement can be done with."""
    for name, value in msgspec.structs.asdict(settings).items():
        if isinstance(value, float):
            check_finite(f"setting {name}", value)
            least = SMALLEST_POSITIVE if name in POSITIVE_SETTINGS else 0.0
            check_range(f"setting {name}", value, least, LARGEST_SETTING)
        elif isinstance(value, int) and not 0 <= value <= MAX_ITERATIONS:
            raise ProtocolError(f"setting {name} is {value}, expected 0 to {MAX_ITERATIONS}")


def check_model(arrays: dict[str, NDArray[Any]], sizes: dict[str, int]) -> None:
    """ProtocolError where an index would leave its array, or a number is none or beyond computing with."""
    for letter, what in (("D", "degrees of freedom"), ("L", "links"), ("V", "vertices"), ("K", "skin links")):
        if sizes[letter] == 0:
            raise ProtocolError(f"the model has no {what}")
    if sizes["D"] > MAX_DOFS:
        raise ProtocolError(f"the model has {sizes['D']} degrees of freedom, expected at most {MAX_DOFS}")
    for name, array in arrays.items():
        check_numbers(f"the model's {name}", array)
        if array.dtype.kind == "f" and name != "limits":
            check_magnitude(f"the model's {name}", array, LARGEST_LENGTH)
    check_limits(arrays["limits"])
    check_links(arrays, sizes)


def check_limits(limits: NDArray[np.float64]) -> None:
    """ProtocolError unless there is a possible value between all limits (D, 2)."""
    lower, upper = limits[:, 0], limits[:, 1]
    if np.any(lower > upper) or np.any(lower > LARGEST_POSE) or np.any(upper < -LARGEST_POSE):
        raise ProtocolError("the model's limits leave no room between them")


def check_links(arrays: dict[str, NDArray[Any]], sizes: dict[str, int]) -> None:
    """ProtocolError where an index would leave its array."""
    ranges = {
        "kinds": (TRANSLATION, ROTATION + 1),
        "parents": (-1, sizes["D"]),
        "balls": (0, sizes["D"] - 2),
        "link_dofs": (-1, sizes["D"]),
        "triangles": (0, sizes["V"]),
        "skin_links": (0, sizes["L"]),
        "joint_links": (0, sizes["L"]),
    }
    for name, (least, end) in ranges.items():
        check_indices(f"the model's {name}", arrays[name], least, end)
    if np.any(np.diff(arrays["balls"]) < 3):
        raise ProtocolError("the model's balls must be in ascending order and share nothing")
