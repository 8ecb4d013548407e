"""The solution of the normal equations."""

from __future__ import annotations

import numpy as np

from worker.kernel.gauss_newton import solve_ltl


def test_what_nothing_determines_stays() -> None:
    """Without damping: steps of a singular system are finite, solve it, and leave the undetermined alone."""
    jacobian = np.random.default_rng(0).normal(size=(3, 5)) * [1.0, 1.0, 0.0, 1.0, 1.0]
    gram, target = jacobian.T @ jacobian, jacobian.T @ np.array([0.3, -0.2, 0.1])
    step = target.copy()
    solve_ltl(np.arange(-1, 4), gram.copy(), step)
    assert step[2] == 0.0
    assert np.abs(step).max() < 100.0
    np.testing.assert_allclose(gram @ step, target, atol=1e-9)
