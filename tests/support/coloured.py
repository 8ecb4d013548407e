"""A person who raises the left arm, in colour."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image

from gepf.common.frame import Frame
from gepf.common.kinematics import pose_vertices
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.synthesis.clothes import dress
from gepf.coordinator.synthesis.rendering import ColouredSurface, DepthRenderer
from tests.support.people import CAMERA, STANDING, changed, raised, shown
from tests.support.recordings import write_open3d


@cache
def coloured() -> list[Frame]:
    """The frames of `shown("standing")` with colour."""
    model, frames = human(1.82), list[Frame]()
    clothes, plain = dress(model, np.random.default_rng(0)), shown("standing").frames
    with DepthRenderer(CAMERA) as renderer:
        for number, frame in enumerate(plain):
            pose = name_pose(model, raised(STANDING, number))
            surface = ColouredSurface(pose_vertices(model, pose[None])[0], model.triangles, clothes)
            image = renderer.colours(surface, np.array([0.6, 0.6, 0.5]), np.array([0.3, -0.5, -1.0]))
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
