"""The start of a tracker, and its state between frames."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import ROOT_DOFS, BodyModel, unknown_dof, with_fixed_shape
from gepf.common.bounds import LARGEST
from gepf.common.errors import InputError
from gepf.coordinator.bodies.families import family_of
from gepf.coordinator.bodies.family import Bodies, BodyFamily, BodySize
from gepf.coordinator.files import read_json
from gepf.coordinator.scene.scene import SceneChanges
from gepf.coordinator.tracking.cameras import Agreement, CameraStates
from gepf.coordinator.tracking.sensor_noise import NO_NOISE, SensorNoise
from gepf.coordinator.tracking.track_management import GIVEN, TrackManagement


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """A body and its pose (D,) in the first frame that shows it.

    `values` are by name, including degrees of freedom that are held. Until the body is `found`, only the
    names of its degrees of freedom and joints are valid; the pose is NaN, the size empty. `noise` is the
    camera's noise in that frame; zero if it was not measured.
    """

    model: BodyModel
    pose: Array
    size: BodySize
    values: Mapping[str, float] = field(default_factory=dict)
    noise: SensorNoise = NO_NOISE
    found: bool = True

    @property
    def family(self) -> BodyFamily:
        """What is known of such bodies."""
        return family_of(self.model)

    @property
    def held(self) -> dict[str, float]:
        """Nonzero values of the degrees of freedom that are held."""
        return {name: v for name, v in self.values.items() if v and name not in self.model.dof_names}

    def body_of(self, shape: Array) -> BodyModel:
        """The body of the shape with these coefficients (S,), without degrees of freedom of shape."""
        return with_fixed_shape(self.model, shape) if self.model.shape_count else self.model

    def size_of(self, shape: Array) -> BodySize:
        """The size of the body with these shape coefficients (S,); that of the start without any."""
        return self.family.size_of(shape) if len(shape) else self.size

    @property
    def is_free(self) -> bool:
        """Whether the body can move: its root is not held."""
        return set(ROOT_DOFS) <= set(self.model.dof_names)

    @property
    def roll(self) -> float:
        """The rotation of the image that makes the body upright: a multiple of pi / 2, radians.

        Zero for a body without an axis.
        """
        return (self.family.roll(self.model, self.pose, np.eye(3)) or 0.0) if self.found else 0.0


def start_at(
    values: Mapping[str, float],
    bodies: Bodies,
    size: BodySize | None = None,
    noise: SensorNoise = NO_NOISE,
    *,
    flexible: bool = False,
) -> Start:
    """The start at a pose given by name, by default of the known or usual size.

    If it is `flexible`, a size that is not known can change.
    """
    size = bodies.usual_size if size is None else size
    model, pose = (bodies.flexible if flexible else bodies.tracked)(size, values)
    return Start(model, pose, size, dict(values), noise)


def read_start(path: Path, dof_names: Collection[str], remedy: str = "") -> dict[str, float]:
    """Values by name; missing values are zero. InputError for an unknown name, or a value above LARGEST."""
    mend, missing = "write {degree of freedom: number}", "give --init a file, or auto"
    values = read_json(path, dict[str, float], mend, missing)
    for name, value in values.items():
        if name not in dof_names:
            raise InputError(f"{path}: {unknown_dof(name, dof_names)}{remedy}")
        if abs(value) > LARGEST:
            raise InputError(f"{path}: {name} is {value:g}, above {LARGEST:g}; give radians and metres")
    return values


@dataclass(frozen=True, slots=True, eq=False)
class Checkpoint:
    """The part of the state that changes with every frame and is recorded; a new field is recorded, too."""

    belief: dict[str, Array]  # by field; empty until the body is found
    expected: Array | None  # pose (D,) around which the next frame is segmented
    time_s: float | None  # of the last frame that showed the body
    generator: str  # state of the random generator as JSON, which allows integers of any size
    scenes: SceneChanges  # changes by the frame; the whole scenes in a resumed run
    management: TrackManagement = field(default_factory=TrackManagement)
    cameras: CameraStates = field(default_factory=dict)
    doubted: tuple[str, ...] = ()  # cameras, when the next frame is segmented
    faulty: tuple[str, ...] = ()  # cameras at fault in the last frame that showed the body
    agreement: Agreement = field(default_factory=Agreement)  # of the cameras, by the last pose


@dataclass(frozen=True, slots=True, eq=False)
class TrackerState:
    """The whole state of a tracker between two frames; equal states give equal results, bit for bit."""

    start: Start  # is recorded only when it changes
    checkpoint: Checkpoint

    @property
    def shape(self) -> Array:
        """The shape coefficients (S,) of the body."""
        return self.checkpoint.belief.get("reported", self.start.pose)[: self.start.model.shape_count]

    @property
    def body(self) -> BodyModel:
        """The body in its present shape."""
        return self.start.body_of(self.shape)

    @property
    def size(self) -> BodySize:
        """The present size; empty until the body is found, or if its shape is known."""
        return self.start.size_of(self.shape)

    @property
    def stature_deviation(self) -> float:
        """Standard deviation of the stature, metres; 0 if it is not estimated."""
        precision = self.checkpoint.belief.get("shape_precision", np.empty((0, 0)))
        return float(np.sqrt(np.linalg.inv(precision)[0, 0])) if precision.size else 0.0


def first_state(bodies: Bodies, values: Mapping[str, float] | None, seed: int) -> TrackerState:
    """The state before the first frame: a start at values by name, or None to detect the body."""
    generator = json.dumps(np.random.default_rng(seed).bit_generator.state)
    if values is not None:
        start = start_at(values, bodies)
        return TrackerState(start, Checkpoint({}, start.pose, None, generator, {}, GIVEN))
    model, pose = bodies.tracked(bodies.usual_size, {})
    start = Start(model, np.full_like(pose, np.nan), (), found=False)
    return TrackerState(start, Checkpoint({}, None, None, generator, {}))
