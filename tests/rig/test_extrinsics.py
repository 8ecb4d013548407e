"""Camera poses of other tools, written in their conventions, through the command line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.coordinator.cli import main
from tests.support.rigs import around
from tests.support.stand_ins import no_workers

WORLD, FRONT_TO_SIDE = around(-35.0), around(70.0)  # T_world_front, T_front_side
FRONT, SIDE = WORLD, WORLD @ FRONT_TO_SIDE


def kalibr(folder: Path) -> Path:
    """camchain-imucam.yaml: T_cn_cnm1 maps from the camera before; clocks relative to the IMU's."""
    back = json.dumps(np.linalg.inv(FRONT_TO_SIDE).tolist())
    text = "cam0:\n  camera_model: pinhole\n  timeshift_cam_imu: 0.004\n"
    text += f"cam1:\n  T_cn_cnm1: {back}\n  timeshift_cam_imu: 0.0165\n"
    (folder / "camchain.yaml").write_text(text)
    return folder / "camchain.yaml"


def transform(parent: str, child: str, placed: Array) -> str:
    """A transform as `ros2 topic echo` prints it; half-turns about y are enough for these rotations."""
    half = 0.5 * np.arctan2(placed[0, 2], placed[0, 0])
    x, y, z = placed[:3, 3]
    return (
        f"- header:\n    stamp:\n      sec: 0\n      nanosec: 0\n    frame_id: {parent}\n"
        f"  child_frame_id: {child}\n  transform:\n"
        f"    translation:\n      x: {x}\n      y: {y}\n      z: {z}\n"
        f"    rotation:\n      x: 0.0\n      y: {np.sin(half)}\n      z: 0.0\n      w: {np.cos(half)}\n"
    )


def ros(folder: Path) -> Path:
    """Two messages of /tf_static; one camera's frame is itself placed by a chain of two."""
    link = np.eye(4)
    link[:3, 3] = [0.1, -0.2, 0.3]
    text = "transforms:\n" + transform("world", "front_link", FRONT @ np.linalg.inv(link))
    text += transform("front_link", "front_depth_optical_frame", link)
    text += transform("front_link", "front_color_optical_frame", np.eye(4))
    text += "---\ntransforms:\n" + transform("world", "side", SIDE) + "---\n"
    (folder / "tf.yaml").write_text(text)
    return folder / "tf.yaml"


def matrices(folder: Path) -> Path:
    """One file for each camera, as text and as numpy writes it."""
    (folder / "matrices").mkdir()
    np.savetxt(folder / "matrices/front.txt", FRONT)
    np.save(folder / "matrices/side.npy", SIDE)
    return folder / "matrices"


@pytest.fixture
def recordings(tmp_path: Path) -> list[str]:
    """Recordings of two cameras."""
    for name in ("front", "side"):
        np.savez(
            tmp_path / f"{name}.npz",
            depth=np.full((2, 6, 8), 2.0, np.float32),
            intrinsics=np.array([[10.0, 0.0, 4.0], [0.0, 10.0, 3.0], [0.0, 0.0, 1.0]]),
        )
    return [str(tmp_path / f"{name}.npz") for name in ("front", "side")]


@pytest.mark.parametrize(("write", "clock_s"), [(kalibr, 0.0125), (ros, 0.0), (matrices, 0.0)])
def test_a_rig_has_the_places_of_another_tool(
    write: Callable[[Path], Path], clock_s: float, recordings: list[str], tmp_path: Path
) -> None:
    """The side camera is where the tool says it is relative to the front one, and so is its clock."""
    out = tmp_path / "rig.json"
    given = str(write(tmp_path))
    assert main(["calibrate", *recordings, "--from", given, "--out", str(out)], no_workers) == 0
    front, side = json.loads(out.read_text())["cameras"]
    assert np.allclose(front["T_rig_camera"], np.eye(4))
    assert np.allclose(side["T_rig_camera"], FRONT_TO_SIDE, atol=1e-9)
    assert side["time_offset_s"] == pytest.approx(clock_s)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("cam0: {}\n", "has no cam1 for side"),
        ("cam0: {}\ncam1: {T_cn_cnm1: [1, 2]}\n", "is not a readable calibration; give Kalibr's"),
        ("cam0: {}\ncam1: {T_cn_cnm1: [[2,0,0,0],[0,2,0,0],[0,0,2,0],[0,0,0,1]]}\n", "not a rotation"),
        ("{", "is not a readable calibration"),
        ("transforms:\n" + transform("a", "front", FRONT), "has no frame side or side_depth_optical_frame"),
        (
            "transforms:\n" + transform("a", "front", FRONT) + transform("b", "side", SIDE),
            "does not connect the frames",
        ),
    ],
)
def test_what_is_wrong_with_a_calibration(
    content: str, says: str, recordings: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line says it, and no rig is written."""
    (tmp_path / "given.yaml").write_text(content)
    out = tmp_path / "rig.json"
    given = str(tmp_path / "given.yaml")
    assert main(["calibrate", *recordings, "--from", given, "--out", str(out)], no_workers) == 2
    assert says in capsys.readouterr().err
    assert not out.exists()
