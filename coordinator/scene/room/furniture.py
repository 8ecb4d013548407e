"""What stands alone in some frames of a recording and is as flat as furniture.

Who stands at a cabinet hangs together with it in depth; in other frames it is seen for what it is.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from common.frame import DepthFrame
from coordinator.scene.people.candidates import FLAT, foreground, spread_of
from coordinator.scene.people.components import Component, components, largest_plane
from coordinator.scene.scene import Scene
from coordinator.scene.view import SceneView

LEAST_AREA = 0.15  # square metres that are seen
OFTEN = 0.2  # share of the frames in which a pixel shows it
ALIKE = 0.1  # metres
TWO_FACES = 0.9  # share in two planes from which on it is a box: people stay below, as with FLAT


def furniture(frames: Iterable[DepthFrame]) -> NDArray[np.float32] | None:
    """Depth (H, W) of what is furniture in several of these frames, metres, 0 elsewhere; None without any.

    The frames are of one camera that stands still, and spread over a recording.
    """
    scene, seen = Scene(), list[NDArray[np.float32]]()
    for frame in frames:
        view = scene.see(frame)
        shown = np.zeros_like(view.depth)
        for part in components(view, foreground(view)):
            if part.area >= LEAST_AREA and is_boxy(view, part):
                mask = part.mask(view)
                shown[mask] = view.depth[mask]
        seen.append(shown)
    return what_stays(np.array(seen))


def what_stays(depth: NDArray[np.float32]) -> NDArray[np.float32] | None:
    """Of depths (F, H, W), 0 where nothing is meant, those (H, W) that are alike in many frames."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of pixels that show it in no frame
        middle = np.nan_to_num(np.nanmedian(np.where(depth > 0.0, depth, np.nan), axis=0))
    alike = (depth > 0.0) & (np.abs(depth - middle) < ALIKE)
    stays = np.count_nonzero(alike, axis=0) >= OFTEN * len(depth)
    return np.where(stays, middle, 0.0).astype(np.float32) if stays.any() else None


def is_boxy(view: SceneView, part: Component) -> bool:
    """Whether a part is flat, or two planes hold nearly all of it."""
    spread = spread_of(view, part)
    plane, share = largest_plane(part.points, spread)
    if share >= FLAT:
        return True
    rest = part.points[np.abs(part.points @ plane[:3] + plane[3]) > spread]
    return len(rest) > 3 and (1.0 - share) * (1.0 - largest_plane(rest, spread)[1]) <= 1.0 - TWO_FACES
