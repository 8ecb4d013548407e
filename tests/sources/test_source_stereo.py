"""Stereo pairs: a textured person before a textured wall, rendered for both eyes, matched and tracked."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from common.camera import Intrinsics, back_project
from common.kinematics import pose_vertices
from coordinator.bodies.tracked import name_pose
from coordinator.sources import find_format, open_source
from coordinator.synthesis.rendering import DepthRenderer
from tests.support.recordings import RAISING, START, full_body, matrix_of
from tests.support.refusals import refused

Array = NDArray[np.float64]

CAMERA = Intrinsics(640, 480, 571.0, 571.0, 319.5, 239.5)
BASELINE_M, WALL_M = 0.12, 4.5
FRAMES = 3


def texture(points: Array) -> NDArray[np.uint8]:
    """Grey values (...) of a fine random pattern that fills space: a body's skin and a wall alike."""
    rng = np.random.default_rng(0)
    waves = rng.normal(size=(24, 3))
    waves *= (rng.uniform(40.0, 250.0, 24) / np.linalg.norm(waves, axis=1))[:, None]
    total = np.cos(points @ waves.T + rng.uniform(0, 2 * np.pi, 24)).sum(axis=-1)
    grey: Array = np.clip(128.0 + 22.0 * total, 0, 255)
    return grey.astype(np.uint8)


@cache
def truth() -> Array:
    """Poses (F, D) of the person with all degrees of freedom."""
    model = full_body()
    return np.array(
        [name_pose(model, START | {name: rate * n for name, rate in RAISING.items()}) for n in range(FRAMES)]
    )


@cache
def pictures() -> list[tuple[NDArray[np.uint8], NDArray[np.uint8]]]:
    """Left and right pictures of every frame."""
    model = full_body()
    pairs = []
    with DepthRenderer(CAMERA) as renderer:
        for vertices in pose_vertices(model, truth()):
            eyes = []
            for shift in (0.0, BASELINE_M):
                offset = np.array([shift, 0.0, 0.0])
                depth = renderer.depth(vertices - offset, model.triangles)
                depth = np.where(depth > 0, depth, np.float32(WALL_M))
                eyes.append(texture(back_project(depth, CAMERA) + offset))
            pairs.append((eyes[0], eyes[1]))
    return pairs


def write_calibration(path: Path, **changes: Any) -> None:
    """OpenCV's own file; a value of None leaves an entry out."""
    entries: dict[str, Any] = {
        "M1": matrix_of(CAMERA), "D1": np.zeros((1, 5)), "M2": matrix_of(CAMERA), "D2": np.zeros((1, 5)),
        "R": np.eye(3), "T": np.array([[-BASELINE_M], [0.0], [0.0]]), "fps": 25.0,
    }  # fmt: skip
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in (entries | changes).items():
        if value is not None:
            storage.write(name, value)
    storage.release()


@pytest.fixture
def pairs(tmp_path: Path) -> Path:
    """A folder of stereo pairs."""
    path = tmp_path / "pairs"
    for side in ("left", "right"):
        (path / side).mkdir(parents=True)
    for n, (left, right) in enumerate(pictures()):
        Image.fromarray(left).save(path / "left" / f"{n:03d}.png")
        Image.fromarray(right).save(path / "right" / f"{n:03d}.png")
    write_calibration(path / "calibration.yml")
    return path


def test_depth_is_that_of_the_left_camera(pairs: Path) -> None:
    """Nearly all of the person is matched, within two centimetres at the median; the wall as well."""
    assert find_format(pairs).name == "stereo pairs (left/, right/, calibration.yml)"
    source = open_source(pairs)
    assert (len(source), source.fps) == (FRAMES, 25.0)
    np.testing.assert_allclose(matrix_of(source.intrinsics), matrix_of(CAMERA), atol=1.0)
    with DepthRenderer(source.intrinsics) as renderer:
        true = renderer.depth(pose_vertices(full_body(), truth()[:1])[0], full_body().triangles)
    frame = source.frame(0)
    assert frame.intrinsics == source.intrinsics
    both = (frame.depth > 0) & (true > 0)
    assert np.count_nonzero(both) > 0.85 * np.count_nonzero(true)
    assert np.median(np.abs(frame.metres() - true)[both]) < 0.02
    wall = frame.metres()[(frame.depth > 0) & (true == 0)]
    assert np.median(wall) == pytest.approx(WALL_M, abs=0.05)


Damage = Callable[[Path], object]


def remove(name: str) -> Damage:
    """Delete a file."""
    return lambda path: (path / name).unlink()


def replace(name: str, content: bytes) -> Damage:
    """Write other bytes."""
    return lambda path: (path / name).write_bytes(content)


def calibrated(**changes: Any) -> Damage:
    """Write another calibration."""
    return lambda path: write_calibration(path / "calibration.yml", **changes)


def shrink(name: str) -> Damage:
    """A picture of another size."""
    return lambda path: Image.fromarray(np.zeros((48, 64), np.uint8)).save(path / name)


def clear(path: Path) -> None:
    """Remove all pictures."""
    for file in [*path.glob("left/*"), *path.glob("right/*")]:
        file.unlink()


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (remove("calibration.yml"), "holds stereo pairs but no calibration.yml; write it with M1, D1"),
        (replace("calibration.yml", b"M1: ["), "calibration.yml is damaged or not OpenCV's file storage"),
        (replace("calibration.yml", b""), "calibration.yml"),
        (calibrated(M2=None), "M2 is missing or not 3 x 3"),
        (calibrated(T=np.zeros((2, 1))), "T is missing or not 3 x 1"),
        (calibrated(M1=np.full((3, 3), np.nan)), "a number is not finite"),
        (calibrated(T=np.array([[BASELINE_M], [0.0], [0.0]])), "exchange left and right"),
        (calibrated(T=np.zeros((3, 1))), "not one of two cameras side by side; calibrate again"),
        (remove("right/001.png"), "right has no picture 001, though the other side has"),
        (remove("left/002.png"), "left has no picture 002, though the other side has"),
        (clear, "left holds no picture"),
        (replace("left/000.png", b"PNG"), "000.png is damaged or no picture"),
        (replace("right/002.png", b""), "002.png is damaged or no picture"),
        (shrink("right/001.png"), "001.png is 64x48, the first picture 640x480; all must have one size"),
    ],
)
def test_a_damaged_recording_is_reported_in_one_line(pairs: Path, damage: Damage, says: str) -> None:
    """Calibration, pairs and pictures; the line names the file and the mend."""
    damage(pairs)
    with refused() as raised:
        read_all(pairs)
    assert says in str(raised.value)


def read_all(path: Path) -> None:
    """Open a sequence and read every frame."""
    list(open_source(path))
