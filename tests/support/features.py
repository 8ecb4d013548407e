"""What the certainty of joints is judged by, for poses that are not refined."""

from __future__ import annotations

import msgspec
import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.frame import SubjectFrame
from gepf.common.kinematics import joint_positions
from gepf.common.refinement import Particles
from gepf.common.settings import RefineSettings
from gepf.coordinator.filters.priors import pose_prior
from gepf.coordinator.settings import preset
from gepf.coordinator.tracking.certainty import Features, FrameContext, measure_features, seen_shares
from gepf.coordinator.tracking.judgement import gate_pose
from gepf.refiners import DirectRefiner


def features_in(
    model: BodyModel, poses: Array, subject: SubjectFrame, settings: RefineSettings, stretch: float = 1.0
) -> Features:
    """Features (J,) of the first of hypotheses (N, D) that are equally likely, held for a while."""
    still, pose = msgspec.structs.replace(settings, icp_iterations=0), poses[0]
    particles = Particles(poses[:1], still, prior=pose_prior(model, still))
    found = DirectRefiner().submit(subject, model, particles).result()
    residual = gate_pose(
        found.log_likelihood[0], found.residual[0], still, preset("default").gating
    ).normalised_residual
    context = FrameContext(subject, pose, pose, 1.0 / 30.0, stretch)
    joints = joint_positions(model, poses[[0, *range(len(poses))]])
    limits = preset("default").certainty
    seen_by = seen_shares(model, pose, subject, stretch, limits)
    return measure_features(model, pose, joints, np.ones(len(poses)), context, residual, seen_by, limits)
