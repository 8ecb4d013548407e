"""People of many sizes, posed in a room: x right, y down, z away; a person at rest faces -z."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import msgspec
import numpy as np

from benchmarks.furniture.parts import Range
from gepf.common.arrays import Array, Mask
from gepf.common.body import BodyModel
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.coordinator.bodies.human.measures import LENGTHS, Measures
from gepf.coordinator.synthesis.scenes import animate

Keys = dict[str, dict[int, float]]
"""Degree of freedom -> frame -> degrees."""
Ranges = Mapping[str, Range]


class Drawing(msgspec.Struct, frozen=True):
    """How people and their motion are drawn."""

    stature_deviation: float = 0.03  #: relative, from that of the list, at most twice
    girth_deviation: float = 0.05  #: the same
    length_deviation: float = 0.03  #: of a length from that implied by the stature, relative
    still: int = 10  #: frames before the first motion
    frames_per_move: tuple[int, int] = (9, 16)
    sway_deg: float = 1.5  #: of the trunk: 1 to 2 cm at the shoulders
    sway_frames: float = 40.0  #: period
    pressed_m: float = 0.006  #: by which a body is pressed into a seat
    deepest_m: float = 0.012  #: that a vertex may be inside of furniture
    tries: int = 400  #: motions of an arm


DRAWING = Drawing()

CHILD_OF_3 = (0.96, 1.0)
SIZES: Mapping[str, tuple[float, float]] = {
    "child of 6": (1.16, 1.0),
    "child of 12": (1.48, 1.0),
    "woman": (1.64, 1.0),
    "man": (1.78, 1.0),
    "tall": (1.94, 0.97),
    "heavy": (1.74, 1.35),
}
"""Stature in metres, and girth."""
ADULTS = ("woman", "man", "tall", "heavy")


ARM_LINKS = ("clavicle", "upper_arm", "forearm", "hand")
LEG_LINKS = ("thigh", "shank", "foot", "toes", "talus", "heel")


@dataclass(slots=True, eq=False)
class Posed:
    """A person with poses (F, D) in the room, whose surface is known."""

    model: BodyModel
    poses: Array

    @property
    def vertices(self) -> Array:
        """(F, V, 3)."""
        return pose_vertices(self.model, self.poses)

    @property
    def joints(self) -> Array:
        """(F, J, 3)."""
        return joint_positions(self.model, self.poses)

    def at(self, name: str) -> Array:
        """Places (F, 3) of a joint."""
        return np.asarray(self.joints[:, self.model.joint_names.index(name)])

    def surface(self, *links: str) -> Array:
        """Vertices (F, n, 3) of links, of both sides."""
        return np.asarray(self.vertices[:, self.on(*links)])

    def on(self, *links: str) -> Mask:
        """Which vertices (V,) belong to links, of either side."""
        parts = [name.removeprefix("l_").removeprefix("r_") for name in self.model.link_names]
        return np.isin(np.array(parts)[self.model.skin_links[:, 0]], links)

    @property
    def trunk(self) -> Array:
        """Vertices (F, n, 3) of all but limbs."""
        return np.asarray(self.vertices[:, ~self.on(*ARM_LINKS, *LEG_LINKS)])

    def shift(self, **metres: float) -> None:
        """Move the root in all frames."""
        for name, by in metres.items():
            self.poses[:, self.model.dof(f"root_t{name}")] += by


def draw_measures(stature: float, girth: float, rng: np.random.Generator) -> Measures:
    """A person of about this stature (metres) and girth, with lengths that differ from the usual ones."""
    off = np.clip(rng.standard_normal(2 + len(LENGTHS)), -2.0, 2.0)
    stature *= 1.0 + DRAWING.stature_deviation * off[0]
    girth *= 1.0 + DRAWING.girth_deviation * off[1]
    lengths = np.array(Measures.of(stature, girth).lengths) * (1.0 + DRAWING.length_deviation * off[2:])
    return Measures.of(stature, girth, **dict(zip(LENGTHS, lengths.tolist(), strict=True)))


def draw_from(ranges: Ranges, rng: np.random.Generator) -> dict[str, float]:
    """A value in each range."""
    return {name: float(rng.uniform(*limits)) for name, limits in ranges.items()}


def posed(
    model: BodyModel, legs_deg: Ranges, frames: int, rng: np.random.Generator, lean: Range = (-2, 8)
) -> Posed:
    """A person whose legs are still and whose trunk sways; thighs and shins may differ by side."""
    keys: Keys = {name: {0: v} for s in "lr" for name, v in prefixed(s, draw_from(legs_deg, rng)).items()}
    leans, phase = rng.uniform(*lean), rng.uniform(0.0, 2.0 * np.pi, 2)
    for name, mean, start in (("vl3_tilt", leans, phase[0]), ("vl3_roll", 0.0, phase[1])):
        turn = 2.0 * np.pi * np.arange(0, frames + 5, 5) / DRAWING.sway_frames
        keys[name] = dict(
            zip(
                range(0, frames + 5, 5),
                (mean + DRAWING.sway_deg * np.sin(turn + start)).tolist(),
                strict=True,
            )
        )
    return Posed(model, animate(model, filled(keys, frames))[:frames])


def prefixed(side: str, values: Mapping[str, float]) -> dict[str, float]:
    """Values of one side of the body."""
    return {f"{side}_{name}": value for name, value in values.items()}


def filled(keys: Keys, frames: int) -> Keys:
    """Keys in which constant values have a second key, at the end."""
    return {name: key if len(key) > 1 else {0: key[0], frames: key[0]} for name, key in keys.items()}


def mean_of(ranges: Ranges) -> dict[str, float]:
    """The middle of each range."""
    return {name: 0.5 * (low + high) for name, (low, high) in ranges.items()}


def tall(person: Posed) -> float:
    """The stature, metres, of the surface at rest."""
    return float(np.ptp(person.model.vertices[:, 1]))


def stout(person: Posed) -> float:
    """How much deeper the trunk is than an adult's of the same stature, at least 1."""
    rest = person.model.vertices[person.on("vl1", "vl3", "vl5", "vt8")]
    return max(1.0, float(np.ptp(rest[:, 2])) / tall(person) / 0.14)
