"""Colours of a rendered person: skin, hair, shirt, trousers and shoes."""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import BodyModel

SKINS = np.array([[0.88, 0.67, 0.55], [0.78, 0.53, 0.35], [0.55, 0.33, 0.20]])
BROWN = np.array([1.0, 0.8, 0.6])
TROUSERS, SHOES = ("pelvis", "thigh", "shank"), ("talus", "heel", "foot", "toes")

FACE = {
    (-0.019, -0.423, -0.065): (0.05, 0.04, 0.04),
    (0.019, -0.423, -0.065): (0.05, 0.04, 0.04),
    (0.0, -0.385, -0.07): (0.6, 0.2, 0.2),
}
"""Eyes and mouth: places as shares of stature, and colours."""


def dress(model: BodyModel, rng: np.random.Generator) -> Array:
    """Colours (V, 3), from 0 to 1, of a person's vertices in random clothes."""
    skin, shirt, trousers = (
        SKINS[rng.integers(len(SKINS))],
        rng.uniform(0.1, 1.0, 3),
        rng.uniform(0.05, 0.55, 3),
    )
    hair, shoes = rng.uniform(0.05, 0.35) * BROWN, rng.uniform(0.05, 0.3) * np.ones(3)
    parts = [name.split("_")[-1] for name in model.link_names]
    part = np.array(parts)[model.skin_links[:, 0]]
    _, y, z = model.vertices.T
    high = y < -0.456 * np.ptp(y)  # above the hairline
    colours = np.tile(shirt, (len(part), 1))
    colours[np.isin(part, TROUSERS)] = trousers
    colours[np.isin(part, SHOES)] = shoes
    colours[part == "hand"] = skin
    colours[np.isin(part, ("skull", "vc4"))] = skin
    head = np.isin(part, ("skull", "vc4"))
    colours[head & (high | (z > 0.0))] = hair
    for place, colour in FACE.items():
        off = model.vertices - np.array(place) * np.ptp(y)
        nearest = np.argsort(np.where(head, np.linalg.norm(off, axis=1), np.inf))[:1]
        colours[nearest] = colour
    return colours
