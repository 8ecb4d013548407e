"""A film in real time and a contact sheet from the pictures of a run."""

from __future__ import annotations

import io
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from PIL import Image

from gepf.common.arrays import Array
from gepf.coordinator.files import write_atomically

TICK_S = Fraction(1, 1000)
"""Resolution of time in a film: milliseconds."""


def write_film(pictures: Iterable[Image.Image], size: tuple[int, int], times_s: Array, file: Path) -> None:
    """Write pictures of one even size (width, height), each shown from its time (F,) to the next."""
    encoded = io.BytesIO()
    with av.open(encoded, "w", format="mp4") as film:
        stream = film.add_stream("libx264", options={"preset": "veryfast"})
        stream.width, stream.height = size
        stream.pix_fmt, stream.codec_context.time_base = "yuv420p", TICK_S
        for picture, time_s in zip(pictures, times_s - times_s[0], strict=True):
            frame = av.VideoFrame.from_ndarray(np.asarray(picture), format="rgb24")
            frame.pts, frame.time_base = round(float(time_s) / TICK_S), TICK_S
            film.mux(stream.encode(frame))
        film.mux(stream.encode(None))
    write_atomically(file, lambda opened: opened.write(encoded.getbuffer()))


def save_png(picture: Image.Image, file: Path) -> None:
    """Write one picture."""
    write_atomically(file, lambda opened: picture.save(opened, "PNG"))


def spread(count: int, wanted: int) -> list[int]:
    """At most `wanted` positions out of `count`, evenly distributed, with the first and the last."""
    return sorted(set(np.rint(np.linspace(0, count - 1, min(count, wanted))).astype(int).tolist()))


def tile(pictures: list[Image.Image]) -> Image.Image:
    """Pictures of one size in three rows, row by row; fewer than five in one row."""
    width, height = pictures[0].size
    columns = -(-len(pictures) // 3) if len(pictures) > 4 else len(pictures)
    sheet = Image.new("RGB", (columns * width, -(-len(pictures) // columns) * height))
    for i, picture in enumerate(pictures):
        sheet.paste(picture, (i % columns * width, i // columns * height))
    return sheet
