"""One run: a scene with noise, tracked in this process, and its errors frame by frame."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from numpy.typing import NDArray

from benchmarks.paper.footage import Footage
from benchmarks.paper.matrix import Row
from common.body import ROOT_DOFS, BodyModel
from common.kinematics import joint_positions
from coordinator.bodies.choice import choose_bodies
from coordinator.bodies.human.shape_space import person_of_size
from coordinator.bodies.tracked import Bodies
from coordinator.results.evaluation import angle_error_deg, best_hypothesis, positions
from coordinator.tracking.estimate import Estimate
from coordinator.tracking.known import Known
from coordinator.tracking.single import SingleTracker as Tracker
from gepf.direct import DirectRefiner

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Job:
    """A row of the table with one seed, which is that of the noise and of the tracker."""

    row: Row
    seed: int


class Run(msgspec.Struct, frozen=True):
    """What came of a job: F frames, A angles, J joints."""

    row: str
    seed: int
    angles: tuple[str, ...]
    joints: tuple[str, ...]
    reported_deg: list[list[float]]  # (F, A) of the reported pose
    best_deg: list[list[float]]  # (F, A) of the hypothesis whose mean is least
    joint_cm: list[list[float]]  # (F, J) of the reported pose
    hypotheses: list[int]  # (F,)
    ms: list[float]  # (F,) of processor time; making the frame does not count


def run(job: Job, footage: Footage) -> Run:
    """Track a row's frames, starting where the scene says."""
    row = job.row
    settings = row.settings(job.seed)
    bodies = choose_bodies(row.active, settings.preset)
    if not row.limits:
        bodies = Bodies(limitless, bodies.start_dofs, bodies.active)
    tracker = Tracker(DirectRefiner(), settings, bodies, Known(footage.start))
    estimates, ms = [], []
    for frame in footage.frames(row.noise, job.seed, row.frames):
        began = time.process_time()
        estimates.append(tracker.track(frame))
        ms.append(1e3 * (time.process_time() - began))
    return score(job, tracker.model, estimates, footage, ms)


def limitless(stature: float, girth: float) -> BodyModel:
    """A person whose joints turn as far as they like."""
    model = person_of_size(stature, girth)
    return replace(model, limits=np.tile([-np.inf, np.inf], (len(model.limits), 1)))


def score(job: Job, model: BodyModel, estimates: list[Estimate], footage: Footage, ms: list[float]) -> Run:
    """Hold the estimates against the scene's own poses."""
    full, poses = footage.scene.model, footage.scene.poses[: len(estimates)]
    angles = tuple(name for name in model.dof_names if name not in ROOT_DOFS[:3])
    mine, theirs = positions(model.dof_names, angles), positions(full.dof_names, angles)
    reported = np.array([e.pose for e in estimates])[:, mine]
    joints = np.array([e.joint_positions for e in estimates])
    apart = np.linalg.norm(joints - joint_positions(full, poses), axis=-1)
    best = [
        best_hypothesis(e.hypothesis_pose[None][..., mine], truth[None])[0]
        for e, truth in zip(estimates, poses[:, theirs], strict=True)
    ]
    return Run(
        row=job.row.name,
        seed=job.seed,
        angles=angles,
        joints=full.joint_names,
        reported_deg=rounded(angle_error_deg(reported, poses[:, theirs])),
        best_deg=rounded(np.array(best)),
        joint_cm=rounded(100.0 * apart),
        hypotheses=[len(e.hypothesis_weight) for e in estimates],
        ms=[round(spent, 2) for spent in ms],
    )


def rounded(errors: Array) -> list[list[float]]:
    """Errors to four decimals."""
    found: list[list[float]] = np.round(errors, 4).tolist()
    return found
