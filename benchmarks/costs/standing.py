"""A person in front of a depth camera and a pose nearby to refine, for the cost of a particle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gepf.common.activation import activate
from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.camera import Intrinsics
from gepf.common.frame import Frame, SubjectFrame, View
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.common.settings import RefineSettings
from gepf.coordinator.bodies.human.template import DEFAULT_ACTIVE, human
from gepf.coordinator.scene.noise import NO_NOISE, SensorNoise
from gepf.coordinator.synthesis.noise import add_noise
from gepf.coordinator.synthesis.rendering import DepthRenderer
from gepf.coordinator.tracking.observation import isolate
from gepf.worker.kernel.observation import Observation, observe, pack_views
from gepf.worker.kernel.surface import pack_model
from gepf.worker.kernel.visibility import pose_body, visible_vertices
from gepf.worker.kernel.workspace import make_workspaces

CAMERA = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
UNITS_PER_METRE = 1000.0
POSE = {
    "root_tz": 2.5,
    "root_ry": 0.3,
    "l_shoulder_flexion": 0.5,
    "l_elbow_flexion": 0.7,
    "r_shoulder_abduct": 0.6,
    "r_elbow_flexion": 1.0,
    "l_hip_flexion": 0.3,
    "l_knee_flexion": 0.4,
}
OFF_ROTATION, OFF_TRANSLATION = np.radians(4.0), 0.03  # standard deviations of the start


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A particle, the observation, and the true pose."""

    model: BodyModel
    subject: SubjectFrame
    observation: Observation
    truth: Array  # (1, D)
    start: Array  # (1, D)

    @property
    def observed(self) -> Array:
        """Observed points (P, 3) without padding."""
        (view,) = self.observation.views
        return view.points[: view.count].astype(np.float64)

    def visible(self) -> Array:
        """Model points (Q, 3) that are visible in the start pose."""
        skeleton, surface = pack_model(self.model)
        views = pack_views(self.observation, RefineSettings())
        workspace = make_workspaces(skeleton, surface, views).shared
        pose_body(self.start[0], skeleton, surface, workspace)
        return workspace.posed[visible_vertices(surface, workspace)]

    def joint_error(self, poses: Array) -> float:
        """Mean distance of the joints of poses (1, D) from the true ones, metres."""
        apart = joint_positions(self.model, poses) - joint_positions(self.model, self.truth)
        return float(np.linalg.norm(apart, axis=-1).mean())


def standing(points: int, noise: SensorNoise | None = None, seed: int = 0) -> Case:
    """A person at 2.5 m, observed with this noise and this number of points."""
    rng, template = np.random.default_rng(seed), human()
    held = np.array([POSE.get(name, 0.0) for name in template.dof_names])
    model = activate(template, DEFAULT_ACTIVE, held)
    truth = np.array([[POSE.get(name, 0.0) for name in model.dof_names]])
    start = truth + rng.standard_normal(truth.shape) * np.where(
        model.kinds == 0, OFF_TRANSLATION, OFF_ROTATION
    )
    with DepthRenderer(CAMERA) as renderer:
        depth = renderer.depth(pose_vertices(model, truth)[0], model.triangles)
    noisy = add_noise(depth.astype(np.float64), CAMERA, noise or NO_NOISE, rng)
    units = np.rint(noisy * UNITS_PER_METRE).astype(np.uint16)
    subject = isolate(Frame.of(View(0, 0.0, units, UNITS_PER_METRE, CAMERA)), points)
    if subject is None or len(subject.largest.picked) != points:
        raise RuntimeError(f"the camera sees fewer than {points} points of the person")
    return Case(model, subject, observe(subject), truth, start)
