"""Pictures of a run put together: a film in real time, a small animation, a contact sheet."""

from __future__ import annotations

import io
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from common.camera import Intrinsics
from coordinator.files import write_atomically
from coordinator.pictures.overlay import View

TICKS = 1000
"""Of a second: pictures are shown at the millisecond at which they were taken."""

QUALITY = "23"


def whole_view(camera: Intrinsics) -> View:
    """The camera's whole image; of an odd size, which H.264 cannot have, without the last row or column."""
    return View(camera, 0, 0, camera.width - camera.width % 2, camera.height - camera.height % 2, 1.0)


def write_film(
    pictures: Iterable[Image.Image], size: tuple[int, int], times_s: NDArray[np.float64], file: Path
) -> None:
    """Write pictures of one even size (width, height), each shown from its time (F,) until the next one's."""
    encoded, times_s = io.BytesIO(), times_s - times_s[0]
    with av.open(encoded, "w", format="mp4") as film:
        stream = film.add_stream("libx264", rate=30, options={"crf": QUALITY, "preset": "veryfast"})
        stream.width, stream.height = size
        stream.pix_fmt, stream.codec_context.time_base = "yuv420p", Fraction(1, TICKS)
        for picture, time_s in zip(pictures, times_s.tolist(), strict=True):
            frame = av.VideoFrame.from_ndarray(np.asarray(picture), format="rgb24")
            frame.pts, frame.time_base = round(time_s * TICKS), Fraction(1, TICKS)
            film.mux(stream.encode(frame))
        film.mux(stream.encode(None))
    write_atomically(file, lambda opened: opened.write(encoded.getbuffer()))


LARGEST_BYTES = 5_000_000
COLOURS = 128
SHRINK = 0.8


def encode_gif(pictures: list[Image.Image], seconds_each: float, largest: int = LARGEST_BYTES) -> bytes:
    """An endless GIF of pictures of one size, made smaller until it has at most `largest` bytes."""
    while True:
        data = encode_at_this_size(pictures, seconds_each)
        width, height = pictures[0].size
        if len(data) <= largest or min(width, height) < 64:
            return data
        size = (round(width * SHRINK), round(height * SHRINK))
        pictures = [picture.resize(size, Image.Resampling.LANCZOS) for picture in pictures]


def encode_at_this_size(pictures: list[Image.Image], seconds_each: float) -> bytes:
    """A GIF with one palette for all pictures, so that what stands still costs nothing."""
    palette = common_palette(pictures)
    first, *others = (p.quantize(palette=palette, dither=Image.Dither.NONE) for p in pictures)
    buffer = io.BytesIO()
    duration = max(20, round(seconds_each * 1000.0))  # players slow down what is faster
    first.save(buffer, "GIF", save_all=True, append_images=others, duration=duration, loop=0, optimize=False)
    return buffer.getvalue()


def common_palette(pictures: list[Image.Image]) -> Image.Image:
    """The colours that suit some pictures out of all."""
    some = pictures[:: max(1, len(pictures) // 8)]
    width, height = some[0].size
    strip = Image.new("RGB", (width, height * len(some)))
    for i, picture in enumerate(some):
        strip.paste(picture, (0, i * height))
    return strip.quantize(COLOURS, method=Image.Quantize.MEDIANCUT)


GAP = 4  # pixels
GROUND = (9, 11, 15)


def spread(count: int, wanted: int) -> list[int]:
    """At most `wanted` positions out of `count`, evenly spread, the first and the last among them."""
    return sorted(set(np.rint(np.linspace(0, count - 1, min(count, wanted))).astype(int).tolist()))


def tile(pictures: list[Image.Image], columns: int) -> Image.Image:
    """Pictures of one size side by side, row by row."""
    width, height = pictures[0].size
    columns = min(columns, len(pictures))
    rows = -(-len(pictures) // columns)
    sheet = Image.new("RGB", (columns * (width + GAP) + GAP, rows * (height + GAP) + GAP), GROUND)
    for i, picture in enumerate(pictures):
        row, column = divmod(i, columns)
        sheet.paste(picture, (GAP + column * (width + GAP), GAP + row * (height + GAP)))
    return sheet
