"""Depth images from OpenGL's z-buffer, without a display: pyrender on EGL.

pyrender's camera has pixel edges at integers, ours has pixel centres there: they differ by half a pixel. Its
usual pass uses a sample of a multisampled buffer that is not at the centre of the pixel (0.4 px away under
Mesa). The segmentation pass renders one sample per pixel, at the centre.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices
from gepf.common.body import vertex_normals
from gepf.common.camera import Intrinsics
from gepf.common.closing import Closing
from gepf.common.errors import GepfError
from gepf.common.packages import MissingPackage, needs


class Rendering(msgspec.Struct, frozen=True):
    """What is drawn, and in which light."""

    near_m: float = 0.2  #: with a 24-bit buffer, depth is exact to 1.5 um at 2 m, 40 um at 10 m
    far_m: float = 20.0
    ambient: float = 0.35  #: light on coloured surfaces from everywhere
    brightness: float = 3.0  #: from one direction
    filled_share: float = 0.85  #: of the image, by a body that is fitted into it
    min_distance_m: float = 0.8  #: of such a body


RENDERING = Rendering()
OPENGL_FROM_CAMERA = np.array([1.0, -1.0, -1.0])  # OpenGL looks along -z, with y up


@dataclass(frozen=True, slots=True, eq=False)
class ColouredSurface:
    """A surface in the camera frame, metres, with the colours of its vertices."""

    vertices: Array  # (V, 3)
    triangles: Indices  # (T, 3) counter-clockwise from outside
    colours: Array  # (V, 3) from 0 to 1


class DepthRenderer(Closing):
    """Renders closed surfaces to depth images. Use it as a context manager, one at a time."""

    def __init__(self, camera: Intrinsics) -> None:
        """Open an OpenGL context; raises GepfError with a remedy if that fails."""
        self.camera = camera
        os.environ["PYOPENGL_PLATFORM"] = "egl"
        os.environ["PYGLET_HEADLESS"] = "1"
        try:
            with needs("synth", "rendering"):
                import pyrender

            self._renderer = pyrender.OffscreenRenderer(camera.width, camera.height)
        except MissingPackage:
            raise
        except Exception as error:  # EGL, PyOpenGL, pyrender and the loader raise different ones
            remedy = "on Debian or Ubuntu: apt install libegl1 libgl1"
            raise GepfError(f"OpenGL through EGL does not start ({error}); {remedy}") from error
        self._pyrender = pyrender

    def depth(self, vertices: NDArray[np.floating], triangles: NDArray[np.integer]) -> NDArray[np.float32]:
        """Depth (H, W) in metres of a surface with vertices (V, 3) in the camera frame, 0 elsewhere.

        Triangles (T, 3) are counter-clockwise from outside; back faces are not drawn.
        """
        pyrender = self._pyrender
        surface = pyrender.Primitive(
            positions=(vertices * OPENGL_FROM_CAMERA).astype(np.float32), indices=triangles.astype(np.uint32)
        )
        scene = pyrender.Scene()
        node = scene.add(pyrender.Mesh([surface]))
        scene.add(self._lens())
        _, depth = self._renderer.render(scene, pyrender.RenderFlags.SEG, {node: (255, 255, 255)})
        return np.ascontiguousarray(depth, dtype=np.float32)

    def colours(self, surface: ColouredSurface, background: Array, light: Array) -> NDArray[np.uint8]:
        """The image (H, W, 3), RGB, of a surface in the light from a direction (3,), camera frame.

        Elsewhere is the colour `background` (3,), from 0 to 1.
        """
        pyrender = self._pyrender
        primitive = pyrender.Primitive(
            positions=(surface.vertices * OPENGL_FROM_CAMERA).astype(np.float32),
            normals=(vertex_normals(surface.vertices, surface.triangles) * OPENGL_FROM_CAMERA),
            indices=surface.triangles.astype(np.uint32),
            color_0=np.column_stack([surface.colours, np.ones(len(surface.colours))]).astype(np.float32),
            material=pyrender.MetallicRoughnessMaterial(metallicFactor=0.0, roughnessFactor=0.9),
        )
        scene = pyrender.Scene(ambient_light=[RENDERING.ambient] * 3, bg_color=background)
        scene.add(pyrender.Mesh([primitive]))
        scene.add(self._lens())
        towards = np.eye(4)
        back = light * OPENGL_FROM_CAMERA / np.linalg.norm(light)
        side = np.cross([0.0, 1.0, 0.0], back)
        side /= np.linalg.norm(side)
        towards[:3, :3] = np.column_stack([side, np.cross(back, side), back])
        scene.add(pyrender.DirectionalLight(intensity=RENDERING.brightness), pose=towards)
        image, _ = self._renderer.render(scene)
        return np.ascontiguousarray(image, dtype=np.uint8)

    def _lens(self) -> Any:
        """The camera as pyrender's."""
        at, drawn = self.camera, RENDERING
        return self._pyrender.IntrinsicsCamera(
            at.fx, at.fy, at.cx + 0.5, at.cy + 0.5, znear=drawn.near_m, zfar=drawn.far_m
        )

    def close(self) -> None:
        """Release the OpenGL context."""
        self._renderer.delete()


def fit_in_view(points: Array, camera: Intrinsics) -> Array:
    """Shift (3,) that centres points (n, 3) in the image, and brings them as near as they fit into it."""
    low, high = points.min(axis=0), points.max(axis=0)
    wide = np.max((high - low)[:2] / (camera.width / camera.fx, camera.height / camera.fy))
    front = max(RENDERING.min_distance_m, float(wide) / RENDERING.filled_share)
    middle: Array = np.array([*(0.5 * (low + high)[:2]), low[2] - front])
    return -middle
