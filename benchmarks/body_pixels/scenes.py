"""Depth images of people among furniture, drawn at random, in which every pixel is labelled."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import trimesh

from benchmarks.furniture.footage import look_at
from benchmarks.furniture.parts import Part, Range, Surface, block, circle, joined, post, room
from benchmarks.furniture.people import LEG_LINKS, SIZES, Posed, draw_measures, posed
from benchmarks.furniture.seats import box_for, chair_for, seat_down, wheelchair_for
from benchmarks.furniture.situations import SITS, SITUATIONS, Situation, size_of
from gepf.common.arrays import Array, Mask
from gepf.common.body import BodyModel, vertex_normals
from gepf.common.camera import Intrinsics, back_project, inverse, moved
from gepf.common.errors import GepfError
from gepf.coordinator.bodies.human.template import human_of
from gepf.coordinator.bodies.human.typical_poses import people_poses
from gepf.coordinator.synthesis.noise import SensorModel, as_a_kinect
from gepf.coordinator.synthesis.rendering import DepthRenderer

CAMERAS = (
    Intrinsics(512, 424, 365.0, 365.0, 255.5, 211.5),
    Intrinsics(320, 240, 285.0, 285.0, 159.5, 119.5),
    Intrinsics(320, 240, 230.0, 230.0, 159.5, 119.5),
)
SENSORS = (SensorModel(), SensorModel(jump_m=0.1), SensorModel(step=1e-3, lateral_px=0.5, jump_m=0.05))
DISTANCE_M: Range = (0.6, 4.2)  # of the camera from the middle of the person
HEIGHT_M: Range = (0.3, 2.6)  # of the camera above the floor
ASIDE_M = 0.5  # by which the camera looks past the middle of the person, in each direction; many are cut
EMPTY_SHARE = 0.25  # of images without the room
WALLS_M: Range = (1.2, 3.2)
CEILING_M = 2.6
AROUND_M = 0.7  # of a person, within which pixels count
SAME_M = 0.01  # a surface that is this much behind is not the one that is seen
SEATED_SHARE = 0.55  # of people who use furniture; the others are in any pose near it
DRESSED_SHARE = 0.6
OTHERS_SHARE = 0.3  # of people beside whom there is another one
THICKEST_M = 0.05  # of clothes, without folds
FOLDS, FOLD_M, FOLD_WIDTH_M = 20, 0.015, (0.04, 0.2)  # most, deviation of their height, and their width
PILE_SHARE, PILE = 0.3, (6, 25)  # of scenes with a pile of small things, and their number
VIEWS = 2  # images of a scene


@dataclass(frozen=True, slots=True, eq=False)
class LabelledImage:
    """A depth image (H, W) in metres, and its pixels (H, W) of people, furniture and the room nearby."""

    depth: Array
    camera: Intrinsics
    people: Mask
    furniture: Mask
    room: Mask


def draw_images(rng: np.random.Generator) -> Iterator[LabelledImage]:
    """Images of one scene from several sides; none if no motion of the arms is free."""
    try:
        situation = draw_using(rng) if rng.random() < SEATED_SHARE else draw_beside(rng)
    except GepfError:
        return
    bodies = [dressed(body, rng) for body in (situation.person, *situation.others)]
    middle = situation.person.joints[-1].mean(axis=0)
    walls, triangles = room(rng.uniform(*WALLS_M, 4).tolist(), CEILING_M)
    people = stacked(bodies)
    surfaces = {"people": people, "room": (walls + middle * (1.0, 0.0, 1.0), triangles)}
    if situation.furniture:
        surfaces["furniture"] = joined(situation.furniture)
    camera = CAMERAS[rng.integers(len(CAMERAS))]
    with DepthRenderer(camera) as renderer:
        for _ in range(VIEWS):
            azimuth, height = rng.uniform(0.0, 360.0), rng.uniform(*HEIGHT_M)
            distance = np.exp(rng.uniform(*np.log(DISTANCE_M)))
            seen = middle + rng.uniform(-ASIDE_M, ASIDE_M, 3)
            back = inverse(look_at(seen, azimuth, distance, height))
            shows_room = rng.random() > EMPTY_SHARE
            depths = {
                name: renderer.depth(moved(shape[0], back), shape[1]).astype(np.float64)
                for name, shape in surfaces.items()
                if shows_room or name != "room"
            }
            exact = np.min([np.where(depth > 0.0, depth, np.inf) for depth in depths.values()], axis=0)
            exact[np.isinf(exact)] = 0.0
            depth = as_a_kinect(exact, camera, rng, SENSORS[rng.integers(len(SENSORS))])
            near = is_near(depth, camera, moved(people[0], back)) & (depth > 0.0)
            shown = {name: near & (alone > 0.0) & (alone < exact + SAME_M) for name, alone in depths.items()}
            furniture = shown.get("furniture", np.zeros_like(near)) & ~shown["people"]
            bare = shown.get("room", np.zeros_like(near)) & ~shown["people"] & ~furniture
            yield LabelledImage(depth, camera, shown["people"], furniture, bare)


def is_near(depth: Array, camera: Intrinsics, surface: Array) -> Mask:
    """Which pixels (H, W) are in the box around a surface (V, 3), enlarged by `AROUND_M`."""
    points = back_project(depth, camera)
    low, high = surface.min(axis=0) - AROUND_M, surface.max(axis=0) + AROUND_M
    return np.asarray(np.all((points > low) & (points < high), axis=-1))


def draw_using(rng: np.random.Generator) -> Situation:
    """A person who uses furniture, some of them with things beside."""
    name = list(SITUATIONS)[rng.integers(len(SITUATIONS))]
    size = size_of(name, int(rng.integers(len(SIZES))))
    drawn = SITUATIONS[name](human_of(draw_measures(*SIZES[size], rng)), 2, rng)
    if rng.random() < 0.4:
        drawn.furniture.extend(draw_clutter(drawn.person, rng))
    return drawn


def draw_beside(rng: np.random.Generator) -> Situation:
    """A person in any pose of the library, upright on the floor, beside things and an empty seat."""
    model = any_person(rng)
    poses = people_poses(model)
    person = Posed(model, poses[rng.integers(len(poses))][None].copy())
    person.shift(y=-float(person.vertices[..., 1].max()))
    things = list(draw_clutter(person, rng))
    if rng.random() < 0.5:
        sitter = posed(any_person(rng), SITS, 1, rng)
        seat = seat_down(sitter, float(rng.uniform(0.4, 0.5)))
        make = (chair_for, box_for, wheelchair_for)[rng.integers(3)]
        turn, side = rng.uniform(0.0, 2.0 * np.pi, 2)
        away = rng.uniform(0.3, 0.9) * np.array([np.sin(side), 0.0, np.cos(side)])
        c, s = np.cos(turn), np.sin(turn)
        rotation = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        things += [
            Part(part.vertices @ rotation.T + away, part.triangles) for part in make(sitter, seat, rng)
        ]
    others = list[Posed]()
    while rng.random() < OTHERS_SHARE:
        other = Posed(any_person(rng), poses[rng.integers(len(poses))][None].copy())
        around, far = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.4, 1.2)
        other.shift(x=far * np.sin(around), y=-float(other.vertices[..., 1].max()), z=far * np.cos(around))
        others.append(other)
    return Situation(person, things, tuple(others))


def any_person(rng: np.random.Generator) -> BodyModel:
    """A person of any size."""
    return human_of(draw_measures(*list(SIZES.values())[rng.integers(len(SIZES))], rng))


def draw_clutter(person: Posed, rng: np.random.Generator) -> Iterator[Part]:
    """Up to four boxes, cushions and posts that touch a person or are nearby, in some scenes also a pile."""
    low, high = person.vertices[-1].min(axis=0), person.vertices[-1].max(axis=0)
    if rng.random() < PILE_SHARE:
        yield from draw_pile(low, high, rng)
    for _ in range(rng.integers(5)):
        wide, deep = rng.uniform(0.05, 0.8, 2)
        bottom = rng.choice([0.0, rng.uniform(0.0, 1.4)])
        top = bottom + rng.uniform(0.05, 1.2)
        gap, along, side = rng.choice([0.0, rng.uniform(0.0, 0.4)]), rng.uniform(-0.4, 0.4), rng.integers(4)
        if side < 2:  # left, right
            x = (low[0] - gap - wide, low[0] - gap) if side == 0 else (high[0] + gap, high[0] + gap + wide)
            z = (along - 0.5 * deep, along + 0.5 * deep)
        else:  # before, behind
            x = (along - 0.5 * wide, along + 0.5 * wide)
            z = (low[2] - gap - deep, low[2] - gap) if side == 2 else (high[2] + gap, high[2] + gap + deep)
        kind = rng.random()
        if kind < 0.6:
            yield block(x, z, (bottom, top))
        elif kind < 0.75:
            yield cushion(x, z, (bottom, top))
        else:
            yield post(0.5 * (x[0] + x[1]), 0.5 * (z[0] + z[1]), (bottom, top))


def draw_pile(low: Array, high: Array, rng: np.random.Generator) -> Iterator[Part]:
    """Small things close together, as on a desk or in shelves, beside a person between these corners (3,)."""
    around, far = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.2, 1.0)
    middle = 0.5 * (low + high) + 0.5 * (high - low + 2.0 * far) * np.array(
        [np.sin(around), 0.0, np.cos(around)]
    )
    spread, top = rng.uniform(0.1, 0.5, 2), rng.uniform(0.5, 2.0)
    for _ in range(rng.integers(*PILE)):
        x, z = middle[[0, 2]] + spread * rng.uniform(-1.0, 1.0, 2)
        wide, deep, tall = 0.5 * np.exp(rng.uniform(np.log(0.03), np.log(0.5), 3))
        y = rng.uniform(0.0, top)
        sides = (x - wide, x + wide), (z - deep, z + deep), (max(0.0, y - tall), y + tall)
        kind = rng.random()
        yield block(*sides) if kind < 0.5 else cushion(*sides) if kind < 0.8 else post(x, z, sides[2])


def cushion(x: Range, z: Range, height: Range) -> Part:
    """A rounded thing: an ellipsoid in the box of these sides."""
    ring = circle(1.0)
    sphere = np.array(
        [(np.cos(a) * p[0], np.sin(a), np.cos(a) * p[1]) for a in np.linspace(-1.5, 1.5, 9) for p in ring]
    )
    low, high = np.array([x[0], -height[1], z[0]]), np.array([x[1], -height[0], z[1]])
    return Part.around(0.5 * (low + high) + 0.5 * (high - low) * sphere)


def dressed(person: Posed, rng: np.random.Generator) -> Surface:
    """The last surface of a person; most wear clothes with folds, some of them a skirt as well."""
    vertices, triangles = person.vertices[-1], person.model.triangles
    if rng.random() > DRESSED_SHARE:
        return vertices, triangles
    thickness = draw_thickness(person, rng)
    parts = [(vertices + thickness[:, None] * vertex_normals(vertices, triangles), triangles)]
    if rng.random() < 0.3:
        covered = ("pelvis", "thigh") if rng.random() < 0.5 else ("pelvis", *LEG_LINKS)
        hull = trimesh.convex.convex_hull(person.surface(*covered)[-1])
        parts.append((np.asarray(hull.vertices), np.asarray(hull.faces)))
    return stacked(parts)


def draw_thickness(person: Posed, rng: np.random.Generator) -> Array:
    """The thickness (V,) of clothes, metres: different on each link, and with folds."""
    model, vertices = person.model, person.vertices[-1]
    of_links = THICKEST_M * rng.random() * rng.uniform(0.2, 1.0, int(model.skin_links.max()) + 1)
    thickness = np.sum(model.skin_weights * of_links[model.skin_links], axis=1)
    for _ in range(rng.integers(FOLDS + 1)):
        off = vertices - vertices[rng.integers(len(vertices))]
        width_m = rng.uniform(*FOLD_WIDTH_M)
        thickness += rng.normal(0.0, FOLD_M) * np.exp(-0.5 * np.sum(off**2, axis=1) / width_m**2)
    return np.asarray(np.maximum(thickness, 0.0))


def stacked(surfaces: list[Surface]) -> Surface:
    """All surfaces as one."""
    vertices, triangles = trimesh.util.append_faces(*zip(*surfaces, strict=True))
    return np.asarray(vertices), np.asarray(triangles)
