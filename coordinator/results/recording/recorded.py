"""What has been recorded of a run: read from its log, and put together as a track."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from coordinator.bodies.angles import angles_of
from coordinator.pool.statistics import PoolStatistics
from coordinator.results.configuration.run_configuration import RunConfiguration
from coordinator.results.recording.log import Began, Entry, Opening, Resumed, read_records
from coordinator.results.track import Track
from coordinator.results.uncertainty import with_angles
from coordinator.scene.room.planes import Planes
from coordinator.scene.scene import Scene, SceneChange
from coordinator.tracking.certainty.certainty import Certainty, unknown_certainty
from coordinator.tracking.estimate import Estimate
from coordinator.tracking.starting.start import Start
from coordinator.tracking.state import TrackerState


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """One frame or more, and the run until the last of them."""

    configuration: RunConfiguration
    estimates: list[Estimate]
    state: TrackerState  # after the last frame
    statistics: PoolStatistics
    seconds: float
    resumes: int
    end: int  # bytes of the log; what follows is torn


def read_log(path: Path, frames: int | None = None) -> Recorded | None:
    """What a log holds, of `frames` at the most; None if that is no frame.

    Raises InputError if it is of another form.
    """
    configuration: RunConfiguration = {}
    start: Start | None = None
    estimates: list[Estimate] = []
    last: Entry | None = None
    scene = Scene()
    resumes = end = 0
    with path.open("rb") as file:
        for record, place in read_records(file):
            if len(estimates) == frames:
                break
            end = place
            match record:
                case Opening():
                    configuration = record.configuration
                case Began():
                    start = record.start
                case Resumed():
                    resumes += 1
                case Entry():
                    last = record
                    scene.recall(record.checkpoint.scene)
                    estimates.append(record.estimate)
    if start is None or last is None:
        return None
    state = TrackerState(start, replace(last.checkpoint, scene=scene.all()))
    return Recorded(configuration, estimates, state, last.statistics, last.seconds, resumes, end)


def up_of(configuration: RunConfiguration, state: TrackerState) -> NDArray[np.float64] | None:
    """Unit vector (3,) away from the ground, camera frame: as it was said, or from the floor; else None."""
    said = configuration.get("scene", {}).get("up")
    if said is not None:
        return np.array(said)
    return floor_up(state.checkpoint.scene)


def floor_up(scene: SceneChange) -> NDArray[np.float64] | None:
    """Up (3,) from the floor of the last frame; None where no floor is seen."""
    return Planes(scene.planes, scene.has_floor).up if scene.has_floor else None


def assemble(
    model: BodyModel,
    estimates: Sequence[Estimate],
    *,
    held: Mapping[str, float] | None = None,
    timed: bool = False,
    up: NDArray[np.float64] | None = None,
) -> Track:
    """The track of a run's estimates, in their order; with a deadline (`timed`) also who was in time.

    `held` are the values of degrees of freedom that do not move, by name; zero where there is none. `up` (3,)
    leads away from the ground, camera frame; None where that is not known.
    """
    dofs, joints = len(model.dof_names), len(model.joint_names)
    most = max((len(e.hypothesis_weight) for e in estimates), default=0)
    answered = np.array([e.particles_answered for e in estimates], dtype=np.int64)
    weight = np.full((len(estimates), most), np.nan)
    pose = np.full((len(estimates), most, dofs), np.nan)
    for f, estimate in enumerate(estimates):
        count = len(estimate.hypothesis_weight)
        weight[f, :count], pose[f, :count] = estimate.hypothesis_weight, estimate.hypothesis_pose
    certain = [certainty_of(model, estimate) for estimate in estimates]
    track = Track(
        frame=np.array([e.frame for e in estimates], dtype=np.int64),
        time_s=np.array([e.time_s for e in estimates], dtype=np.float64),
        dof_names=model.dof_names,
        pose=np.array([e.pose for e in estimates]).reshape(-1, dofs),
        joint_names=model.joint_names,
        joint_positions=np.array([e.joint_positions for e in estimates]).reshape(-1, joints, 3),
        joint_deviation=np.array([one.deviation for one in certain]).reshape(-1, joints),
        joint_off_probability=np.array([one.off_probability for one in certain]).reshape(-1, joints),
        joint_seen=np.array([one.seen for one in certain]).reshape(-1, joints),
        hypothesis_pose=pose,
        hypothesis_weight=weight,
        status=np.array([e.status for e in estimates], dtype="<U9"),
        particles_answered=answered if timed else None,
        up=up,
    )
    return with_angles(track, angles_of(model, held, up))


def certainty_of(model: BodyModel, estimate: Estimate) -> Certainty:
    """How sure each joint (J,) of an estimate is; NaN where nobody knows."""
    return estimate.certainty or unknown_certainty(len(model.joint_names))
