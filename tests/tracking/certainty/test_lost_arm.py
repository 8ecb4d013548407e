"""The paper's arm behind heavy noise, as a lone particle loses it: the limb is flagged, and no other."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from common.activation import activate
from common.body import BodyModel
from common.frame import DepthFrame, SubjectFrame
from common.kinematics import pose_vertices
from coordinator.synthesis.noise import add_noise
from coordinator.synthesis.rendering import DepthRenderer
from coordinator.synthesis.scenes import ARM_DOFS, arm
from coordinator.tracking.certainty.assessment import built_in, conclude
from coordinator.tracking.certainty.certainty import Certainty
from coordinator.tracking.certainty.evidence import Sighted, limbs_of, weigh_evidence
from coordinator.tracking.observation import isolate
from coordinator.tracking.sensor_noise import SensorNoise

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
    sighted = Sighted(subject, pose, 1.0 / 25.0, NOISE.lateral / NOISE.depth, lone=True)
    evidence = weigh_evidence(model, pose, pose[None], np.ones(1), sighted)
    return conclude(evidence, built_in().judge(evidence, lone=True))


def test_an_arm_that_is_lost_before_the_trunk_is_flagged() -> None:
    """All that speaks against it is what nothing explains; the true pose raises no flag."""
    model, true, _ = scene()
    wrist = model.joint_names.index("right_wrist")
    lost, found = certainty_of(LOST), certainty_of(true)
    assert lost.off_probability[wrist] > 0.07
    assert lost.deviation[wrist] > 3.0 * found.deviation[wrist]
    assert (found.off_probability < 0.07).all()


def test_what_nothing_moves_is_not_in_doubt() -> None:
    """Joints that are held take no blame for an arm that is lost, and belong to no limb; the arm is one."""
    model, _, _ = scene()
    limbs = limbs_of(model)
    arm_joints = [model.joint_names.index(f"right_{part}") for part in ("shoulder", "elbow", "wrist")]
    held = np.setdiff1d(np.arange(len(model.joint_names)), arm_joints)
    assert (certainty_of(LOST).off_probability[held] < 0.07).all()
    assert (limbs.of_joint[held] == -1).all()
    assert limbs.lever[arm_joints[2]] > limbs.lever[arm_joints[1]] > 0.2
    assert limbs.turns[arm_joints].all()
