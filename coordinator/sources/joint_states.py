"""Joint values over time from a robot's controller: a CSV, or sensor_msgs/JointState of a ROS bag.

A CSV has a column `time_s`, seconds on the clock of the recording, and one column per joint: radians, metres,
or degrees if the name ends in `_deg`. Times of a bag are relative to its first depth image, or, without
depth, to its first joint state.
"""

from __future__ import annotations

import csv
import hashlib
import logging
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import unknown_dof
from gepf.common.errors import InputError
from gepf.coordinator.sources.bag import Bag, is_bag
from gepf.coordinator.sources.clock import SECOND_NS
from gepf.coordinator.sources.ros_bag import depth_topic

logger = logging.getLogger(__name__)

TIME, DEGREES = "time_s", "_deg"
STATES = "sensor_msgs/msg/JointState"


@dataclass(frozen=True, slots=True, eq=False)
class JointStates:
    """Values (T, K) of joints at ascending times (T,), radians and metres."""

    names: tuple[str, ...]
    times_s: Array
    values: Array

    @property
    def hash(self) -> str:
        """A hash of the states."""
        content = "\n".join(self.names).encode() + self.times_s.tobytes() + self.values.tobytes()
        return hashlib.sha256(content).hexdigest()[:12]

    def check_names(self, known: Collection[str]) -> None:
        """InputError if no joint is a degree of freedom of the body; a warning for joints that are not."""
        foreign = [unknown_dof(name, known) for name in self.names if name not in known]
        if len(foreign) == len(self.names):
            raise InputError(f"--joint-states: {foreign[0]}")
        for each in foreign:
            logger.warning("--joint-states: %s; its states are left out", each)

    def at(self, time_s: float) -> Array:
        """Interpolated values (K,) at a time; NaN before the first and after the last."""
        return np.array([np.interp(time_s, self.times_s, each, np.nan, np.nan) for each in self.values.T])


def read_joint_states(path: Path) -> JointStates:
    """Read a file; InputError if it cannot be read or is invalid."""
    names, times, values = read_bag(path) if is_bag(path) else read_csv(path)
    order = np.argsort(times, kind="stable")
    finite = np.isfinite(times).all() and np.isfinite(values).all()
    if len(times) < 2 or not names or not finite or not (np.diff(times[order]) > 0).all():
        raise InputError(
            f"{path} has {len(times)} states of {len(names)} joints; give at least two states of one joint, "
            "with finite numbers and different times"
        )
    return JointStates(names, times[order], values[order])


def read_csv(path: Path) -> tuple[tuple[str, ...], Array, Array]:
    """Read names, times and values of a CSV."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            heads, *rows = [row for row in csv.reader(file) if row]
        table = np.array([[float(cell) for cell in row] for row in rows]).reshape(len(rows), len(heads))
    except (OSError, ValueError) as error:
        raise InputError(
            f"cannot read {path}: {error}; give a ROS bag, or a CSV with {TIME} and joints"
        ) from error
    heads = [head.strip() for head in heads]
    if TIME not in heads:
        raise InputError(f"{path} has no column {TIME}, but {', '.join(heads)}; rename the column of times")
    joints = [k for k, head in enumerate(heads) if head != TIME]
    units = np.array([np.radians(1.0) if heads[k].endswith(DEGREES) else 1.0 for k in joints])
    names = tuple(heads[k].removesuffix(DEGREES) for k in joints)
    return names, table[:, heads.index(TIME)], table[:, joints] * units


def read_bag(path: Path) -> tuple[tuple[str, ...], Array, Array]:
    """Read names, times and values of the first topic of joint states."""
    bag = Bag(path)
    topics = bag.topics(STATES)
    if not topics:
        raise InputError(f"{path} holds no joint states ({STATES}); record the topic joint_states, too")
    states = bag.clock(topics[0])
    messages = [bag.message(topics[0], place) for place in states.places.tolist()]
    names = tuple(messages[0].name)
    if any(tuple(message.name) != names for message in messages):
        raise InputError(f"{path}: messages of {topics[0]} name different joints; write them to a CSV")
    try:
        images = bag.clock(depth_topic(bag))
    except InputError:  # no depth
        images = states
    stamped = states.kind == images.kind == "stamps"
    began, times_ns = (
        (images.times_ns[0], states.times_ns) if stamped else (images.records_ns[0], states.records_ns)
    )
    times = (times_ns - began) / SECOND_NS
    return names, times, np.array([np.asarray(message.position, dtype=np.float64) for message in messages])
