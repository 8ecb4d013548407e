"""An animated GIF that stays small enough to send around."""

from __future__ import annotations

import io

from PIL import Image

LARGEST_BYTES = 5_000_000
COLOURS = 128
SHRINK = 0.8


def encode_gif(pictures: list[Image.Image], seconds_each: float, largest: int = LARGEST_BYTES) -> bytes:
    """An endless GIF of pictures of one size, made smaller until it has at most `largest` bytes."""
    while True:
        data = encode(pictures, seconds_each)
        width, height = pictures[0].size
        if len(data) <= largest or min(width, height) < 64:
            return data
        size = (round(width * SHRINK), round(height * SHRINK))
        pictures = [picture.resize(size, Image.Resampling.LANCZOS) for picture in pictures]


def encode(pictures: list[Image.Image], seconds_each: float) -> bytes:
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
