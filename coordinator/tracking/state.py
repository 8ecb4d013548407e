"""The start of a track, and the state of a tracker between two frames."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import ROOT_DOFS, BodyModel, unknown_dof, with_fixed_shape
from gepf.common.bounds import LARGEST
from gepf.common.errors import InputError
from gepf.coordinator.bodies.families import family_of
from gepf.coordinator.bodies.family import Bodies, BodyFamily, BodySize
from gepf.coordinator.colour.agreement import ColourStates
from gepf.coordinator.files import read_json
from gepf.coordinator.filters.methods import initial_belief
from gepf.coordinator.scene.noise import NO_NOISE, SensorNoise
from gepf.coordinator.scene.scene import SceneChanges
from gepf.coordinator.settings import Settings
from gepf.coordinator.tracking.cameras import CameraStates
from gepf.coordinator.tracking.track_state import Absent, Body, Found, NextSegmentation, TrackState


@dataclass(frozen=True, slots=True, eq=False)
class Start:
    """A body and its pose (D,) in the first frame that shows it.

    `values` are by name, including degrees of freedom that are held. Until the body is detected (`found` is
    false), only the names of its degrees of freedom and joints are valid; the pose is NaN, the size empty.
    `noise` is the camera's noise in that frame; zero if it was not measured.
    """

    model: BodyModel
    pose: Array
    size: BodySize
    values: Mapping[str, float] = field(default_factory=dict)
    noise: SensorNoise = NO_NOISE
    found: bool = True  # detected, or given

    @property
    def family(self) -> BodyFamily:
        """The family of the body."""
        return family_of(self.model)

    @property
    def held(self) -> dict[str, float]:
        """Nonzero values of the degrees of freedom that are held."""
        return {name: v for name, v in self.values.items() if v and name not in self.model.dof_names}

    def body_of(self, shape: Array) -> BodyModel:
        """The body with these shape coefficients (S,), which are then no longer degrees of freedom."""
        return with_fixed_shape(self.model, shape)

    def size_of(self, shape: Array) -> BodySize:
        """The size of the body with these shape coefficients (S,); that at the start if there are none."""
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
    """The start at a pose given as values by name; the default size is the known one or else the usual one.

    If the body is `flexible`, a size that is not known can change.
    """
    size = bodies.usual_size if size is None else size
    model, pose = (bodies.flexible if flexible else bodies.tracked)(size, values)
    return Start(model, pose, size, dict(values), noise)


def read_start(path: Path, dof_names: Collection[str], remedy: str = "") -> dict[str, float]:
    """The values of a start, by name; a name that is missing counts as zero.

    Raises InputError for an unknown name, or for a value whose magnitude is above LARGEST.
    """
    fix_hint, missing_hint = "write {degree of freedom: number}", "give --init a file, or auto"
    values = read_json(path, dict[str, float], fix_hint, missing_hint)
    for name, value in values.items():
        if name not in dof_names:
            raise InputError(f"{path}: {unknown_dof(name, dof_names)}{remedy}")
        if abs(value) > LARGEST:
            raise InputError(f"{path}: {name} is {value:g}, beyond +-{LARGEST:g}; give radians and metres")
    return values


@dataclass(frozen=True, slots=True, eq=False)
class Checkpoint:
    """The part of a person's state that changes with every frame and is recorded."""

    track: TrackState
    generator: str  # state of the random number generator as JSON, which allows integers of any size


@dataclass(frozen=True, slots=True, eq=False)
class PersonState:
    """The whole state of a person or another body between two frames."""

    start: Start  # recorded only when it changes
    checkpoint: Checkpoint

    @property
    def track(self) -> TrackState:
        """The state of the track."""
        return self.checkpoint.track

    @property
    def shape(self) -> Array:
        """The shape coefficients (S,) of the body."""
        pose = self.track.belief.reported if isinstance(self.track, Body) else self.start.pose
        return pose[: self.start.model.shape_count]

    @property
    def body(self) -> BodyModel:
        """The body in its present shape."""
        return self.start.body_of(self.shape)

    @property
    def size(self) -> BodySize:
        """The present size; empty until the body is detected, or if its shape is known."""
        return self.start.size_of(self.shape)

    @property
    def stature_deviation(self) -> float:
        """Standard deviation of the stature, metres; 0 if it is not estimated."""
        if not isinstance(self.track, Body) or not self.track.belief.shape_precision.size:
            return 0.0
        return float(np.sqrt(np.linalg.inv(self.track.belief.shape_precision)[0, 0]))


@dataclass(frozen=True, slots=True, eq=False)
class FrameState:
    """The part of the state after a frame that does not belong to any person."""

    scene_changes: SceneChanges = field(default_factory=dict)
    """What this frame changed in the scenes; in the state from which a run is resumed, all changes so far."""
    cameras: CameraStates = field(default_factory=dict)
    colours: ColourStates = field(default_factory=dict)
    time_s: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class TrackerState:
    """The state of a tracker between two frames.

    Together with the scenes, it determines all later results, bit for bit. The scenes are the sum of the
    scene changes of all frames so far; `gepf.coordinator.results.log` adds them up for a resumed run.
    """

    people: Sequence[PersonState]
    frame: FrameState = field(default_factory=FrameState)


def first_state(bodies: Bodies, values: Mapping[str, float] | None, settings: Settings) -> PersonState:
    """The state before the first frame; `values` are those of the start by name, None to detect the body."""
    generator = json.dumps(np.random.default_rng(settings.seed).bit_generator.state)
    if values is not None:
        start = start_at(values, bodies)
        belief = initial_belief(start.model, start.pose, settings)
        upcoming = NextSegmentation(start.pose, is_confirmed=True)
        track = Found(belief=belief, next_segmentation=upcoming, unshown_s=None)
        return PersonState(start, Checkpoint(track, generator))
    model, pose = bodies.tracked(bodies.usual_size, {})
    start = Start(model, np.full_like(pose, np.nan), (), found=False)
    return PersonState(start, Checkpoint(Absent(), generator))
