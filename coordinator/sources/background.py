"""The room without people, from a frame, a picture or a recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gepf.common.errors import InputError
from gepf.coordinator.sources import Source, open_source
from gepf.coordinator.sources.camera import GivenCamera
from gepf.coordinator.sources.picture_folders import read_depth
from gepf.coordinator.sources.source import measured


def read_background(asked: str, source: Source | None) -> NDArray[np.float32]:
    """Depth (H, W) in metres of an empty room, 0 if unknown, from a frame, a picture or a recording."""
    if asked.isdigit():
        if source is None:
            raise InputError("--background with a frame's number is for recorded sequences; give a sequence")
        if int(asked) not in source.numbers:
            last = source.numbers[-1]
            raise InputError(f"--background {asked} is not a frame; give {source.numbers[0]} to {last}")
        return source.view(int(asked)).metres()
    path = Path(asked)
    if path.suffix.lower() == ".png" and source is not None:
        first = source.view(source.numbers[0])
        empty = np.asarray(measured(read_depth(path)) / np.float32(first.depth_scale), dtype=np.float32)
        empty = empty[:, ::-1] if source.mirrored else empty
    else:
        empty = averaged(open_source(path, GivenCamera(mirrored=None if source is None else source.mirrored)))
    if source is not None:
        check_size(asked, empty, (source.intrinsics.height, source.intrinsics.width))
    return empty


def check_size(name: str | None, room: NDArray[np.float32] | None, shape: tuple[int, ...]) -> None:
    """InputError if the room without people has another size than the frames (H, W)."""
    if room is not None and room.shape != shape:
        sizes = f"{room.shape[1]}x{room.shape[0]}, but the frames are {shape[1]}x{shape[0]}"
        raise InputError(f"--background {name} is {sizes}; give one of the same size")


def averaged(source: Source) -> NDArray[np.float32]:
    """The median of the measured depth (H, W) in some frames, metres."""
    chosen = np.unique(np.linspace(0, len(source.numbers) - 1, 30).astype(int)).tolist()
    depths = np.array([source.view(source.numbers[n]).metres() for n in chosen])
    ordered = np.sort(np.where(depths > 0.0, depths, np.inf), axis=0)
    middle = np.minimum(np.count_nonzero(depths, axis=0) // 2, len(depths) - 1)
    found = np.take_along_axis(ordered, middle[None], axis=0)[0]
    return np.where(np.isfinite(found), found, 0.0).astype(np.float32)
