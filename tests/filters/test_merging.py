"""Merging by the covariance of each refined pose."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from gepf.common.body import ROTATION
from gepf.common.kinematics import difference, retract
from gepf.common.refinement import Refined, lower_triangular
from gepf.coordinator.filters.gradient_enhanced import (
    begin,
    estimate_covariances,
    merge_by_covariance,
    propose,
)
from gepf.coordinator.settings import preset
from tests.support.bodies import hinges, puppet
from tests.support.filtering import NOTHING_SEEN, Merging, update_once, update_twice

Triangles = NDArray[np.float32]

seeds = st.integers(0, 2**32 - 1)
DEFAULT = preset("default").filter


def random_roots(rng: np.random.Generator, count: int, dofs: int) -> Triangles:
    """Factors of covariances, of all sizes and correlated."""
    lower = 0.02 * rng.normal(size=(count, dofs, dofs))
    lower[:, range(dofs), range(dofs)] = 10.0 ** rng.uniform(-2.0, -0.5, (count, dofs))
    packed: Triangles = lower[:, np.tri(dofs, dtype=bool)].astype(np.float32)
    return packed


@given(seeds, st.integers(1, 20))
def test_groups_are_those_of_the_mahalanobis_distance(seed: int, count: int) -> None:
    """Each particle joins the likeliest representative that is near, by the representative's matrix."""
    rng, model = np.random.default_rng(seed), puppet()
    poses = retract(model, np.tile(rng.normal(size=19), (count, 1)), 0.1 * rng.normal(size=(count, 19)))
    likelihood, roots = rng.normal(size=count), random_roots(rng, count, 19)
    chosen, group = merge_by_covariance(
        model, poses, likelihood, lower_triangular(roots, poses.shape[1]), 2.0 / 3.0
    )
    lower = lower_triangular(roots, 19)
    expected: list[int] = []
    for n in np.argsort(-likelihood):
        steps = difference(model, poses[expected], np.tile(poses[n], (len(expected), 1)))
        away = [np.linalg.norm(np.linalg.solve(lower[m], s)) for m, s in zip(expected, steps, strict=True)]
        near = np.flatnonzero(np.array(away) ** 2 < 2.0 / 3.0 * 19)
        assert group[n] == (near[0] if len(near) else len(expected))
        if not len(near):
            expected.append(int(n))
    assert chosen.tolist() == expected


@pytest.mark.parametrize(
    ("name", "particles", "refine", "asks"),
    [
        ("default", 20, {}, True),
        ("default", 1, {}, False),
        ("paper", 20, {}, False),
        ("default", 20, {"icp_iterations": 0}, False),  # it would say nothing of the frame
        ("default", 20, {"noise_depth": 0.15}, False),  # soft
    ],
)
def test_who_merges_by_covariance_asks_for_it(
    name: str, particles: int, refine: dict[str, float], asks: bool
) -> None:
    """Preset `default` with several refined particles, unless the noise in depth is by far the largest."""
    settings = msgspec.structs.replace(preset(name).filter, particles=particles)
    past = begin(hinges(), np.zeros(2), settings)
    proposal = propose(hinges(), past, NOTHING_SEEN, settings, np.random.default_rng(0))
    assert proposal.asks_covariance(msgspec.structs.replace(preset(name).refine, **refine)) is asks


@pytest.mark.parametrize("merging", [update_once, update_twice])
def test_an_update_merges_by_it(merging: Merging) -> None:
    """Into one mode, whose covariance is that of Eq. 7."""
    model, rng = puppet(), np.random.default_rng(0)
    past = begin(model, np.zeros(19), DEFAULT)
    past = replace(past, covariances=1e-4 * np.eye(19)[None])
    proposal = propose(model, past, NOTHING_SEEN, DEFAULT, rng)
    wide = np.where(model.kinds == ROTATION, 0.5, 0.05).astype(np.float32)
    roots = np.tile(np.diag(wide)[np.tri(19, dtype=bool)], (20, 1))
    after = Refined(1e-3 * proposal.poses, -np.arange(20.0), np.full(20, 0.01), roots)
    found = merging(model, proposal, after, DEFAULT, rng)
    assert len(found.poses) == 1
    group = np.zeros(20, dtype=np.int64)
    by_particles = estimate_covariances(model, proposal.poses, found.poses, group, past.covariances, 0.1)
    np.testing.assert_allclose(found.covariances, by_particles, atol=1e-9)
