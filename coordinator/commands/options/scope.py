"""What of a scene is tracked, as the command line says it: who, how near, how far, where, before what."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.errors import InputError
from common.frame import DepthFrame
from coordinator.commands.options.track_arguments import SceneOptions
from coordinator.scene.limits import Limits
from coordinator.scene.people.person import WAYS, Person
from coordinator.scene.scope import Scope, up_in_picture
from coordinator.sources import Source, open_source
from coordinator.sources.picture_folders import read_depth

AVERAGED = 30  # frames of an empty room at the most


@dataclass(frozen=True, slots=True)
class AskedScope:
    """The options, checked as far as they can be without the input."""

    limits: Limits = field(default_factory=Limits)
    person: Person = field(default_factory=Person)
    background: str | None = None

    def read(self, source: Source | None, rotate_deg: int | None = None) -> Scope:
        """With the background read; InputError if it does not fit. No source for live input.

        `rotate_deg` is by how much the camera is said to be turned; a recording's gravity knows better.
        """
        empty = None if self.background is None else read_background(self.background, source)
        return Scope(self.limits, self.person, empty, choose_up(source, rotate_deg))


def choose_up(source: Source | None, rotate_deg: int | None) -> NDArray[np.float64] | None:
    """Away from the ground (3,), camera frame: against gravity, or as the user says; else None."""
    if source is not None and source.gravity is not None:
        return -source.gravity
    return None if rotate_deg is None else up_in_picture(np.radians(rotate_deg))


def choose_scope(options: SceneOptions) -> AskedScope:
    """What the options ask for; InputError for what makes no sense."""
    for option, value in (("--near", options.near), ("--far", options.far)):
        if value is not None and not 0.0 < value < math.inf:
            raise InputError(f"{option} {value:g} is no distance; give metres above 0")
    if options.near is not None and options.far is not None and not options.near < options.far:
        raise InputError(f"--near {options.near:g} is not below --far {options.far:g}; nothing would count")
    region = None if options.roi is None else numbers("--roi", options.roi, 4)
    if region is not None and not (region[0] < region[2] and region[1] < region[3]):
        raise InputError(f"--roi {options.roi} holds no pixel; give left,top,right,bottom")
    limits = Limits(options.near, options.far, None if region is None else (*region[:2], *region[2:]))  # type: ignore[arg-type]
    return AskedScope(limits, choose_person(options.person), options.background)


def choose_person(asked: str) -> Person:
    """Who is meant; InputError names the choices."""
    if asked in WAYS:
        return Person(asked)
    if "," not in asked:
        raise InputError(f"--person {asked} is unknown; give X,Y in pixels or one of {', '.join(WAYS[1:])}")
    column, row = numbers("--person", asked, 2)
    return Person(pixel=(column, row))


def numbers(option: str, asked: str, count: int) -> list[int]:
    """Whole numbers between commas."""
    try:
        found = [int(each) for each in asked.split(",")]
    except ValueError:
        found = []
    if len(found) != count:
        raise InputError(f"{option} {asked} is not understood; give {count} whole numbers between commas")
    return found


def read_background(asked: str, source: Source | None) -> NDArray[np.float32]:
    """Depth (H, W) in metres of an empty room, 0 where that is not known."""
    if asked.isdigit():
        return numbered(int(asked), source)
    path = Path(asked)
    if path.suffix.lower() == ".png" and source is not None:
        first = source.frame(source.numbers[0])
        depth = read_depth(path, source.intrinsics)
        return np.asarray(depth / np.float32(first.depth_scale), dtype=np.float32)
    frames = open_source(path)
    empty = averaged(frames)
    if source is not None and empty.shape != (source.intrinsics.height, source.intrinsics.width):
        size = f"{source.intrinsics.width}x{source.intrinsics.height}"
        raise InputError(f"--background {asked} is {empty.shape[1]}x{empty.shape[0]}, the sequence {size}")
    return empty


def numbered(number: int, source: Source | None) -> NDArray[np.float32]:
    """A frame of the sequence itself."""
    if source is None:
        raise InputError("--background with a frame's number is for recorded sequences; give a sequence")
    if number not in source.numbers:
        last = source.numbers[-1]
        raise InputError(f"--background {number}: the frames are {source.numbers[0]} to {last}")
    return source.frame(number).metres()


def averaged(source: Source) -> NDArray[np.float32]:
    """The median depth (H, W) of what was measured in some frames, metres."""
    chosen = np.unique(np.linspace(0, len(source.numbers) - 1, AVERAGED).astype(int)).tolist()
    frames: list[DepthFrame] = [source.frame(source.numbers[n]) for n in chosen]
    depths = np.array([frame.metres() for frame in frames])
    ordered = np.sort(np.where(depths > 0.0, depths, np.inf), axis=0)
    middle = np.count_nonzero(depths, axis=0) // 2
    found = np.take_along_axis(ordered, np.minimum(middle, len(depths) - 1)[None], axis=0)[0]
    return np.where(np.isfinite(found), found, 0.0).astype(np.float32)
