"""The benchmark of colour compares each person with the body that follows them."""

from __future__ import annotations

import numpy as np

from benchmarks.colour import bodies_in_order


def test_each_person_is_compared_with_the_body_that_follows_them() -> None:
    """Two people a metre apart, whose bodies have the other order; one body is unknown at first."""
    truth = np.zeros((4, 2, 3, 3))
    truth[:, 1, :, 0] = 1.0
    joints, known = truth[:, ::-1] + 0.02, np.ones((4, 2), dtype=np.bool_)
    known[0, 1], joints[0, 1] = False, np.nan
    assert bodies_in_order(joints, known, truth).tolist() == [1, 0]
    assert bodies_in_order(truth, known, truth).tolist() == [0, 1]
