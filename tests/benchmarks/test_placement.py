"""What a reference's own definition of joints explains, and what it does not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.placement import Placed, learn
from benchmarks.utd import JOINTS

Array = NDArray[np.float64]

FRAMES = 400


def moving(seed: int) -> Array:
    """Joints (F, 13, 3) of a body that is turned otherwise in each frame, its limbs held otherwise, too."""
    rng = np.random.default_rng(seed)
    rest = rng.normal(size=(len(JOINTS), 3))
    posed = rest + 0.2 * rng.normal(size=(FRAMES, *rest.shape))
    turned: Array = np.einsum("fij,fkj->fki", Rotation.random(FRAMES, random_state=seed).as_matrix(), posed)
    return turned + rng.normal(size=(FRAMES, 1, 3))


def placed_elsewhere(joints: Array) -> Array:
    """A shoulder a tenth of the way towards its elbow, as no constant offset has it."""
    shoulder, elbow = JOINTS.index("left_shoulder"), JOINTS.index("left_elbow")
    reference = joints.copy()
    reference[:, shoulder] += 0.1 * (joints[:, elbow] - joints[:, shoulder])
    return reference


def test_a_linear_map_finds_where_a_reference_has_its_joints() -> None:
    """On frames that it was not learned from; a constant offset finds less, and noise is not explained."""
    joints, others = moving(0), moving(0)[::-1]
    holds = np.ones(joints.shape[:2], dtype=bool)
    maps = learn([Placed("s1", joints[:300], placed_elsewhere(joints)[:300], holds[:300])])
    reference = placed_elsewhere(others)[:100]
    off = {
        name: np.linalg.norm(mapped(others[:100]) - reference, axis=-1).mean()
        for name, mapped in maps.items()
    }
    assert off["linear map"] < 0.2 * off["constant offsets"] < 0.2 * off["as tracked"]
    noise = 0.1 * np.random.default_rng(1).normal(size=reference.shape)
    noisy = np.linalg.norm(maps["linear map"](others[:100] + noise) - reference, axis=-1).mean()
    assert noisy > 0.1
