"""People as a family of bodies: the human template in any size, with the angles of MPEG-4."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import ClassVar

import numpy as np

from gepf.common.arrays import Array, Mask
from gepf.common.body import BodyModel
from gepf.common.errors import InputError
from gepf.common.settings import RefineSettings
from gepf.coordinator.bodies.angles import Angles
from gepf.coordinator.bodies.family import Bodies, BodyFamily, BodySize, FittedBody, one_body
from gepf.coordinator.bodies.human.angles import person_angles
from gepf.coordinator.bodies.human.dofs import HUMAN, HUMAN_DOFS
from gepf.coordinator.bodies.human.measures import DEVIATION, Measures
from gepf.coordinator.bodies.human.shape_space import REFERENCE_STATURE, Size, shape_space
from gepf.coordinator.bodies.human.template import DEFAULT_ACTIVE, human, human_of
from gepf.coordinator.bodies.human.typical_poses import people_poses
from gepf.coordinator.bodies.pixels import BodyNetwork
from gepf.coordinator.bodies.tracked import choose_active
from gepf.coordinator.files import read_json

PERSON_SUFFIX = ".json"

PIXELS_FILE = Path(__file__).with_name("pixels.npz")
"""The network that tells people from things; `benchmarks/body_pixels/train.py` trained it."""

SPINE = ("vl3_tilt", "vl3_roll", "vl3_torsion", "vc7_tilt")
"""One joint of the lower back and one of the neck represent all others: people bend, and look down."""

USUAL = {"paper": DEFAULT_ACTIVE, "default": DEFAULT_ACTIVE + SPINE}
"""Preset -> default degrees of freedom."""

STATURES_M = (0.82, 0.9, 0.98, 1.07, 1.16, 1.26, 1.38, 1.5, 1.62, 1.74, 1.86, 1.98)
USUAL_GIRTH = 1.05
ADULT_M, ADULT_DEVIATION_M = 1.69, 0.10  # mean and deviation of the statures of adults
ENDS = ("head", "left_ankle", "right_ankle")


def limb_lines(side: str) -> tuple[tuple[str, str], ...]:
    """Pairs of joints of an arm and a leg that pictures connect."""
    shoulder, elbow, wrist, hip, knee, ankle = (
        f"{side}_{joint}" for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    )
    arm = (("neck", shoulder), (shoulder, elbow), (elbow, wrist))
    return (*arm, ("pelvis", hip), (hip, knee), (knee, ankle))


class People(BodyFamily):
    """People: detected in typical poses and any size, upright unless something contradicts, never flat."""

    name = template = HUMAN
    noun = "person"
    usual_size = Size(REFERENCE_STATURE, 1.0)
    library_size = Size(REFERENCE_STATURE, USUAL_GIRTH)
    sizes: ClassVar[Sequence[BodySize]] = [Size(stature, USUAL_GIRTH) for stature in STATURES_M]
    cell_m = 0.06
    nearest_m = 1.2
    axis = ("pelvis", "head")
    sides = (("left_hip", "right_hip"), ("left_shoulder", "right_shoulder"))
    lines = (("pelvis", "neck"), ("neck", "head"), *limb_lines("right"), *limb_lines("left"))
    is_exact = False
    outside_weight = 0.5  # errors fall by 0.4 cm for clothed people, and stay the same for swimwear
    has_keypoints = True
    zero = "Zero is standing straight with arms hanging; signs mean the same on both sides."

    def body_network(self) -> BodyNetwork:
        """The network that tells people from things."""
        return people_network()

    def reads(self, path: Path) -> bool:
        """Whether a file holds a person's measures."""
        return path.suffix == PERSON_SUFFIX

    def load(self, model: str) -> BodyModel:
        """The person with the measures of a file, or the average person."""
        return human() if model == HUMAN else human_of(read_person(Path(model)))

    def bodies(self, model: str, active: tuple[str, ...] | None, preset: str) -> Bodies:
        """People of any stature, or one with the measures of a file; by default with the preset's DOFs."""
        if model != HUMAN:
            return self.measured(read_person(Path(model)), active, preset)
        usual, space = USUAL[preset], shape_space()
        chosen = choose_active(active, usual, HUMAN_DOFS)
        return Bodies(self, space.person, usual, chosen, HUMAN_DOFS, space=space)

    def given(self, model: BodyModel, active: tuple[str, ...] | None, preset: str) -> Bodies:
        """One person of the template, whose size is measured; by default the preset's angles move."""
        usual = USUAL[preset]
        chosen = choose_active(active, usual, model.dof_names)
        return one_body(self, model, usual, chosen, size_of_surface(model.vertices))

    def measured(self, measures: Measures, active: tuple[str, ...] | None, preset: str) -> Bodies:
        """One person with known measures, with the surface of people of unknown size."""
        usual = USUAL[preset]
        maturity = shape_space().maturity(measures.stature, measures.age)
        size = Size(measures.stature, measures.girth, maturity)
        return one_body(self, human_of(measures), usual, choose_active(active, usual, HUMAN_DOFS), size)

    def draw_poses(self, model: BodyModel, count: int, rng: np.random.Generator) -> Array:  # noqa: ARG002
        """Typical poses (N, D), always the same."""
        return people_poses(model, count)

    def angles(self, model: BodyModel, held: Mapping[str, float], up: Array | None) -> Angles:
        """The anatomical angles of the joints that move."""
        return person_angles(model.dof_names, held, up)

    def length(self, size: BodySize) -> float:
        """The stature, metres."""
        return Size(*size).stature

    def extents(self, bodies: Bodies) -> None:
        """None: the settings of candidates are for people."""
        del bodies

    def alternatives(self, size: BodySize) -> Sequence[BodySize]:
        """A small person with the proportions of an adult, or halfway between these and the mean child's."""
        size = Size(*size)
        is_small = size.stature <= shape_space().statures[-1]
        return [size._replace(maturity=maturity) for maturity in (0.5, 1.0)] if is_small else []

    def log_pose_prior(self, model: BodyModel, settings: RefineSettings, poses: Array) -> Array:
        """Log density (N,) of the arms of poses (N, D), estimated from recorded poses."""
        if not settings.has_joint_prior:
            return np.zeros(len(poses))
        from gepf.coordinator.bodies.human.pose_prior import log_density  # loads the compiler

        return log_density(model, poses)

    def log_shape_prior(self, names: tuple[str, ...], shapes: Array, in_view: Mask) -> Array:
        """Log density (N,) of the statures of adults, where not both ends of the body are in view.

        A part of a body fits a range of sizes. Children are as likely as the mean adult.
        """
        statures = REFERENCE_STATURE + shapes[:, 0]
        above = np.maximum(0.0, (statures - ADULT_M) / ADULT_DEVIATION_M)
        ends = in_view[:, [names.index(end) for end in ENDS]]
        return np.where(ends[:, 0] & ends[:, 1:].any(axis=1), 0.0, -0.5 * above**2)

    def size_of(self, coefficients: Array) -> BodySize:
        """The size of the person with these shape coefficients (S,)."""
        return shape_space().size_of(coefficients)

    def implausible(self, body: FittedBody) -> str:
        """Why a fitted body is not a person; empty if it may be."""
        from gepf.coordinator.bodies.human.plausibility import reject  # loads the compiler

        return reject(body, self.length(body.size))

    def describe_size(self, size: BodySize, deviation_m: float) -> dict[str, float | None]:
        """Stature, its standard deviation, girth and age by proportions; None if nobody was detected."""
        names = ("stature_m", "stature_deviation_m", "girth", "age")
        values = self.size_file(size, deviation_m).values() if size else (None,) * len(names)
        return dict(zip(names, values, strict=True))

    def size_file(self, size: BodySize, deviation_m: float) -> dict[str, float]:
        """Stature, its standard deviation, girth and age, as `read_person` reads them."""
        stature, girth, maturity = Size(*size)
        age = shape_space().age(stature, maturity)
        return {"stature": stature, DEVIATION: deviation_m, "girth": girth, "age": age}


def size_of_surface(vertices: Array) -> Size:
    """The size of a person with the template's surface (V, 3) at rest, metres; InputError for any other."""
    stature, space = float(np.ptp(vertices[:, 1])), shape_space()
    mean = space.person(stature, 1.0).vertices
    if vertices.shape != mean.shape:
        raise InputError(
            f"the person's model has {len(vertices)} vertices, not {len(mean)} as the template; give Measures"
        )
    wider = space.person(stature, 2.0).vertices - mean  # per unit of girth
    return Size(stature, 1.0 + float(np.sum((vertices - mean) * wider) / np.sum(wider**2)))


def read_person(path: Path) -> Measures:
    """Measures in metres, and age in years, from a JSON file; missing ones follow from stature.

    InputError for implausible measures and unknown entries.
    """
    values = read_json(path, dict[str, float], "write {measure: metres}")
    values.pop(DEVIATION, None)
    if "stature" not in values:
        raise InputError(f"{path} has no stature; add it, in metres")
    try:
        return Measures.of(values.pop("stature"), **values)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


PEOPLE = People()


@lru_cache(maxsize=1)
def people_network() -> BodyNetwork:
    """The network of `PIXELS_FILE`."""
    return BodyNetwork.load(PIXELS_FILE)
