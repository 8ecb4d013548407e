"""People of any size as one moved surface: a linear space around the mean adult, from a file.

`python -m gepf.coordinator.bodies.human.build` makes the file from free data. For adults stature is an exact
scale; smaller people have the proportions of their age, between a baby, a child and an adult.
All else is linear in girth and in the lengths that differ from those that stature implies.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gepf.common.arrays import Array, Indices
from gepf.common.body import BodyModel, find_balls, with_shape
from gepf.coordinator.bodies.family import BodySize
from gepf.coordinator.bodies.human.dofs import HUMAN, joint_range, rest_spread
from gepf.coordinator.bodies.human.keypoints import attach_keypoints
from gepf.coordinator.bodies.human.skeleton import build_skeleton

FILE = Path(__file__).with_name("person.npz")
"""Its arrays: people (K, V, 3) and their joints (K, N, 3) at rest, of stature 1, and what changes them."""

SHAPE_DOFS = ("shape_stature", "shape_infant", "shape_child", "shape_girth")
"""Shape coefficients in metres: stature less that of the usual adult; the parts of the stature that have the
proportions of an infant and of a child, instead of an adult's; stature times the excess of girth over 1."""

REFERENCE_STATURE = 1.75  # metres, of the usual adult: a person of unknown stature


class ShapeDeviations(NamedTuple):
    """Standard deviations of the shape coefficients, SHAPE_DOFS, around those of the detected person."""

    stature_m: float = 0.06  #: half the distance between the sizes that are tried
    infant_m: float = 0.03  #: proportions of the same age
    child_m: float = 0.03  #: the same
    girth_m: float = 0.15  #: a tenth of girth


class Size(NamedTuple):
    """Stature in metres, girth as a factor, and how far a small person has the proportions of an adult.

    `maturity` is 0 for the mean person of the stature and 1 for the proportions of an adult.
    """

    stature: float
    girth: float
    maturity: float = 0.0


UNIT = 4e-5  # of stature: the coordinates in the file are integer multiples of it

NAMED_JOINTS = {
    "pelvis": ("pelvis", "pelvis"), "neck": ("vt1", "vc7"), "head": ("skull", "head"),
    **{
        f"{word}_{joint}": (f"{side}_{link}", f"{side}_{place}")
        for word, side in (("right", "r"), ("left", "l"))
        for joint, link, place in (
            ("shoulder", "upper_arm", "glenohumeral"), ("elbow", "forearm", "elbow"),
            ("wrist", "hand", "wrist"), ("hip", "thigh", "hip"), ("knee", "shank", "knee"),
            ("ankle", "talus", "ankle"),
        )
    },
}  # fmt: skip
"""Output joint -> its link and its joint in the skeleton; where each lies: `build.joints`."""


@dataclass(frozen=True, eq=False)
class ShapeSpace:
    """People of stature 1 at some statures (K), and the change by girth and by lengths (M, as in `Measures`).

    Args:
        model: A person with all degrees of freedom.
        centres: Indices of the joints of degrees of freedom (D,).
        named: Indices of the named joints (J,).
        ages: (K,) years, ascending.
        statures: (K,) metres, of the mean person of each age.
        lengths: (K, M) shares of stature.
        vertices: (K, V, 3).
        joints: (K, N, 3).
        girth: (V, 3) per unit of girth.
        longer: (M, V, 3) per length.
        longer_joints: (M, N, 3) per length.
    """

    model: BodyModel
    centres: Indices
    named: Indices
    ages: Array
    statures: Array
    lengths: Array
    vertices: Array
    joints: Array
    girth: Array
    longer: Array
    longer_joints: Array

    def age(self, stature_m: float, maturity: float = 0.0) -> float:
        """The age in years of the mean person of a stature; all adults have the last of `ages`.

        With `maturity`, a share of the years that are left until then is added: a small person may have the
        proportions of an older one.
        """
        usual = float(np.interp(stature_m, self.statures, self.ages))
        return usual + maturity * (float(self.ages[-1]) - usual)

    def maturity(self, stature_m: float, age: float) -> float:
        """The maturity for which `age` gives this age in years; 0 for adult statures."""
        usual = self.age(stature_m)
        left = float(self.ages[-1]) - usual
        return (age - usual) / left if left > 0.0 else 0.0

    def implied(self, stature_m: float, age: float) -> Array:
        """Lengths (M,) in metres that stature and age imply."""
        return np.asarray(stature_m * np.tensordot(self._blend(age), self.lengths, axes=1))

    def person(
        self,
        stature_m: float,
        girth: float,
        maturity: float = 0.0,
        age: float | None = None,
        lengths: Array | None = None,
    ) -> BodyModel:
        """A person with all degrees of freedom; `age` (years) and `lengths` (M,), metres, may be implied."""
        age = self.age(stature_m, maturity) if age is None else age
        blend = self._blend(age)
        vertices = np.tensordot(blend, self.vertices, axes=1) + (girth - 1.0) * self.girth
        joints = np.tensordot(blend, self.joints, axes=1)
        if lengths is not None:
            apart = (lengths - self.implied(stature_m, age)) / stature_m
            vertices += np.tensordot(apart, self.longer, axes=1)
            joints += np.tensordot(apart, self.longer_joints, axes=1)
        return replace(
            self.model,
            vertices=stature_m * vertices,
            points=stature_m * joints[self.centres],
            joint_points=stature_m * joints[self.named],
        )

    @cached_property
    def anybody(self) -> BodyModel:
        """A person of any shape: the degrees of freedom SHAPE_DOFS, and all others; zero is the usual adult.

        The space is linear: a person of these ages is the sum of those of stature 1, each times its share of
        the stature, and of the change by girth times (girth - 1) times the stature.
        """
        adult, usual = len(self.ages) - 1, self.person(REFERENCE_STATURE, 1.0)
        younger = np.arange(adult)
        joints = np.concatenate([self.joints[[adult]], self.joints[younger] - self.joints[adult]])
        people = np.concatenate([self.vertices[[adult]], self.vertices[younger] - self.vertices[adult]])
        centres = np.concatenate([joints, np.zeros_like(joints[:1])])
        return with_shape(
            usual,
            SHAPE_DOFS,
            np.array(ShapeDeviations()),
            np.concatenate([people, self.girth[None]]),
            centres[:, self.centres],
            centres[:, self.named],
        )

    def coefficients(self, size: BodySize) -> Array:
        """Values (S,) of SHAPE_DOFS, metres, of the person that `person` returns for this `Size`."""
        stature_m, girth, maturity = Size(*size)
        younger = self._blend(self.age(stature_m, maturity))[:-1]
        values = [stature_m - REFERENCE_STATURE, *(stature_m * younger), stature_m * (girth - 1.0)]
        return np.array(values)

    def size_of(self, coefficients: Array) -> Size:
        """The size of the person with these coefficients (S,)."""
        stature = float(coefficients[0]) + REFERENCE_STATURE
        younger = np.clip(coefficients[1:-1] / stature, 0.0, 1.0)
        place = (len(younger) - np.arange(len(younger))) @ younger  # steps of age below the adult
        age = float(np.interp(len(younger) - place, np.arange(len(self.ages)), self.ages))
        return Size(stature, 1.0 + float(coefficients[-1]) / stature, self.maturity(stature, age))

    def _blend(self, age: float) -> Array:
        """Shares (K,) with which the K people are blended into one of this age."""
        place = np.interp(age, self.ages, np.arange(len(self.ages)))
        return np.maximum(1.0 - np.abs(place - np.arange(len(self.ages))), 0.0)


@cache
def shape_space() -> ShapeSpace:
    """The space of all people."""
    with np.load(FILE) as file:
        data = {name: file[name] for name in file.files}
    skeleton, joints, links = build_skeleton(), data["joints"].tolist(), data["links"].tolist()
    names = tuple(dof.name for dof in skeleton.dofs)
    bones = tuple(skeleton.links)
    kinds = np.array([dof.kind for dof in skeleton.dofs], dtype=np.int64)
    parents = np.array(
        [names.index(dof.parent) if dof.parent else -1 for dof in skeleton.dofs], dtype=np.int64
    )
    axes = np.array([dof.axis for dof in skeleton.dofs])
    centres = np.array([joints.index(dof.joint) for dof in skeleton.dofs])
    named = np.array([joints.index(place) for _, place in NAMED_JOINTS.values()])
    points = data["people_joints"][-1]
    link_dofs = np.array([names.index(last) for last in skeleton.links.values()], dtype=np.int64)
    of_file = np.array([bones.index(link) for link in links], dtype=np.int64)
    weights = data["skin_weights"].astype(np.float64)
    people, skin_links = UNIT * data["people"], of_file[data["skin_links"]]
    keypoints = attach_keypoints(people[-1], skin_links, bones)
    model = BodyModel(
        name=HUMAN,
        family=HUMAN,
        dof_names=names,
        kinds=kinds,
        parents=parents,
        axes=axes,
        points=points[centres],
        limits=np.stack([joint_range(name) for name in names]),
        rest_spreads=np.array([rest_spread(name) for name in names]),
        balls=find_balls(kinds, parents, axes, points[centres], link_dofs),
        link_names=bones,
        link_dofs=link_dofs,
        vertices=people[-1],
        triangles=data["triangles"].astype(np.int64),
        skin_links=skin_links,
        skin_weights=weights / weights.sum(axis=1, keepdims=True),
        joint_names=tuple(NAMED_JOINTS),
        joint_links=np.array([bones.index(link) for link, _ in NAMED_JOINTS.values()], dtype=np.int64),
        joint_points=points[named],
        keypoint_links=keypoints[0],
        keypoint_vertices=keypoints[1],
        keypoint_shares=keypoints[2],
    )
    return ShapeSpace(
        model,
        centres,
        named,
        vertices=people,
        joints=data["people_joints"],
        **{name: data[name] for name in ("ages", "statures", "lengths", "longer_joints")},
        **{name: UNIT * data[name] for name in ("girth", "longer")},
    )
