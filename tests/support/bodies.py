"""Bodies for tests: one small enough to check by hand, random ones, and the person."""

from __future__ import annotations

from functools import cache

import numpy as np
import trimesh

from gepf.common.activation import activate
from gepf.common.arrays import Array, Indices, Mask
from gepf.common.body import ROOT_DOFS, ROTATION, TRANSLATION, BodyModel, find_balls, with_shape
from gepf.coordinator.bodies.human.template import DEFAULT_ACTIVE, human

RIGHT_HANDED = np.array([[0.0, 0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, -0.6]])
LEFT_HANDED = RIGHT_HANDED * (-1.0, 1.0, 1.0)  # its mirror image
FREE = (-np.inf, np.inf)
DOFS: tuple[tuple[str, int, str, tuple[float, ...], tuple[float, ...], tuple[float, float]], ...] = (
    # name, kind, parent, axis, point, limits
    *((name, TRANSLATION, ROOT_DOFS[j - 1] if j else "", tuple(np.eye(3)[j]), (0.0, 0.0, 0.0), FREE)
      for j, name in enumerate(ROOT_DOFS[:3])),
    *((name, ROTATION, ROOT_DOFS[j + 2], tuple(np.eye(3)[j]), (0.0, 0.0, 0.0), FREE)
      for j, name in enumerate(ROOT_DOFS[3:])),
    ("waist_1", ROTATION, "root_rz", tuple(LEFT_HANDED[1]), (0.0, 0.1, 0.0), (-0.3, 0.6)),
    ("waist_2", ROTATION, "waist_1", tuple(LEFT_HANDED[2]), (0.0, 0.1, 0.0), (-0.4, 0.4)),
    ("waist_3", ROTATION, "waist_2", tuple(LEFT_HANDED[0]), (0.0, 0.1, 0.0), (-0.5, 0.5)),
    ("l_arm_1", ROTATION, "waist_3", tuple(RIGHT_HANDED[0]), (0.2, -0.3, 0.0), (-1.0, 2.0)),
    ("l_arm_2", ROTATION, "l_arm_1", tuple(RIGHT_HANDED[1]), (0.2, -0.3, 0.0), (-0.8, 1.2)),
    ("l_arm_3", ROTATION, "l_arm_2", tuple(RIGHT_HANDED[2]), (0.2, -0.3, 0.0), (-1.5, 0.5)),
    ("l_elbow", ROTATION, "l_arm_3", (1.0, 0.0, 0.0), (0.22, 0.0, 0.01), (-2.0, 0.1)),
    ("r_arm_1", ROTATION, "waist_3", tuple(LEFT_HANDED[0]), (-0.2, -0.3, 0.0), (-1.0, 2.0)),
    ("r_arm_2", ROTATION, "r_arm_1", tuple(LEFT_HANDED[1]), (-0.2, -0.3, 0.0), (-0.8, 1.2)),
    ("r_arm_3", ROTATION, "r_arm_2", tuple(LEFT_HANDED[2]), (-0.2, -0.3, 0.0), (-1.5, 0.5)),
    ("r_elbow", ROTATION, "r_arm_3", (0.8, 0.6, 0.0), (-0.22, 0.0, 0.01), (-2.0, 0.1)),
    ("head_lift", TRANSLATION, "waist_3", (0.0, -0.8, -0.6), (0.0, -0.35, 0.0), (-0.05, 0.1)),
    ("head_nod", ROTATION, "head_lift", (1.0, 0.0, 0.0), (0.0, -0.4, 0.0), (-0.5, 0.6)),
)  # fmt: skip
LINKS = (
    # name, last degree of freedom, centre and radii of its ellipsoid, the link it is blended with, around
    ("stand", "", (0.1, 0.5, 2.0), (0.2, 0.08, 0.1), "", (0.0, 0.0, 0.0)),
    ("pelvis", "root_rz", (0.0, 0.18, 0.0), (0.14, 0.1, 0.09), "", (0.0, 0.0, 0.0)),
    ("trunk", "waist_3", (0.0, -0.13, 0.0), (0.16, 0.25, 0.1), "pelvis", (0.0, 0.1, 0.0)),
    ("l_upper", "l_arm_3", (0.21, -0.15, 0.0), (0.05, 0.17, 0.05), "trunk", (0.2, -0.3, 0.0)),
    ("l_fore", "l_elbow", (0.22, 0.15, 0.0), (0.04, 0.17, 0.04), "l_upper", (0.22, 0.0, 0.01)),
    ("r_upper", "r_arm_3", (-0.21, -0.15, 0.0), (0.05, 0.17, 0.05), "trunk", (-0.2, -0.3, 0.0)),
    ("r_fore", "r_elbow", (-0.22, 0.15, 0.0), (0.04, 0.17, 0.04), "r_upper", (-0.22, 0.0, 0.01)),
    ("head", "head_nod", (0.0, -0.5, -0.02), (0.08, 0.12, 0.1), "trunk", (0.0, -0.35, 0.0)),
)
BLEND_RADIUS = 0.12  # metres around a joint within which the skin is shared by two links


@cache
def puppet(blended: bool = True) -> BodyModel:
    """A trunk on a pelvis, a head that lifts and nods, arms with mirrored balls; a stand that stays.

    The stand is where the rest belongs when it is moved 2 m away. Without `blended` every vertex follows
    one link.
    """
    names = tuple(row[0] for row in DOFS)
    link_names = tuple(row[0] for row in LINKS)
    parts = [ellipsoid(np.array(row[2]), np.array(row[3])) for row in LINKS]
    offsets = np.cumsum([0, *(len(vertices) for vertices, _ in parts[:-1])])
    skins = [
        share(row, vertices, link_names, blended) for row, (vertices, _) in zip(LINKS, parts, strict=True)
    ]
    kinds = np.array([row[1] for row in DOFS], dtype=np.int64)
    parents = np.array([names.index(row[2]) if row[2] else -1 for row in DOFS], dtype=np.int64)
    axes, points = np.array([row[3] for row in DOFS]), np.array([row[4] for row in DOFS])
    link_dofs = np.array([names.index(row[1]) if row[1] else -1 for row in LINKS], dtype=np.int64)
    return BodyModel(
        name="puppet",
        dof_names=names,
        kinds=kinds,
        parents=parents,
        axes=axes,
        points=points,
        rest_spreads=np.ones(len(kinds)),
        limits=np.array([row[5] for row in DOFS]),
        balls=find_balls(kinds, parents, axes, points, link_dofs),
        link_names=link_names,
        link_dofs=link_dofs,
        vertices=np.concatenate([vertices for vertices, _ in parts]),
        triangles=np.concatenate([faces + start for (_, faces), start in zip(parts, offsets, strict=True)]),
        skin_links=np.concatenate([which for which, _ in skins]),
        skin_weights=np.concatenate([weights for _, weights in skins]),
        joint_names=link_names,
        joint_links=np.arange(len(LINKS), dtype=np.int64),
        joint_points=np.array([row[2] for row in LINKS]),
    )


@cache
def flexible_puppet(blended: bool = True) -> BodyModel:
    """The puppet with three shape coefficients: its size, the length of its arms, and its girth."""
    model = puppet(blended)
    arms = np.isin(model.link_names, ("l_upper", "l_fore", "r_upper", "r_fore"))
    shoulder = np.array([0.0, -0.3, 0.0])

    def directions(points: Array, of_arm: Mask) -> Array:
        longer = np.where(of_arm[:, None], (points - shoulder) * (0.0, 0.7, 0.0), 0.0)
        wider = points * (0.5, 0.0, 0.3)
        return np.array([points, longer, wider])

    carriers = np.array([name[2:5] in ("elb", "arm") for name in model.dof_names])
    return with_shape(
        model,
        ("size", "reach", "width"),
        np.array([0.1, 0.2, 0.15]),
        directions(model.vertices, arms[model.skin_links[:, 0]]),
        directions(model.points, carriers),
        directions(model.joint_points, arms[model.joint_links]),
    )


def ellipsoid(centre: Array, radii: Array) -> tuple[Array, Indices]:
    """Vertices (V, 3) and triangles (T, 3), counter-clockwise from outside."""
    ball = trimesh.creation.icosphere(subdivisions=2)
    return np.asarray(ball.vertices) * radii + centre, np.asarray(ball.faces, dtype=np.int64)


def share(
    row: tuple[str, str, tuple[float, ...], tuple[float, ...], str, tuple[float, ...]],
    vertices: Array,
    names: tuple[str, ...],
    blended: bool,
) -> tuple[Indices, Array]:
    """Links (V, 2) and weights (V, 2) of a part's vertices: its own, and its neighbour's near the joint."""
    name, _, _, _, neighbour, joint = row
    other = names.index(neighbour) if neighbour else names.index(name)
    apart = np.linalg.norm(vertices - np.array(joint), axis=1)
    weight = np.clip(0.45 * (1.0 - apart / BLEND_RADIUS), 0.0, None) * float(blended and bool(neighbour))
    links = np.tile(np.array([names.index(name), other], dtype=np.int64), (len(vertices), 1))
    return links, np.stack([1.0 - weight, weight], axis=1)


def random_body(rng: np.random.Generator) -> BodyModel:
    """A random tree of single axes, translations and balls of either hand, with skin on every link.

    Sometimes a link depends on the middle of three rotations through one point, which are no ball then.
    """
    kinds: list[int] = []
    parents: list[int] = []
    axes: list[Array] = []
    points: list[Array] = []
    ends = [-1]
    for _ in range(int(rng.integers(1, 6))):
        parent, point = int(rng.choice(ends)), rng.normal(size=3)
        basis = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.choice([1.0, -1.0])  # of either hand
        ball = rng.random() < 0.5
        for a in range(3 if ball else 1):
            parents.append(parent if a == 0 else len(kinds) - 1)
            kinds.append(ROTATION if ball or rng.random() < 0.7 else TRANSLATION)
            axes.append(basis[a])
            points.append(point)
            if a < 2 and rng.random() < 0.15:
                ends.append(len(kinds) - 1)
        if ends[-1] != len(kinds) - 1:
            ends.append(len(kinds) - 1)
    count = len(kinds)
    arrays = (
        np.array(kinds, dtype=np.int64),
        np.array(parents, dtype=np.int64),
        np.array(axes),
        np.array(points),
    )
    weights = rng.random((12, 2))
    return BodyModel(
        name="random",
        dof_names=tuple(f"dof_{j}" for j in range(count)),
        kinds=arrays[0],
        parents=arrays[1],
        axes=arrays[2],
        points=arrays[3],
        rest_spreads=np.ones(len(kinds)),
        limits=np.tile([-np.inf, np.inf], (count, 1)),
        balls=find_balls(*arrays, np.array(ends, dtype=np.int64)),
        link_names=tuple(f"link_{end}" for end in ends),
        link_dofs=np.array(ends, dtype=np.int64),
        vertices=rng.normal(size=(12, 3)),
        triangles=rng.integers(12, size=(5, 3)),
        skin_links=rng.integers(len(ends), size=(12, 2)),
        skin_weights=weights / weights.sum(axis=1, keepdims=True),
        joint_names=("first", "last"),
        joint_links=np.array([0, len(ends) - 1], dtype=np.int64),
        joint_points=rng.normal(size=(2, 3)),
    )


def moves(model: BodyModel) -> Mask:
    """Which degree of freedom moves which link (D, L)."""
    table = np.zeros((len(model.dof_names), len(model.link_names)), dtype=bool)
    for link, last in enumerate(model.link_dofs):
        dof = int(last)
        while dof >= 0:
            table[dof, link] = True
            dof = int(model.parents[dof])
    return table


@cache
def person(stature: float = 1.75) -> BodyModel:
    """The human template with the 24 degrees of freedom of the paper's section 5."""
    template = human(stature)
    return activate(template, DEFAULT_ACTIVE, np.zeros(len(template.dof_names)))


@cache
def hinges() -> BodyModel:
    """Two hinges in a row, an arm of a metre each: two degrees of freedom that simply add."""
    return BodyModel(
        name="hinges",
        dof_names=("upper", "lower"),
        kinds=np.array([ROTATION, ROTATION], dtype=np.int64),
        parents=np.array([-1, 0], dtype=np.int64),
        axes=np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]]),
        points=np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
        rest_spreads=np.ones(2),
        limits=np.tile([-np.inf, np.inf], (2, 1)),
        balls=np.zeros(0, dtype=np.int64),
        link_names=("upper", "lower"),
        link_dofs=np.array([0, 1], dtype=np.int64),
        vertices=np.array([[0.0, 1.0, 0.0], [0.0, 2.0, 0.0], [0.1, 2.0, 0.0]]),
        triangles=np.array([[0, 1, 2]], dtype=np.int64),
        skin_links=np.array([[0], [1], [1]], dtype=np.int64),
        skin_weights=np.ones((3, 1)),
        joint_names=("elbow", "hand"),
        joint_links=np.array([0, 1], dtype=np.int64),
        joint_points=np.array([[0.0, 1.0, 0.0], [0.0, 2.0, 0.0]]),
    )
