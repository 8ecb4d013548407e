"""Runs of one person that are recorded without tracking: estimates, states, and the folder of a run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from gepf.coordinator.bodies.human.shape_space import Size
from gepf.coordinator.filters.belief import Belief
from gepf.coordinator.pool.options import PoolStatistics
from gepf.coordinator.results.log import Recorded
from gepf.coordinator.results.recorder import Recorder
from gepf.coordinator.scene.scene import SceneChange
from gepf.coordinator.tracking.certainty import unknown_certainty
from gepf.coordinator.tracking.estimate import Certainty, Estimate, Status
from gepf.coordinator.tracking.reporting import TrackedFrame, TrackedPerson
from gepf.coordinator.tracking.state import Checkpoint, FrameState, PersonState, Start
from gepf.coordinator.tracking.track_state import NextSegmentation, Tracked
from gepf.worker.warm_up import tiny_model

MODEL = replace(
    tiny_model(),
    joint_names=("pelvis", "right_wrist"),
    joint_links=np.zeros(2, dtype=np.int64),
    joint_points=np.zeros((2, 3)),
)
DOFS, JOINTS = MODEL.dof_names, MODEL.joint_names
START = Start(MODEL, np.arange(len(DOFS)) / 7.0, Size(1.7, 1.0))
SETTINGS = {"seed": 3, "method": "gepf", "preset": "default", "filter": {"particles": 2}}
CONFIGURATION = {
    "sequence": "wall",
    "model": {"name": "wall", "content": "0f1e2d3c4b5a"},
    "settings": SETTINGS,
}


def estimate(number: int, hypotheses: int = 2, status: Status = "tracked") -> Estimate:
    """An estimate whose values differ from those of every other."""
    rng = np.random.default_rng(number)
    poses = rng.normal(size=(hypotheses, len(DOFS)))
    unknown = unknown_certainty(len(JOINTS))
    return Estimate(
        frame=number,
        time_s=number / 30,
        status=status,
        pose=poses[0],
        joint_positions=rng.normal(size=(len(JOINTS), 3)),
        hypothesis_pose=poses,
        hypothesis_weight=np.full(hypotheses, 1 / hypotheses),
        residual=float("nan") if status == "lost" else 0.01,
        certainty=unknown if status == "lost" else Certainty(*rng.random((3, len(JOINTS)))),
        stage_seconds={"refine": rng.random()},
    )


ESTIMATES = [estimate(4, 1), estimate(5, 3, "ambiguous"), estimate(6, 2, "lost")]


def state(number: int) -> PersonState:
    """A person's state after a frame; its arrays hold values that are hard to encode."""
    poses = np.array([[0.1, np.nan, -np.inf, 5e-324]])
    belief = replace(Belief.at(poses[0]), poses=poses, reported=np.array([number / 3.0]))
    track = Tracked(belief=belief, next_segmentation=NextSegmentation(np.array([0.5])), time_s=number / 3.0)
    return PersonState(START, Checkpoint(track, f'{{"state": {2**127 + number}}}'))


def frame_state(number: int) -> FrameState:
    """What is known beside the people after a frame."""
    return FrameState({"front": SceneChange(frames_with_depth=number)})


def append(recorder: Recorder, *estimates: Estimate) -> None:
    """Record frames of one person."""
    for each in estimates:
        people = [TrackedPerson(each, state(each.frame))]
        tracked = TrackedFrame(people, frame_state(each.frame))
        recorder.append(tracked, PoolStatistics(("a",), {"batches_sent": 2}), each.frame / 10)


def record(
    folder: Path, estimates: list[Estimate], *, complete: bool = True, resume: bool = False
) -> Recorded | None:
    """Record a whole run, or the rest of one; returns what was recorded before."""
    with Recorder(folder, CONFIGURATION, resume=resume) as recorder:
        append(recorder, *estimates)
        recorder.finish({"complete": complete}, 0.0)
    return recorder.past


def names(folder: Path) -> list[str]:
    """Names of the files in a folder."""
    return sorted(path.name for path in folder.iterdir())
