"""A film of a run as H.264 in MP4, which browsers and slides play, in real time, at the camera's size."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import BinaryIO

import av
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from common.camera import Intrinsics
from coordinator.files.atomic import write_atomically
from coordinator.pictures.view import View

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
    write_atomically(file, lambda opened: encode(pictures, size, times_s - times_s[0], opened))


def encode(
    pictures: Iterable[Image.Image], size: tuple[int, int], times_s: NDArray[np.float64], opened: BinaryIO
) -> None:
    """The film into an open file."""
    with av.open(opened, "w", format="mp4") as film:
        stream = film.add_stream("libx264", rate=30, options={"crf": QUALITY, "preset": "veryfast"})
        stream.width, stream.height = size
        stream.pix_fmt, stream.codec_context.time_base = "yuv420p", Fraction(1, TICKS)
        for picture, time_s in zip(pictures, times_s.tolist(), strict=True):
            frame = av.VideoFrame.from_ndarray(np.asarray(picture), format="rgb24")
            frame.pts, frame.time_base = round(time_s * TICKS), Fraction(1, TICKS)
            film.mux(stream.encode(frame))
        film.mux(stream.encode(None))
