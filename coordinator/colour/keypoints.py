"""Keypoints of a person in a colour image, with their precision."""

from __future__ import annotations

import enum

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Mask
from gepf.coordinator.colour.crop import Colours, Crop
from gepf.coordinator.colour.network import PoseNetwork
from gepf.coordinator.settings import ColourSettings

LANDMARK_OF = {
    "nose": 0, "left_eye": 2, "right_eye": 5, "left_ear": 7, "right_ear": 8, "left_shoulder": 11,
    "right_shoulder": 12, "left_elbow": 13, "right_elbow": 14, "left_wrist": 15, "right_wrist": 16,
    "left_hip": 23, "right_hip": 24, "left_knee": 25, "right_knee": 26, "left_ankle": 27, "right_ankle": 28,
}  # fmt: skip
"""Keypoint -> landmark of the network; in the order of `gepf.common.body.KEYPOINTS`."""
SHOULDERS, HIPS = (
    [list(LANDMARK_OF).index(f"{side}_{joint}") for side in ("left", "right")]
    for joint in ("shoulder", "hip")
)
TRUNK = [*SHOULDERS, *HIPS]
ACROSS = np.linspace(0.1, 0.9, 7)  # places between the corners of the trunk
INSIDE = np.array(
    [
        ((1 - down) * (1 - side), (1 - down) * side, down * (1 - side), down * side)
        for down in ACROSS
        for side in ACROSS
    ]
)
"""Weights (N, 4) of the corners at these places."""


class Auxiliary(enum.IntEnum):
    """Landmarks of the network that show where the person is."""

    MIDDLE = 33  # of the hips
    RIM = 34  # a point on the circle around the person


def find_keypoints(
    network: PoseNetwork, colours: Colours, measured: Mask, crop: Crop, settings: ColourSettings
) -> NDArray[np.float32] | None:
    """Keypoints (17, 3) of the person in a crop of an image: column, row, inverse variance (pixels^-2).

    None if the network sees nobody there.

    The image (h, w, 3) shows what the depth image shows, in which `measured` (H, W) marks pixels with depth.
    If the person fits the crop badly, the network looks again where it saw the person.
    """
    for _ in range(2):
        found = network.see(crop.take(colours, measured, settings.max_gap_px))
        if found.presence < settings.min_presence:
            return None
        middle, rim = crop.to_image(found.places[[Auxiliary.MIDDLE, Auxiliary.RIM]])
        seen_in, crop = crop, Crop.around(middle, float(np.linalg.norm(rim - middle)), rim - middle)
        if crop.fits(seen_in):
            break
    chosen = list(LANDMARK_OF.values())
    hidden = 1.0 - found.visibility[chosen]
    share = settings.visible_deviation_share + settings.hidden_deviation_share * hidden
    pixels = seen_in.to_image(found.places[chosen])
    return np.column_stack([pixels, (share * seen_in.side) ** -2.0]).astype(np.float32)


def trunk_pixels(keypoints: NDArray[np.float32]) -> NDArray[np.floating]:
    """Places (N, 2), spread evenly over the trunk of a person with these keypoints (17, 3), pixels."""
    return np.asarray(INSIDE @ keypoints[TRUNK, :2])
