"""What of a scene is tracked, as the command line says it: who, how near, how far, where, before what."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.errors import InputError
from coordinator.commands.track_options import SceneOptions
from coordinator.scene.candidates import WAYS, Person
from coordinator.scene.scope import Limits, Scope, up_in_picture
from coordinator.sources import Source, open_source
from coordinator.sources.picture_folders import read_depth

AVERAGED = 30  # frames of an empty room at the most


def choose_scope(options: SceneOptions) -> Scope:
    """What the options ask for, but for the background; InputError for what makes no sense."""
    for option, value in (("--near", options.near), ("--far", options.far)):
        if value is not None and not 0.0 < value < math.inf:
            raise InputError(f"{option} {value:g} is no distance; give metres above 0")
    if options.near is not None and options.far is not None and not options.near < options.far:
        raise InputError(f"--near {options.near:g} is not below --far {options.far:g}; nothing would count")
    region = None
    if options.roi is not None:
        left, top, right, bottom = numbers("--roi", options.roi, 4)
        region = (left, top, right, bottom)
        if not (left < right and top < bottom):
            raise InputError(f"--roi {options.roi} holds no pixel; give left,top,right,bottom")
    person = Person(options.person)
    if options.person not in WAYS:
        if "," not in options.person:
            choices = ", ".join(WAYS[1:])
            raise InputError(f"--person {options.person} is unknown; give X,Y in pixels or one of {choices}")
        column, row = numbers("--person", options.person, 2)
        person = Person(pixel=(column, row))
    return Scope(Limits(options.near, options.far, region), person)


def numbers(option: str, asked: str, count: int) -> tuple[int, ...]:
    """Whole numbers between commas."""
    try:
        found = tuple(int(each) for each in asked.split(","))
    except ValueError:
        found = ()
    if len(found) != count:
        raise InputError(f"{option} {asked} is not understood; give {count} whole numbers between commas")
    return found


def complete_scope(
    scope: Scope, background: str | None, source: Source | None, rotate_deg: int | None
) -> Scope:
    """The scope with background and way up; InputError if the background does not fit.

    No source for live input. `rotate_deg` is by how much the camera is said to be turned; a recording's
    gravity knows better.
    """
    up = None if rotate_deg is None else up_in_picture(np.radians(rotate_deg))
    if source is not None and source.gravity is not None:
        up = -source.gravity
    empty = None if background is None else read_background(background, source)
    return replace(scope, background=empty, up=up)


def read_background(asked: str, source: Source | None) -> NDArray[np.float32]:
    """Depth (H, W) in metres of an empty room, 0 where that is not known."""
    if asked.isdigit():
        number = int(asked)
        if source is None:
            raise InputError("--background with a frame's number is for recorded sequences; give a sequence")
        if number not in source.numbers:
            last = source.numbers[-1]
            raise InputError(f"--background {number}: the frames are {source.numbers[0]} to {last}")
        return source.frame(number).metres()
    path = Path(asked)
    if path.suffix.lower() == ".png" and source is not None:
        first = source.frame(source.numbers[0])
        depth = read_depth(path, source.intrinsics)
        return np.asarray(depth / np.float32(first.depth_scale), dtype=np.float32)
    empty = averaged(open_source(path))
    if source is not None and empty.shape != (source.intrinsics.height, source.intrinsics.width):
        size = f"{source.intrinsics.width}x{source.intrinsics.height}"
        raise InputError(f"--background {asked} is {empty.shape[1]}x{empty.shape[0]}, the sequence {size}")
    return empty


def averaged(source: Source) -> NDArray[np.float32]:
    """The median depth (H, W) of what was measured in some frames, metres."""
    chosen = np.unique(np.linspace(0, len(source.numbers) - 1, AVERAGED).astype(int)).tolist()
    depths = np.array([source.frame(source.numbers[n]).metres() for n in chosen])
    ordered = np.sort(np.where(depths > 0.0, depths, np.inf), axis=0)
    middle = np.count_nonzero(depths, axis=0) // 2
    found = np.take_along_axis(ordered, np.minimum(middle, len(depths) - 1)[None], axis=0)[0]
    return np.where(np.isfinite(found), found, 0.0).astype(np.float32)
