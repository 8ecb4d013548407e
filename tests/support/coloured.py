"""People in colour: one who raises the left arm, and several in different clothes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.frame import Frame, View
from gepf.common.kinematics import pose_vertices
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.synthesis.clothes import dress
from gepf.coordinator.synthesis.rendering import ColouredSurface, DepthRenderer
from tests.support.people import CAMERA, STANDING, changed, raised, shown
from tests.support.recordings import write_open3d

BACKGROUND, LIGHT = np.array([0.6, 0.6, 0.5]), np.array([0.3, -0.5, -1.0])


@cache
def coloured() -> list[Frame]:
    """The frames of `shown("standing")` with colour."""
    model, frames = human(1.82), list[Frame]()
    clothes, plain = dress(model, np.random.default_rng(0)), shown("standing").frames
    with DepthRenderer(CAMERA) as renderer:
        for number, frame in enumerate(plain):
            pose = name_pose(model, raised(STANDING, number))
            surface = ColouredSurface(pose_vertices(model, pose[None])[0], model.triangles, clothes)
            image = renderer.colours(surface, BACKGROUND, LIGHT)
            frames.append(changed(frame, colours=image))
    return frames


def write_coloured(folder: Path, colour: str = "color") -> Path:
    """The frames as a recording in the format of Open3D's recorders, with a start pose."""
    write_open3d(folder, np.stack([frame.views[0].depth for frame in coloured()]), CAMERA)
    (folder / colour).mkdir()
    for frame in coloured():
        (view,) = frame.views
        assert view.colours is not None
        Image.fromarray(view.colours).save(folder / colour / f"{frame.number:06d}.png")
    return folder


class Dressed(NamedTuple):
    """A person in clothes: colours (V, 3), from 0 to 1."""

    model: BodyModel
    clothes: Array


class Place(NamedTuple):
    """Who stands where: `x_m` metres to the right, with the left arm as high as in frame `raised`."""

    person: Dressed
    x_m: float
    raised: int


@cache
def dressed(seed: int) -> Dressed:
    """A person of 1.75 m in random clothes."""
    model = human(1.75)
    return Dressed(model, dress(model, np.random.default_rng(seed)))


def pictures(scenes: Sequence[Sequence[Place]], fps: float) -> list[Frame]:
    """Frames that show these people, each 2.7 m away."""
    rng, frames = np.random.default_rng(0), list[Frame]()
    with DepthRenderer(CAMERA) as renderer:
        for number, people in enumerate(scenes):
            depth = np.zeros((CAMERA.height, CAMERA.width))
            colours = np.tile(255.0 * BACKGROUND, (*depth.shape, 1))
            for (model, clothes), x_m, frame in people:
                pose = name_pose(model, raised({**STANDING, "root_tx": x_m}, frame))
                vertices = pose_vertices(model, pose[None])[0]
                seen = renderer.depth(vertices, model.triangles)
                surface = ColouredSurface(vertices, model.triangles, clothes)
                nearer = (seen > 0.0) & ((depth == 0.0) | (seen < depth))
                depth[nearer] = seen[nearer]
                colours[nearer] = renderer.colours(surface, BACKGROUND, LIGHT)[nearer]
            noisy = np.clip(colours + rng.normal(0.0, 4.0, colours.shape), 0, 255).astype(np.uint8)
            units = np.rint(1000.0 * depth).astype(np.uint16)
            frames.append(Frame.of(View(number, number / fps, units, 1000.0, CAMERA, colours=noisy)))
    return frames
