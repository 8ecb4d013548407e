"""Draws the film of the README, docs/person.gif: depth, the body over it, and the hypotheses.

gepf synth person --seed 1 --kinect --room --out SEQ && gepf track SEQ --out RUN
python -m benchmarks.readme_film SEQ RUN docs/person.gif
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

import gepf
from gepf.coordinator.palette import PALETTE
from gepf.coordinator.pictures.film import tile
from gepf.coordinator.pictures.overlay import DRAWING, draw_skeleton, paint, project_joints, view_around
from gepf.coordinator.pictures.shading import shade_depth
from gepf.coordinator.results.track import read_track, read_tracked_body

FRAMES = slice(30, 59)
HEIGHT = 300  # pixels
COLOURS = 128
STEP_MS = 100  # between frames of the sequence
FAINT, STRONG = 110, 255  # opacity of unlikely and likely hypotheses


def triples(sequence: Path, run: Path) -> Iterator[Image.Image]:
    """For each frame the depth image, the same with the body, and all hypotheses."""
    source, model = gepf.open_source(sequence), read_tracked_body(run).model
    finer = DRAWING.finer
    track = read_track(run).part(FRAMES)
    view = view_around(track, source.intrinsics, finer * HEIGHT, finer * HEIGHT)
    for at, number in enumerate(track.frame.tolist()):
        plain = shade_depth(source.view(number).metres(), source.intrinsics)
        weights = track.hypothesis_weight[at]
        likely_last = np.argsort(weights)[: np.isfinite(weights).sum()]
        skeletons = Image.new("RGB", (view.width, view.height), PALETTE.background)
        draw = ImageDraw.Draw(skeletons, "RGBA")
        for n in likely_last:
            (pixels,) = project_joints(model, track.hypothesis_pose[at, n][None], view.intrinsics)
            opacity = round(FAINT + (STRONG - FAINT) * weights[n] / weights[likely_last[-1]])
            draw_skeleton(draw, model, pixels, (*PALETTE.hypotheses, opacity), finer)
        parts = (view.cut(plain).reduce(finer), paint(plain, view, model, track, at), skeletons.reduce(finer))
        triple = Image.new("RGB", (len(parts) * parts[0].width, parts[0].height))
        for n, part in enumerate(parts):
            triple.paste(part, (n * part.width, 0))
        yield triple


def main(sequence: Path, run: Path, file: Path) -> None:
    """Write the film in real time, with one palette for all pictures."""
    pictures = list(triples(sequence, run))
    palette = tile(pictures).quantize(COLOURS)
    first, *others = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in pictures]
    first.save(file, save_all=True, append_images=others, duration=STEP_MS, loop=0, optimize=True)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
