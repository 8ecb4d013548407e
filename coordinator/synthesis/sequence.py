"""Sequences with ground truth, rendered with OpenGL's z-buffer."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image

from gepf.common.arrays import Array
from gepf.common.body import TRANSLATION, BodyModel
from gepf.common.bounds import MAX_CAMERAS
from gepf.common.errors import InputError, check_choice
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.coordinator.bodies.choice import load_body
from gepf.coordinator.files import CAMERA_FILE, START_FILE, TRUTH_FILE, with_parent, write_json
from gepf.coordinator.scene.noise import SensorNoise
from gepf.coordinator.sources.camera import write_camera
from gepf.coordinator.sources.rig import RIG_FILE, RigCamera, write_rig
from gepf.coordinator.sources.source import to_units
from gepf.coordinator.synthesis.noise import add_noise
from gepf.coordinator.synthesis.person_scene import person, two
from gepf.coordinator.synthesis.rendering import DepthRenderer
from gepf.coordinator.synthesis.scenes import SCENES, Roam, Scene, roam
from gepf.coordinator.synthesis.surround import Seen, furnished, surround

ROAM, PERSON, TWO = "roam", "person", "two"
Surface = tuple[NDArray[np.floating], NDArray[np.integer]]
DEPTH_SCALE = 10_000.0  # units per metre: steps of 0.1 mm, up to 6.55 m


def synthesise(  # noqa: PLR0913 one parameter an option
    scene: str,
    out: Path,
    frames: int | None = None,
    noise_depth: float | None = None,
    noise_lateral: float | None = None,
    seed: int = 0,
    advance: Callable[[int, int], None] | None = None,
    *,
    model: str | None = None,
    kinect: bool = False,
    cameras: int = 1,
    apart: float = 90.0,
    late: float | None = None,
    room: bool = False,
) -> None:
    """Write the first `frames` of a scene as a sequence folder with truth and start.

    With several `cameras`, each has a folder, and rig.json lists them. They are around the person, `apart`
    degrees from each other, and each takes its images `late` milliseconds after those of the one before.
    `room` adds floor, ceiling and walls.

    Noise is Gaussian with the given standard deviations in metres; with `kinect`, that of a Kinect is added.
    Scene `roam` moves the body `model` randomly, by `seed`. `advance(done, total)` is called after each
    frame. The folder is created only when it is complete. Raises InputError for an unknown scene, a number
    out of range, or a folder that is in use; GepfError if OpenGL does not start.
    """
    for kind, value in (("depth", noise_depth), ("lateral", noise_lateral)):
        if value is not None and not 0.0 <= value <= 1.0:
            raise InputError(f"{kind} noise of {value} m is not valid; choose from 0 to 1 metre")
    noise = SensorNoise(noise_depth or 0.0, noise_lateral or 0.0)
    if seed < 0:
        raise InputError(f"seed {seed} is negative; choose 0 or more")
    late = late or 0.0
    if not (1 <= cameras <= MAX_CAMERAS and 0.0 <= late < 1000.0):
        raise InputError(
            f"{cameras} cameras, {late:g} ms late, are not valid; choose 1 to {MAX_CAMERAS}, 0 to 1000 ms"
        )
    shown = find_scene(scene, model, seed, frames)
    shown = furnished(shown) if room else shown
    one = Seen("", shown, np.eye(4), 0.0)
    views = list(surround(shown, cameras, apart, late / 1000.0)) if cameras > 1 else [one]
    done, total = count(1), len(views) * len(shown.poses)
    out = Path(out)
    with_parent(out)
    unfinished = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
    try:
        for n, view in enumerate(views):
            folder = unfinished / view.name
            for _ in write_depth(view.scene, noise, seed + n, folder / "depth", kinect=kinect):
                if advance is not None:
                    advance(next(done), total)
            write_facts(view.scene, folder)
        if cameras > 1:
            listed = [RigCamera(v.name, v.name, v.T_rig_camera.tolist(), v.offset_s) for v in views]
            write_rig(unfinished / RIG_FILE, listed)
        unfinished.chmod(0o755)
        unfinished.replace(out)
    except BaseException:
        shutil.rmtree(unfinished, ignore_errors=True)
        raise


def write_facts(scene: Scene, folder: Path) -> None:
    """Write camera, truth of everybody and start into a folder."""
    write_camera(folder / CAMERA_FILE, scene.camera, DEPTH_SCALE, scene.fps)
    write_truth(scene, folder / TRUTH_FILE)
    for number, other in enumerate(scene.others, 2):
        write_truth(other, folder / f"truth-person{number}.npz")
    if scene.start is not None:
        write_start(scene.model, scene.start, folder / START_FILE)


def find_scene(name: str, model: str | None, seed: int, frames: int | None) -> Scene:
    """The scene with a name, with the requested number of frames; InputError lists the choices."""
    check_choice("scene", name, (*SCENES, PERSON, TWO, ROAM))
    if name == ROAM:
        if model is None:
            raise InputError(f"scene {ROAM} moves any body; add --model with a URDF file, or human")
        frames = Roam().frames if frames is None else frames
        scene = roam(load_body(model), seed, frames if frames > 0 else Roam().frames)
    elif model is not None:
        raise InputError(f"scene {name} has a body of its own; leave --model out, or give scene {ROAM}")
    else:
        scene = person(seed) if name == PERSON else two() if name == TWO else SCENES[name]()
    if frames is None:
        return scene
    if not 1 <= frames <= len(scene.poses):
        raise InputError(f"cannot make {frames} frames; choose from 1 to {len(scene.poses)}")
    others = tuple(replace(each, poses=each.poses[:frames]) for each in scene.others)
    return replace(scene, poses=scene.poses[:frames], others=others)


def write_depth(
    scene: Scene, noise: SensorNoise, seed: int, folder: Path, *, kinect: bool = False
) -> Iterator[int]:
    """Write depth/000000.png and so on, and yield the number of each.

    The noise of a frame depends only on the seed and its number.
    """
    folder.mkdir(parents=True)
    for number, depth_m in enumerate(render(scene)):
        noisy = add_noise(depth_m, scene.camera, noise, np.random.default_rng([seed, number]), kinect=kinect)
        Image.fromarray(to_units(noisy, DEPTH_SCALE)).save(folder / f"{number:06d}.png")
        yield number


def render(scene: Scene) -> Iterator[Array]:
    """Exact depth (H, W) in metres of every frame."""
    with DepthRenderer(scene.camera) as renderer:
        for number in range(len(scene.poses)):
            surfaces = [
                (pose_vertices(each.model, each.poses[number, None])[0], each.model.triangles)
                for each in (scene, *scene.others)
            ]
            surfaces += [] if scene.room is None else [scene.room]
            whole = trimesh.util.append_faces(*zip(*surfaces, strict=True))
            yield renderer.depth(*whole).astype(np.float64)


def write_truth(scene: Scene, file: Path) -> None:
    """Write names and values of all degrees of freedom and joints of every frame."""
    np.savez_compressed(
        file,
        frame=np.arange(len(scene.poses)),
        dof_names=np.array(scene.model.dof_names),
        pose=scene.poses,
        slides=np.array([scene.model.dof_names[j] for j in np.flatnonzero(scene.model.kinds == TRANSLATION)]),
        joint_names=np.array(scene.model.joint_names),
        joint_positions=joint_positions(scene.model, scene.poses),
    )


def write_start(model: BodyModel, pose: Array, file: Path) -> None:
    """Write the start pose (D,); zeros are omitted."""
    start = {name: float(value) for name, value in zip(model.dof_names, pose, strict=True) if value}
    write_json(file, start)
