"""The result of each frame as a message, during the run; docs/live.md describes it.

Each message contains all names and values, so a receiver needs no earlier message.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Protocol

import msgspec
import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import BodyModel, at_zero_shape
from gepf.common.errors import ProtocolError
from gepf.common.protocol.keys import RUN, of_run
from gepf.common.protocol.wire import LIVE
from gepf.common.transport.channels import Publisher
from gepf.coordinator.bodies.angles import Angles
from gepf.coordinator.bodies.families import angles_of
from gepf.coordinator.results.log import assemble
from gepf.coordinator.results.track import Track
from gepf.coordinator.tracking.estimate import Estimate, Status

KIND, END = "estimate", "estimates-end"
NO_SHAPE = np.empty(0)

BodyKey = Annotated[str, msgspec.Meta(pattern=rf"^gepf/run/{RUN.pattern}/model/[0-9a-f]{{64}}\Z")]
Values = dict[str, float | None]  # by name; None if unknown


class HypothesesMessage(msgspec.Struct, frozen=True):
    """All hypotheses (M), the most likely first."""

    weight: list[float]
    pose: list[list[float]]  # (M, D), values in the order of the reported pose


class ResultMessage(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", tag=KIND):
    """The result of one frame."""

    version: int = LIVE
    frame: int
    time_s: float
    estimated_at: float  # seconds since 1970
    status: Status
    residual: float | None
    pose: Values
    angles: Values
    angle_deviation: Values
    joints: dict[str, tuple[float, float, float] | None]
    why: str
    joint_deviation: Values
    joint_off_probability: Values
    joint_seen: Values
    hypotheses: HypothesesMessage
    body: BodyKey | None = None  # at which the tracked body can be fetched
    shape: list[float] = []  # the values of its shape coefficients


class EndMessage(msgspec.Struct, frozen=True, tag_field="kind", tag=END):
    """There are no more results."""

    version: int = LIVE


class Outlet(Protocol):
    """Publishes results in some form."""

    @property
    def has_subscriber(self) -> bool:
        """Whether anyone receives the results."""
        ...

    def put(self, message: ResultMessage, model: BodyModel) -> None:
        """Publish a result of this body, whose shape coefficients are in the message."""
        ...

    def end(self) -> None:
        """Publish that there are no more results."""
        ...


class PackedOutlet:
    """Publishes results as MessagePack or JSON."""

    def __init__(self, publisher: Publisher, *, as_json: bool = False) -> None:
        self._publisher = publisher
        self._encode = msgspec.json.encode if as_json else msgspec.msgpack.encode

    @property
    def has_subscriber(self) -> bool:
        """Whether anyone receives the results."""
        return self._publisher.has_subscriber

    def put(self, message: ResultMessage, model: BodyModel) -> None:
        """Publish a result, which names the key of its body."""
        del model
        self._publisher.put(self._encode(message))

    def end(self) -> None:
        """Publish that there are no more results."""
        self._publisher.put_blocking(self._encode(EndMessage()))


def results_key(key: str) -> str:
    """The key for results of live input on a key, unless the user gives another one."""
    return f"{key}/results"


class LiveResults:
    """Publishes estimates; angles do not jump by full turns between frames.

    Nothing is published while nobody receives it. The bodies can be fetched from the run named `run`.
    """

    def __init__(self, outlet: Outlet, run: str | None = None) -> None:
        self._outlet, self._run = outlet, run
        self.end = outlet.end
        self._last: Array | None = None

    def put(
        self, estimate: Estimate, model: BodyModel, held: Mapping[str, float], shape: Array = NO_SHAPE
    ) -> None:
        """Publish the estimate of a frame, of a body with these values (S,) of its shape coefficients."""
        if not self._outlet.has_subscriber:
            return
        estimated_at = time.time()
        named = at_zero_shape(model)
        angles = angles_of(named, held)
        track = assemble(named, [estimate], held=held)
        message = ResultMessage(
            frame=estimate.frame,
            time_s=estimate.time_s,
            estimated_at=estimated_at,
            status=estimate.status,
            residual=estimate.residual if np.isfinite(estimate.residual) else None,
            pose=by_name(named.dof_names, estimate.pose),
            angles=by_name(angles.names, self._follow(angles, track)),
            angle_deviation=by_name(angles.names, track.angle_deviation[0]),
            joints=by_name(model.joint_names, estimate.joint_positions),
            why=estimate.why,
            joint_deviation=by_name(model.joint_names, track.joint_deviation[0]),
            joint_off_probability=by_name(model.joint_names, track.joint_off_probability[0]),
            joint_seen=by_name(model.joint_names, track.joint_seen[0]),
            hypotheses=HypothesesMessage(
                estimate.hypothesis_weight.tolist(), estimate.hypothesis_pose.tolist()
            ),
            body=None if self._run is None else of_run(self._run, f"model/{model.hash}"),
            shape=shape.tolist(),
        )
        self._outlet.put(message, model)

    def _follow(self, angles: Angles, track: Track) -> Array:
        """The angles (A,) of the frame, shifted by full turns towards the last known angles; NaN before."""
        if not track.placed[0]:
            return np.full(len(angles.names), np.nan)
        near: Array = track.angle[0]
        if self._last is not None:
            near = angles.near(track.angle, self._last)[0]
        if not track.unknown[0]:
            self._last = near
        return near


def by_name(names: tuple[str, ...], values: Array) -> dict[str, Any]:
    """Values (N,) or points (N, 3) by name; None if unknown."""
    known = np.isfinite(values if values.ndim == 1 else values.sum(axis=1))
    listed = zip(names, values.tolist(), known, strict=True)
    return {name: value if is_known else None for name, value, is_known in listed}


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """A received result: a track of one frame, the key of its body, or None, and its shape (S,)."""

    track: Track
    body: str | None
    shape: Array


def read_result(payload: bytes) -> Result | None:
    """A received result; None at the end of the results, or ProtocolError."""
    decode = msgspec.json.decode if payload.startswith(b"{") else msgspec.msgpack.decode
    try:
        message = decode(payload, type=ResultMessage | EndMessage)
        if message.version != LIVE:
            raise ProtocolError(f"the result is of version {message.version}, expected {LIVE}")
        if isinstance(message, EndMessage):
            return None
        return Result(as_track(message), message.body, np.array(message.shape))
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise ProtocolError(f"not a result: {error}") from error


def as_track(message: ResultMessage) -> Track:
    """The track of one frame; ValueError if the message contradicts itself."""
    count, dofs = len(message.hypotheses.weight), len(message.pose)
    unknown = (np.nan, np.nan, np.nan)
    joints = [[unknown if place is None else place for place in message.joints.values()]]
    return Track(
        frame=np.array([message.frame]),
        time_s=np.array([message.time_s]),
        dof_names=tuple(message.pose),
        pose=row(message.pose, message.pose),
        joint_names=tuple(message.joints),
        joint_positions=np.array(joints, dtype=np.float64).reshape(1, -1, 3),
        hypothesis_pose=np.array(message.hypotheses.pose, dtype=np.float64).reshape(1, count, dofs),
        hypothesis_weight=np.array([message.hypotheses.weight], dtype=np.float64),
        status=np.array([message.status]),
        joint_deviation=row(message.joint_deviation, message.joints),
        joint_off_probability=row(message.joint_off_probability, message.joints),
        joint_seen=row(message.joint_seen, message.joints),
        angle_names=tuple(message.angles),
        angle=row(message.angles, message.angles),
        angle_deviation=row(message.angle_deviation, message.angles),
    )


def row(values: Values, names: Mapping[str, Any]) -> Array:
    """Values (1, N) of names; NaN if unknown."""
    known = [np.nan if (value := values.get(name)) is None else value for name in names]
    return np.array([known], dtype=np.float64)
