"""The prior of refinement: joints at rest, and a shape that becomes certain with the frames."""

from __future__ import annotations

import numpy as np

from gepf.coordinator.filters.priors import (
    frame_share,
    log_rest_prior,
    population_precision,
    pose_prior,
    updated_precision,
)
from gepf.coordinator.settings import ShapeSettings, preset
from tests.support.bodies import flexible_puppet, puppet

SETTINGS = preset("default").refine
INTERVAL = 0.05


def test_the_precision_grows_by_a_share_of_the_information_of_a_frame() -> None:
    """Refinement gives the inverse of prior and information; the same share of any information is added."""
    rng = np.random.default_rng(0)
    before = population_precision(flexible_puppet())
    share, gains = frame_share(INTERVAL, 1.0), []
    for scale in (1.0, 10.0):
        root = rng.normal(size=(3, 3))
        information = scale * root @ root.T
        covariance = np.asarray(np.linalg.inv(before / share + information), dtype=np.float64)
        after = updated_precision(before, covariance, INTERVAL, ShapeSettings())
        np.testing.assert_array_equal(after, after.T)  # or workers refuse it
        gain = after - before
        gains.append(gain / information)
    np.testing.assert_allclose(gains, np.full((2, 3, 3), gains[0][0, 0]), rtol=1e-6)
    assert 0.0 < gains[0][0, 0] <= share


def test_a_frame_without_information_leaves_the_precision() -> None:
    """Of a person who is not seen, nothing is learned."""
    before = population_precision(flexible_puppet())
    covariance = np.asarray(np.linalg.inv(before / frame_share(INTERVAL, 1.0)), dtype=np.float64)
    np.testing.assert_allclose(updated_precision(before, covariance, INTERVAL, ShapeSettings()), before)


def test_many_short_frames_count_as_few_long_ones() -> None:
    """The information of a second does not depend on the frame rate, and a long gap counts as one frame."""
    assert 20 * frame_share(0.01, 1.0) == frame_share(0.2, 1.0)
    assert frame_share(100.0, 1.0) == 1.0


def test_the_prior_of_a_body_holds_its_shape_and_rests_its_joints() -> None:
    """Shapes of particles are the means, and the base is free; a rigid shape needs only the diagonal."""
    model, shapes = flexible_puppet(), np.arange(6.0).reshape(2, 3)
    padded = np.pad(shapes, ((0, 0), (0, len(model.dof_names) - 3)))
    prior = pose_prior(model, SETTINGS, padded)
    assert prior is not None
    np.testing.assert_array_equal(prior.mean, padded)
    np.testing.assert_array_equal(prior.precision[:3, :3], population_precision(model))
    assert not prior.precision[3:9].any()
    assert np.all(np.diag(prior.precision)[9:] > 0.0)
    alone = pose_prior(puppet(), SETTINGS)
    assert alone is not None
    np.testing.assert_array_equal(alone.precision, np.diag(prior.precision)[3:])


def test_far_from_rest_the_pull_stays_the_same_but_counts_between_poses() -> None:
    """Near rest it is the Gaussian. Far from it, refinement and remainder together weigh as the Gaussian."""
    model, reach = puppet(), SETTINGS.max_rest_pull
    joints = np.arange(len(model.dof_names)) >= 6
    deviations = SETTINGS.pose_deviation * model.rest_spreads[joints]
    for distance in (0.4 * reach, 3.0 * reach):
        pose = np.zeros(len(model.dof_names))
        pose[joints] = distance * deviations
        prior = pose_prior(model, SETTINGS, pose)
        assert prior is not None
        pull = (prior.precision * (pose - prior.mean))[joints] * deviations
        np.testing.assert_allclose(pull, min(distance, reach))
        in_refinement = -0.5 * np.sum(prior.precision * (pose - prior.mean) ** 2)
        beyond = log_rest_prior(model, SETTINGS, pose[None])[0]
        np.testing.assert_allclose(in_refinement + beyond, -0.5 * joints.sum() * distance**2)
