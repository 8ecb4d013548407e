"""A family of bodies: what detection, tracking and results know of a kind of body besides its model.

A family knows the sizes that its bodies can have, the poses in which they are searched for, what cannot be
one of them, which way is up in them, and their angles. Everything else treats all bodies alike.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import ClassVar, Protocol

import numpy as np

from gepf.common.arrays import Array, Mask
from gepf.common.body import BodyModel
from gepf.common.frame import SubjectFrame
from gepf.common.settings import RefineSettings
from gepf.coordinator.bodies.angles import Angles
from gepf.coordinator.bodies.pixels import BodyNetwork
from gepf.coordinator.bodies.tracked import activate_at, choose_active, name_pose

SIZES = 64  # bodies that are kept
EXTENT_POSES = 30  # in which the extents of a body are measured

BodySize = tuple[float, ...]
"""Measures by which the bodies of a family differ; empty if their shape is known."""


@dataclass(frozen=True, slots=True, eq=False)
class FittedBody:
    """A body that was fitted to a frame, and what the frame shows of it. Metres, rig's frame."""

    model: BodyModel
    size: BodySize
    pose: Array  # (D,)
    joints: Array  # (J, 3)
    in_view: Mask  # (J,) joints that a camera could show
    residual: float  # mean distance of `some_points` from the surface
    subject: SubjectFrame
    points: Array  # (P, 3) all observed points
    some_points: Array  # (Q, 3)
    is_cut: bool  # by the border of the image or by something nearer
    heights: Array | None  # (J,) of the joints above the floor; None without a floor


class BodyFamily(ABC):
    """A kind of body. An implementation has no state; its bodies name it in `BodyModel.family`."""

    name: ClassVar[str]
    template: ClassVar[str | None] = None
    """The name by which `--model` selects a body without a file."""

    noun: ClassVar[str] = "body"
    """What one of its bodies is called in messages."""

    usual_size: ClassVar[BodySize] = ()
    """The size at a given start pose, if the size is not known."""

    library_size: ClassVar[BodySize] = ()
    """The size of the body whose poses from `draw_poses` are compared with a frame."""

    sizes: ClassVar[Sequence[BodySize]] = ((),)
    """The sizes at which a body of unknown size is compared with a frame; its shape is refined from there."""

    cell_m: ClassVar[float | None] = None
    """Cells in which a body of the library size is compared with a frame; None: a share of its extent."""

    nearest_m: ClassVar[float] = 0.0
    """Median depth around a body below which the unit of depth is in doubt."""

    has_keypoints: ClassVar[bool] = False
    """Whether a network finds keypoints of its bodies in colour images."""

    axis: ClassVar[tuple[str, str] | None] = None
    """Joints at the middle and at the upper end of an upright body; None: any orientation is as likely.

    Only bodies with an axis are recognised by a part of them, if the image cuts them: from the upper end on.
    A fixed joint of a URDF file is a joint, too.
    """

    sides: ClassVar[tuple[tuple[str, str], ...]] = ()
    """Pairs of left and right joints, which tell front from back."""

    lines: ClassVar[tuple[tuple[str, str], ...]] = ()
    """Pairs of joints that pictures connect."""

    is_exact: ClassVar[bool] = True
    """Whether the surface of the model is that of the body, not a template's, and its size is known.

    Deviations of joints then follow from the refinement alone; otherwise from errors of people.
    """

    outside_weight: ClassVar[float] = 1.0
    """Weight of squared distances of points outside of the surface; below 1 if bodies wear clothes."""

    zero: ClassVar[str] = "Zero and signs are the model's."
    """What angles of zero mean, for readers."""

    def body_network(self) -> BodyNetwork | None:
        """What tells pixels of its bodies from those of things that touch them; None if nothing does."""
        return None

    def reads(self, path: Path) -> bool:
        """Whether a file describes a body of this family."""
        del path
        return False

    @abstractmethod
    def load(self, model: str) -> BodyModel:
        """The body of a file or the template, with all its degrees of freedom; InputError if invalid."""

    @abstractmethod
    def bodies(self, model: str, active: tuple[str, ...] | None, preset: str) -> Bodies:
        """The bodies to track, from a file or the template, with these DOFs; InputError if invalid."""

    def given(self, model: BodyModel, active: tuple[str, ...] | None, preset: str) -> Bodies:
        """The body to track, from a model in memory with all DOFs; by default all of them move."""
        del preset
        return one_body(self, model, model.dof_names, choose_active(active, model.dof_names, model.dof_names))

    @abstractmethod
    def draw_poses(self, model: BodyModel, count: int, rng: np.random.Generator) -> Array:
        """Poses (N, D) in which a body is searched for, with the root at the origin.

        A pose includes the view: headings, and tilts of the camera, in its axes (x right, y down). The pose
        of zeros is that at rest, to which limbs that are out of view tend. So does the prior of joint angles,
        as far as `rest_spreads` says.
        """

    @abstractmethod
    def angles(self, model: BodyModel, held: Mapping[str, float], up: Array | None) -> Angles:
        """The angles of a tracked body, for users.

        `held` are the values of degrees of freedom that do not move. With `up` (3,), away from the ground in
        the camera frame, angles of the whole body are relative to the vertical.
        """

    def length(self, size: BodySize) -> float:
        """A length that is proportional to a body of this size."""
        del size
        return 1.0

    def extents(self, bodies: Bodies) -> tuple[float, float] | None:
        """The least extent of the smallest body that is searched for, and the largest of the largest one.

        In metres; over poses with joints anywhere within their ranges. The largest is the diagonal of the
        bounding box, whichever way the body is turned. None if the settings of candidates are for bodies of
        this family.
        """
        from gepf.common.kinematics import pose_vertices  # loads the compiler
        from gepf.coordinator.bodies.random_poses import draw_joints

        smallest, largest = np.inf, 0.0
        for size in bodies.sizes:
            model = bodies.tracked(size, {})[0]
            at_rest = np.zeros((1, len(model.dof_names)))
            poses = np.concatenate([at_rest, draw_joints(model, EXTENT_POSES, np.random.default_rng(0))])
            sides = np.ptp(pose_vertices(model, poses), axis=1)
            smallest = min(smallest, float(sides.max(axis=1).min()))
            largest = max(largest, float(np.linalg.norm(sides, axis=1).max()))
        return smallest, largest

    def alternatives(self, size: BodySize) -> Sequence[BodySize]:
        """Other sizes that look much like this one, but that refinement does not reach from it."""
        del size
        return []

    def log_pose_prior(self, model: BodyModel, settings: RefineSettings, poses: Array) -> Array:
        """Log density (N,) of the angles of poses (N, D), up to a constant; by default all are alike.

        The refinement does not include it. It must be 0 if the settings have no prior of joint angles.
        """
        del model, settings
        return np.zeros(len(poses))

    def log_shape_prior(self, names: tuple[str, ...], shapes: Array, in_view: Mask) -> Array:
        """Log density (N,) of shapes (N, S), up to a constant, given which joints (N, J) are in view."""
        del names, shapes
        return np.zeros(len(in_view))

    def size_of(self, coefficients: Array) -> BodySize:
        """The size of a body with these shape coefficients (S,)."""
        del coefficients
        return ()

    def implausible(self, body: FittedBody) -> str:
        """Why a fitted body cannot be one of this family; empty if it can."""
        del body
        return ""

    def describe_size(self, size: BodySize, deviation_m: float) -> dict[str, float | None]:
        """Measures by name, for a run's summary; None if the body was not found.

        `deviation_m` is the standard deviation of the first.
        """
        del size, deviation_m
        return {}

    def size_file(self, size: BodySize, deviation_m: float) -> dict[str, float]:
        """The content of a file that gives an estimated size to `--model`; empty if there is none."""
        del size, deviation_m
        return {}

    def roll(self, model: BodyModel, pose: Array, turn: Array) -> float | None:
        """The rotation of an image, a multiple of pi / 2, that makes a pose (D,) upright; None without axis.

        `turn` (3, 3) leads from the rig to the camera.
        """
        from gepf.common.kinematics import joint_positions  # loads the compiler

        if self.axis is None:
            return None
        joints, names = joint_positions(model, pose[None])[0], model.joint_names
        middle, top = (joints[names.index(name)] for name in self.axis)
        across, down, _ = turn @ (top - middle)
        quarter = 0.5 * np.pi
        return round(float(-np.arctan2(across, -down)) / quarter) % 4 * quarter

    def faces_away(self, names: tuple[str, ...], joints: Array, body: Array) -> Mask:
        """Which bodies with joints (M, J, 3) face in the direction opposite to that of a body (J, 3)."""
        if not self.sides:
            return np.zeros(len(joints), dtype=np.bool_)
        left, right = ([names.index(name) for name in side] for side in zip(*self.sides, strict=True))
        across = (joints[:, left] - joints[:, right]).sum(axis=1)  # (M, 3)
        return np.asarray(across @ (body[left] - body[right]).sum(axis=0) < 0.0)


class ShapeSpace(Protocol):
    """All bodies of a family whose size can be estimated."""

    @property
    def anybody(self) -> BodyModel:
        """A body of any shape: shape coefficients (S) and all other degrees of freedom."""
        ...

    def coefficients(self, size: BodySize) -> Array:
        """The shape coefficients (S,) of a body of this size."""
        ...


class Bodies:
    """The bodies of one family that may be tracked: of any size, or one of known shape.

    Args:
        family: What is known of all of them.
        build: Full model from a size; all models have corresponding vertices.
        start_dofs: Degrees of freedom for detection.
        active: Tracked degrees of freedom.
        dof_names: All degrees of freedom.
        size: The size; None if it is not known.
        content: Hash of a known body.
        space: The shapes that a body of unknown size may have.
    """

    def __init__(
        self,
        family: BodyFamily,
        build: Callable[..., BodyModel],
        start_dofs: tuple[str, ...],
        active: tuple[str, ...],
        dof_names: tuple[str, ...],
        *,
        size: BodySize | None = None,
        content: str | None = None,
        space: ShapeSpace | None = None,
    ) -> None:
        if size is None and space is None and len(family.sizes) > 1:
            raise ValueError("bodies of unknown size need the space of their shapes")
        self.full = lru_cache(SIZES)(build)
        self.for_start = lru_cache(SIZES)(self._for_start)
        self.family, self.size, self.content, self.space = family, size, content, space
        self.start_dofs, self.active, self.dof_names = start_dofs, active, dof_names

    @property
    def sizes(self) -> Sequence[BodySize]:
        """The sizes at which the body is compared with a frame."""
        return self.family.sizes if self.size is None else [self.size]

    @cached_property
    def searched(self) -> BodyModel:
        """The body that is searched for: with shape coefficients, if its size is not known."""
        return self._flexible(self.start_dofs, self.usual_size, {})[0]

    def shape_of(self, size: BodySize) -> Array:
        """The shape coefficients (S,) of a size."""
        return np.empty(0) if self.space is None else self.space.coefficients(size)

    @property
    def usual_size(self) -> BodySize:
        """The size at a given start pose."""
        return self.family.usual_size if self.size is None else self.size

    @property
    def library_size(self) -> BodySize:
        """The size of the body whose poses are compared with a frame."""
        return self.family.library_size if self.size is None else self.size

    def tracked(self, size: BodySize, values: Mapping[str, float]) -> tuple[BodyModel, Array]:
        """The tracked body, with other degrees of freedom held at `values`, and its pose (D,) there."""
        full = self.full(*size)
        return activate_at(full, self.active, name_pose(full, values))

    def flexible(self, size: BodySize, values: Mapping[str, float]) -> tuple[BodyModel, Array]:
        """As `tracked`, with shape coefficients as further degrees of freedom if the size is not known."""
        return self._flexible(self.active, size, values)

    def _flexible(
        self, active: tuple[str, ...], size: BodySize, values: Mapping[str, float]
    ) -> tuple[BodyModel, Array]:
        full = self.full(*size) if self.space is None else self.space.anybody
        held, count = name_pose(full, values), full.shape_count
        held[:count] = self.shape_of(size)
        return activate_at(full, (*full.dof_names[:count], *active), held)

    def _for_start(self, *size: float) -> BodyModel:
        """The body with the degrees of freedom for detection."""
        full, start = self.full(*size), self._usual
        moved = [full.dof(name) for name in start.dof_names]
        return replace(
            start, vertices=full.vertices, points=full.points[moved], joint_points=full.joint_points
        )

    @cached_property
    def _usual(self) -> BodyModel:
        full = self.full(*self.usual_size)
        return activate_at(full, self.start_dofs, np.zeros(len(full.dof_names)))[0]


def one_body(
    family: BodyFamily,
    model: BodyModel,
    start_dofs: tuple[str, ...],
    active: tuple[str, ...],
    size: BodySize = (),
) -> Bodies:
    """A body of known shape, with all its degrees of freedom: a robot, an object, a person of known size."""
    return Bodies(
        family, lambda *_: model, start_dofs, active, model.dof_names, size=size, content=model.hash
    )
