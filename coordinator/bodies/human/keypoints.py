"""Where the keypoints of networks are on a person: constant points of links.

Such points are not joint centres: networks were trained with what people clicked. They were measured with the
network of `gepf.coordinator.colour` on rendered people in random poses (`python -m benchmarks.keypoints`).
Around them, keypoints that the network calls visible scatter by 2 to 4 cm.
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array, Indices
from gepf.common.body import KEYPOINTS
from gepf.coordinator.bodies.carried_points import carry

POINTS = {
    "nose": ("skull", 0.0, -0.693, -0.087),
    "eye": ("skull", 0.022, -0.719, -0.065),
    "ear": ("skull", 0.044, -0.700, -0.026),
    "shoulder": ("clavicle", 0.151, -0.522, 0.014),
    "elbow": ("upper_arm", 0.225, -0.230, 0.002),
    "wrist": ("forearm", 0.275, 0.049, 0.014),
    "hip": ("pelvis", 0.082, -0.001, 0.002),
    "knee": ("thigh", 0.096, 0.394, 0.009),
    "ankle": ("shank", 0.096, 0.800, 0.023),
}
"""Keypoint -> its link and its place at rest on the left side of a person of 1.75 m, metres, rest frame."""


def attach_keypoints(
    vertices: Array, skin_links: Indices, link_names: tuple[str, ...]
) -> tuple[Indices, Indices, Array]:
    """The links (K,) of the keypoints, vertices (K, W) that carry each, and their shares (K, W).

    `vertices` (V, 3) are those of the mean adult of stature 1 at rest.
    """
    links, points, stature_m = list[int](), list[Array](), 1.75  # of the person of POINTS
    for keypoint in KEYPOINTS:
        side, _, part = keypoint.rpartition("_")
        name, *place = POINTS[part]
        links.append(link_names.index(name if name in link_names else f"{side[0]}_{name}"))
        points.append(np.array(place) / stature_m * (-1.0 if side == "right" else 1.0, 1.0, 1.0))
    return np.array(links), *carry(np.array(points), np.array(links), vertices, skin_links)
