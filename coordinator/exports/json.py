"""JSON: the same fields as `track.npz`, for programs that do not read numpy's files."""

from __future__ import annotations

from dataclasses import fields
from typing import BinaryIO

import msgspec
import numpy as np

from coordinator.results.track import Track


def write_json(track: Track, file: BinaryIO) -> None:
    """One object with the keys of `track.npz`; the padding of hypotheses is null."""
    content = {field.name: np.asarray(getattr(track, field.name)).tolist() for field in fields(Track)}
    file.write(msgspec.json.encode(content))
