"""The paper's arm behind heavy noise, as a lone particle loses it: the limb is flagged, and no other."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from common.activation import activate
from common.body import BodyModel
from common.frame import DepthFrame, SubjectFrame
from common.kinematics import joint_positions, pose_vertices
from common.settings import preset
from coordinator.synthesis.noise import add_noise
from coordinator.synthesis.rendering import DepthRenderer
from coordinator.synthesis.scenes import ARM_DOFS, arm
from coordinator.tracking.certainty.certainty import FIT, FLAGGED, Certainty
from coordinator.tracking.certainty.features import FrameContext, measure_features
from coordinator.tracking.certainty.surface import seen_shares
from coordinator.tracking.observation import isolate
from coordinator.tracking.sensor_noise import SensorNoise, assume_noise
from tests.support.residuals import residual_of

Array = NDArray[np.float64]

NOISE = SensorNoise(depth=0.15, lateral=0.01)
FRAME = 30
LOST = np.array([0.459, -0.61, 0.801, 2.46])  # where `--method gradient` has the arm then, before the trunk
SCALE = 10_000.0


@cache
def scene() -> tuple[BodyModel, Array, SubjectFrame]:
    """The arm's model, its true pose (4,) in a frame, and the noisy frame."""
    shot = arm()
    with DepthRenderer(shot.camera) as renderer:
        depth = renderer.depth(
            pose_vertices(shot.model, shot.poses[FRAME : FRAME + 1])[0], shot.model.triangles
        )
    noisy = add_noise(depth.astype(np.float64), shot.camera, NOISE, np.random.default_rng(0))
    units = np.clip(np.rint(SCALE * noisy), 0, 65_535).astype(np.uint16)
    subject = isolate(DepthFrame(0, 0.0, units, SCALE, shot.camera), 10_000)
    assert subject is not None
    model = activate(shot.model, ARM_DOFS, shot.poses[FRAME])
    return model, shot.poses[FRAME][[shot.model.dof(name) for name in ARM_DOFS]], subject


def certainty_of(pose: Array) -> Certainty:
    """How sure the joints are of a lone particle's pose (4,)."""
    model, _, subject = scene()
    settings = assume_noise(preset("default").refine, NOISE)
    residual = residual_of(model, pose, subject, settings)
    context = FrameContext(subject, pose, 1.0 / 25.0, NOISE.lateral / NOISE.depth)
    joints = joint_positions(model, np.stack([pose, pose]))
    seen_by = seen_shares(model, pose, subject, context.stretch)
    return FIT.judge(measure_features(model, pose, joints, np.ones(1), context, residual, seen_by))


def test_an_arm_that_is_lost_before_the_trunk_is_flagged() -> None:
    """The lost arm is flagged; neither the true pose nor fixed joints are."""
    model, true, _ = scene()
    moved = [model.joint_names.index(f"right_{part}") for part in ("shoulder", "elbow", "wrist")]
    held = np.setdiff1d(np.arange(len(model.joint_names)), moved)
    lost, found = certainty_of(LOST), certainty_of(true)
    assert lost.off_probability[moved[-1]] > FLAGGED
    assert lost.deviation[moved[-1]] > 2.0 * found.deviation[moved[-1]]
    assert (found.off_probability < FLAGGED).all()
    assert (lost.off_probability[held] < FLAGGED).all()
