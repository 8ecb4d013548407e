"""A body in any size: linear in girth between two bodies, and as a whole in stature."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.bounds import LARGEST_LENGTH
from common.errors import ProtocolError

Array = NDArray[np.float64]
Size = tuple[float, float]  # share of the way from the slim body to the thick one, and scale

BODIES_KEPT = 16  # of one body, in the sizes that were asked for last: two people may share it
MOST_VERTICES = 2**16  # of a body that comes in sizes
ORIGIN = "_origin"  # of a body that was made in a size: what it is a size of, and which
MOVED = ("vertices", "points", "joint_points")  # what differs between sizes


class Sizes:
    """All sizes of a body; those that were asked for last are kept.

    Args:
        slim: The body, of the usual girth.
        thick: The same body, thicker: of it only what differs counts.

    Raises:
        ProtocolError: They are not the same body, or a very large one.
    """

    def __init__(self, slim: BodyModel, thick: BodyModel) -> None:
        if any(getattr(slim, name).shape != getattr(thick, name).shape for name in MOVED):
            raise ProtocolError("the thicker body is another one")
        if len(slim.vertices) > MOST_VERTICES:
            raise ProtocolError(f"a body of more than {MOST_VERTICES} vertices comes in one size")
        self.slim, self.thick = slim, thick
        self._made: OrderedDict[Size, BodyModel] = OrderedDict()

    def body(self, size: Size) -> BodyModel:
        """The body of a size. ProtocolError if it is larger than anything may be."""
        if size not in self._made:
            self._made[size] = self._make(*size)
        self._made.move_to_end(size)
        while len(self._made) > BODIES_KEPT:
            self._made.popitem(last=False)
        return self._made[size]

    def _make(self, share: float, scale: float) -> BodyModel:
        """A new body, which remembers what it is a size of: so it need not be sent whole."""
        moved = {}
        for name in MOVED:
            slim, thick = getattr(self.slim, name), getattr(self.thick, name)
            moved[name] = (slim + share * (thick - slim)) * scale
            if not np.abs(moved[name]).max(initial=0.0) <= LARGEST_LENGTH:
                raise ProtocolError("the body is too large in this size")
        made = replace(self.slim, **moved)
        vars(made)[ORIGIN] = self, (share, scale)
        return made


@dataclass(frozen=True, slots=True, eq=False)
class Sized:
    """A body for each of N particles, of these sizes (N, 2); the last few can be done without in a hurry."""

    bodies: Sizes
    sizes: Array
    spare: int = 0


class Part(NamedTuple):
    """Particles start..stop-1, which have the same body."""

    model: BodyModel
    start: int
    stop: int


Body = BodyModel | Sized
"""What particles have: all the same body, or each a size of its own."""


def as_sizes(body: Body, particles: int) -> Body:
    """The body of so many particles, as sizes of others if it was made as one."""
    origin = vars(body).get(ORIGIN) if isinstance(body, BodyModel) else None
    return body if origin is None else Sized(origin[0], np.tile(origin[1], (particles, 1)))


def parts_of(body: Body, particles: int) -> Iterator[Part]:
    """The bodies of so many particles in their order, neighbours of the same size together."""
    if isinstance(body, BodyModel):
        yield Part(body, 0, particles)
        return
    changes = np.flatnonzero(np.any(body.sizes[1:] != body.sizes[:-1], axis=1)) + 1
    ends = [0, *changes.tolist(), particles]
    for start, stop in pairwise(ends):
        share, scale = body.sizes[start].tolist()
        yield Part(body.bodies.body((share, scale)), start, stop)
