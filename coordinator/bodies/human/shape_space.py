"""People of any measures as one deformed surface: a linear space around the average person.

Meshing a person takes a third of a second; moving the vertices of an existing mesh takes a millisecond. For
each measure the vertices move with their bones and are then projected to the surface that `shape` gives for
the changed measures. Stature is an exact scale; all else is linear in girth and in the ratios of lengths to
those implied by stature.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from coordinator.bodies.human.measures import FRACTIONS_OF_STATURE, REFERENCE_STATURE, Measures
from coordinator.bodies.human.mesh import slope
from coordinator.bodies.human.shape import shape_person
from coordinator.bodies.human.template import SPINE_ANCHORS, Raised, lay_to_rest, mesh_person, raise_arms

Array = NDArray[np.float64]

RATIOS = ("girth", *FRACTIONS_OF_STATURE)
"""The differences between people of one stature."""

STEP = 0.1  # of a ratio, for its effect
NEAR = 0.003  # metres, for the gradient of the surface
ROUNDS = 2  # of Newton's method to the surface, along the normals of the average person

_LIMB_ENDS = {"clavicle": "shoulder", "upper_arm": "elbow", "forearm": "wrist", "hand": "middle3",
              "thigh": "knee", "shank": "ankle", "foot": "metatarsal"}  # fmt: skip
END_OF = {
    **{f"{side}_{link}": f"{side}_{end}" for side in "lr" for link, end in _LIMB_ENDS.items()},
    **dict(zip(SPINE_ANCHORS[:-1], (*SPINE_ANCHORS[1:-1], "skullbase"), strict=True)),
}
"""Link with skin -> the joint at the far end of its bone, if there is one."""


@dataclass(frozen=True, slots=True, eq=False)
class ShapeSpace:
    """The average person, and its change by each ratio (R): metres per unit of the ratio."""

    usual: BodyModel
    vertices: Array  # (R, V, 3)
    points: Array  # (R, D, 3)
    joint_points: Array  # (R, J, 3)

    def person(self, measures: Measures) -> BodyModel:
        """A person with these measures, with all degrees of freedom."""
        apart, scale = ratios(measures) - 1.0, measures.stature / REFERENCE_STATURE

        def changed(usual: Array, effects: Array) -> Array:
            moved: Array = scale * (usual + np.tensordot(apart, effects, axes=1))
            return moved

        return replace(
            self.usual,
            vertices=changed(self.usual.vertices, self.vertices),
            points=changed(self.usual.points, self.points),
            joint_points=changed(self.usual.joint_points, self.joint_points),
        )


def person_of_size(stature_m: float, girth: float) -> BodyModel:
    """A person of average proportions, with all degrees of freedom."""
    return shape_space().person(Measures.of(stature_m, girth))


def ratios(measures: Measures) -> Array:
    """Girth, and the ratios (R,) of lengths to those implied by stature."""
    lengths = [getattr(measures, name) / (f * measures.stature) for name, f in FRACTIONS_OF_STATURE.items()]
    return np.array([measures.girth, *lengths])


@cache
def shape_space() -> ShapeSpace:
    """The space of all people, computed once per process."""
    raised = raise_arms(Measures.of())
    usual, vertices = mesh_person(raised)
    steep = slope(shape_person(raised.measures, raised.skeleton).distance, vertices, NEAR)
    normals = steep / np.maximum(np.sum(steep**2, axis=1), 0.1)[:, None]
    changed = [reshape(usual, vertices, normals, raised, raise_arms(one_changed(name))) for name in RATIOS]
    return ShapeSpace(
        usual,
        np.stack([(model.vertices - usual.vertices) / STEP for model in changed]),
        np.stack([(model.points - usual.points) / STEP for model in changed]),
        np.stack([(model.joint_points - usual.joint_points) / STEP for model in changed]),
    )


def one_changed(name: str) -> Measures:
    """An average person with one ratio increased by a step."""
    if name == "girth":
        return Measures.of(girth=1.0 + STEP)
    return Measures.of(**{name: (1.0 + STEP) * FRACTIONS_OF_STATURE[name] * REFERENCE_STATURE})


def reshape(usual: BodyModel, vertices: Array, normals: Array, before: Raised, after: Raised) -> BodyModel:
    """Deform the average person to another; vertices and normals (V, 3) are its own in the building pose."""
    moved = follow_bones(usual, vertices, before, after)
    distance = shape_person(after.measures, after.skeleton).distance
    for _ in range(ROUNDS):
        moved = moved - distance(moved)[:, None] * normals
    return replace(
        usual,
        vertices=lay_to_rest(usual, moved, after.transforms),
        points=after.bare.points,
        joint_points=after.bare.joint_points,
    )


def follow_bones(usual: BodyModel, vertices: Array, before: Raised, after: Raised) -> Array:
    """Vertices (V, 3) in the building pose, moved and stretched with their bones."""
    moved = np.zeros_like(vertices)
    for k, link in enumerate(usual.link_names):
        share = np.where(usual.skin_links == k, usual.skin_weights, 0.0).sum(axis=1)
        if share.any():
            moved += share[:, None] * along_bone(vertices, *bone(link, before), *bone(link, after))
    return vertices + moved


def bone(link: str, raised: Raised) -> tuple[Array, Array]:
    """Start and end of the bone of a link; the end is arbitrary for the last bone of a limb."""
    place = raised.skeleton.links[link]
    start = next(dof.joint for dof in raised.skeleton.dofs if dof.name == place)
    return raised.joints[start], raised.joints[END_OF.get(link, start)]


def along_bone(points: Array, start: Array, end: Array, new_start: Array, new_end: Array) -> Array:
    """Displacement of points (V, 3) around a stretched bone: linear from start to end, constant beyond."""
    length = float((end - start) @ (end - start))
    along = np.clip((points - start) @ (end - start) / length, 0.0, 1.0) if length else np.zeros(len(points))
    moved: Array = (new_start - start) + along[:, None] * ((new_end - end) - (new_start - start))
    return moved
