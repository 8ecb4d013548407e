"""Layout, posing and visibility of the kernel against the plain path, stage by stage."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from common.body import ROOT_DOFS, BodyModel
from tests.support.bodies import person, puppet
from tests.support.kernel import plain_path
from tests.support.kernel.kernel_cases import (
    DEFAULT,
    layout,
    posed_in,
    starts,
)
from worker.kernel.surface import pack_model


def test_a_body_is_packed_whole() -> None:
    """The kernel's order keeps every vertex with its skin and every triangle with its corners."""
    model = person()
    skeleton, surface = pack_model(model)
    order = layout(model)
    drawn, expected = (body.vertices[body.triangles].reshape(-1, 9) for body in (surface, model))
    np.testing.assert_array_equal(np.unique(drawn, axis=0), np.unique(expected, axis=0))
    assert len(drawn) == len(expected)
    np.testing.assert_array_equal(surface.vertices, model.vertices[order])
    used = surface.skin_links.shape[1]  # of four: no vertex has more
    np.testing.assert_array_equal(surface.skin_links, model.skin_links[order, :used])
    np.testing.assert_array_equal(surface.skin_weights, model.skin_weights[order, :used])
    assert np.all(model.skin_weights[:, used:] == 0.0)
    assert tuple(np.array(model.dof_names)[skeleton.precisions == 0.0]) == ROOT_DOFS


@pytest.mark.parametrize("make", [puppet, person])
def test_posing_and_visibility_match(make: Callable[[], BodyModel]) -> None:
    """Steps 4a and 4b: vertices to 1e-12 m, and the very same ones visible."""
    model = make()
    poses = starts(3) if make is puppet else np.tile([0.1, 0.0, 2.5, *[0.3, -0.4] * 10, 0.2], (1, 1))
    for pose in poses:
        _, posed, seen = posed_in(model, pose, DEFAULT)
        expected, visible = plain_path.visible_vertices(model, pose)
        np.testing.assert_allclose(posed, expected[layout(model)], atol=1e-12)
        assert 100 < len(visible) < 0.6 * len(expected)
        np.testing.assert_array_equal(np.sort(layout(model)[seen]), visible)
