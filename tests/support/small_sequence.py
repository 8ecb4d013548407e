"""A sequence that is tracked very fast: the paper's arm, forth and back, with a tiny image."""

from __future__ import annotations

from pathlib import Path

import numpy as np

MOVING = "r_shoulder_flexion,r_shoulder_abduct,r_shoulder_twisting,r_elbow_flexion"
OPTIONS = ("--dof", MOVING, "--preset", "paper", "--points", "200", "--particles", "12")


def write_small_sequence(folder: Path, frames: int) -> None:
    """Depth, camera and start; the start is that of the first frame."""
    from gepf.common.camera import Intrinsics
    from gepf.coordinator.scene.noise import SensorNoise
    from gepf.coordinator.sources.camera import write_camera
    from gepf.coordinator.synthesis.scenes import Scene, arm
    from gepf.coordinator.synthesis.sequence import DEPTH_SCALE, write_depth, write_start

    whole = arm()
    there = np.arange(frames) % (2 * len(whole.poses) - 2)
    poses = whole.poses[np.minimum(there, 2 * len(whole.poses) - 2 - there)]
    scene = Scene(whole.model, Intrinsics(64, 64, 98.75, 98.75, 31.5, 31.5), 25.0, poses, poses[0].copy())
    folder.mkdir(parents=True)
    list(write_depth(scene, SensorNoise(0.0, 0.0), 0, folder / "depth"))
    write_camera(folder / "camera_intrinsic.json", scene.camera, DEPTH_SCALE, scene.fps)
    write_start(scene.model, poses[0], folder / "init.json")
