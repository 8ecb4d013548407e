"""An Azure Kinect's recording: camera, distortion and gravity against values computed by hand."""

from __future__ import annotations

import gc
import os
from pathlib import Path

import av
import numpy as np
import pytest

from gepf.common.camera import Intrinsics, points_of
from gepf.common.errors import InputError
from gepf.coordinator.results.track import read_track
from gepf.coordinator.sources import open_source
from gepf.coordinator.sources.azure_kinect import (
    Calibration,
    colour_camera,
    gravity_of,
    lens_of,
    read_calibration,
)
from gepf.coordinator.sources.camera import AS_RECORDED, GivenCamera
from tests.support.stand_ins import StillWorkers

RECORDING = Path(__file__).parents[3] / "shared" / "data" / "azure_kinect" / "recording.mkv"
RADIAL, TANGENTIAL = (0.5479, -0.0210, -0.00265, 0.8897, 0.0861, -0.0139), (2.06e-05, -7.2e-05)
LENS = Calibration([0.0, 0.0, 1.0, 1.0, *RADIAL, 0.0, 0.0, *TANGENTIAL[::-1]], 1.74, None)


@pytest.fixture(scope="module")
def recording() -> Path:
    """The recording beside the checkout."""
    if not RECORDING.exists():
        pytest.skip("no Azure Kinect recording beside the checkout")
    return RECORDING


def test_the_camera_is_the_sensors_cropped(recording: Path) -> None:
    """NFOV unbinned shows 640 x 576 from column 192, row 180 of 1024 x 1024; pixel centres are whole."""
    camera = open_source(recording).intrinsics
    assert (camera.width, camera.height) == (640, 576)
    assert camera.fx == pytest.approx(0.4927808940 * 1024)
    assert camera.fy == pytest.approx(0.4929028451 * 1024)
    assert camera.cx == pytest.approx(0.5129697919 * 1024 - 192 - 0.5)
    assert camera.cy == pytest.approx(0.5169235468 * 1024 - 180 - 0.5)


def test_frames_are_millimetres_from_time_zero(recording: Path) -> None:
    """Its depth frame is the same every time, between 0.19 and 3.7 m, mostly measured."""
    source = open_source(recording)
    frame = source.view(0)
    assert (frame.time_s, frame.depth_scale) == (0.0, 1000.0)
    assert np.array_equal(source.view(0).depth, frame.depth)
    metres = frame.metres()
    assert np.mean(metres > 0) > 0.8
    assert 0.1 < metres[metres > 0].min() < metres.max() < 4.0


@pytest.mark.parametrize("rotate", ["auto", "0", "90"])
def test_a_rotation_that_the_user_gives_is_stronger_than_the_accelerometer(
    recording: Path, tmp_path: Path, rotate: str
) -> None:
    """The vertical of the run is measured only if the user does not give the rotation."""
    options = ("--rotate", rotate, "--near", "0.5")
    assert StillWorkers().track(recording, tmp_path / "run", *options) in (0, 3)
    gravity, up = open_source(recording).gravity, read_track(tmp_path / "run").up
    assert gravity is not None
    assert up is not None
    turned = {"auto": -gravity, "0": np.array([0.0, -1.0, 0.0]), "90": np.array([-1.0, 0.0, 0.0])}
    np.testing.assert_allclose(up, turned[rotate], atol=1e-9)


def open_files(path: Path) -> int:
    """How often this process has a file open."""
    links = Path("/proc/self/fd").iterdir()
    return sum(os.path.realpath(link) == str(path) for link in links)


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="no /proc")
def test_the_file_is_closed_without_the_garbage_collector(recording: Path, tmp_path: Path) -> None:
    """After it is examined, after its last frame, when nobody needs the source, and after an error."""
    whole, cut = tmp_path / "whole.mkv", tmp_path / "cut.mkv"
    whole.write_bytes(recording.read_bytes())
    cut.write_bytes(recording.read_bytes()[:300_000])
    gc.disable()
    try:
        source = open_source(whole)
        assert open_files(whole) == 0
        source.frame(source.numbers[-1])
        assert open_files(whole) == 0
        source.frame(source.numbers[0])
        assert open_files(whole) <= 1
        del source
        assert open_files(whole) == 0
        for camera in (AS_RECORDED, GivenCamera((500.0, 501.0, 320.0, 288.0))):
            with pytest.raises(InputError):
                open_source(cut, camera).view(0)
        assert open_files(cut) == 0
    finally:
        gc.enable()


def test_gravity_is_what_the_accelerometer_says(recording: Path) -> None:
    """Its sample, (-2.888, -0.194, -9.437) in its own axes, turned back by the calibration and reversed."""
    turn = np.array(
        [
            [0.0019369830843, 0.1084766760468, -0.9940971136093],
            [-0.9999940395355, -0.0026388836559, -0.0022364303003],
            [-0.0028659072705, 0.9940955042839, 0.1084709167480],
        ]
    )
    upward = turn.T @ [-2.888193130493164, -0.19380511343479156, -9.43713665008545]
    gravity = open_source(recording).gravity
    assert gravity is not None
    assert np.allclose(gravity, -upward / np.linalg.norm(upward), atol=1e-6)
    assert gravity[1] > 0.97  # down in the picture


def test_a_given_camera_replaces_the_lens(recording: Path) -> None:
    """With --intrinsics the image stays as recorded; --depth-scale is applied, too."""
    source = open_source(recording, GivenCamera((500.0, 501.0, 320.0, 288.0), 500.0))
    assert source.intrinsics == Intrinsics(640, 576, 500.0, 501.0, 320.0, 288.0)
    assert source.view(0).depth_scale == 500.0


@pytest.mark.parametrize("kept", [5000, 300_000])
def test_a_cut_recording_is_one_line(recording: Path, tmp_path: Path, kept: int) -> None:
    """A truncated file is an input error that names the file."""
    cut = tmp_path / "cut.mkv"
    cut.write_bytes(recording.read_bytes()[:kept])
    with pytest.raises(InputError, match=r"not a Matroska file|holds no depth|truncated") as caught:
        open_source(cut).view(0)
    assert str(cut) in str(caught.value)


def test_the_lens_is_opencvs() -> None:
    """The same pixel for every pixel as OpenCV's undistortion of this lens, to rounding."""
    cv = pytest.importorskip("cv2", reason="OpenCV is not installed")
    camera = Intrinsics(320, 288, 252.3, 252.4, 166.0, 174.0)
    (k1, k2, k3, k4, k5, k6), (p1, p2) = RADIAL, TANGENTIAL
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
    terms = np.array([k1, k2, p1, p2, k3, k4, k5, k6])
    u, v = cv.initUndistortRectifyMap(matrix, terms, None, matrix, (320, 288), cv.CV_32FC1)
    depth = np.arange(320 * 288, dtype=np.uint32).reshape(288, 320)
    found = lens_of(LENS, camera).undistort(depth.astype(np.uint16))
    columns, rows = np.rint(u).astype(int), np.rint(v).astype(int)
    inside = (columns >= 0) & (columns < 320) & (rows >= 0) & (rows < 288)
    expected = np.where(inside, depth[np.clip(rows, 0, 287), np.clip(columns, 0, 319)], 0).astype(np.uint16)
    assert np.mean(found != expected) < 1e-3


def test_a_camera_without_samples_has_no_gravity() -> None:
    """At rest the ground pushes up and things fall the other way; without a sample it is not known."""
    calibration = Calibration(lens=[], radius=0.0, turn=np.eye(3).ravel().tolist())
    gravity = gravity_of(calibration, np.tile([0.0, -9.8, 0.0], (9, 1)))
    assert gravity is not None
    assert np.allclose(gravity, [0.0, 1.0, 0.0])
    assert gravity_of(calibration, np.empty((0, 3))) is None
    assert gravity_of(None, np.ones((9, 3))) is None


def test_colour_is_registered_by_the_factory_calibration(recording: Path) -> None:
    """Each pixel with depth has the colour of the place where OpenCV projects its point, and others none."""
    cv = pytest.importorskip("cv2", reason="OpenCV is not installed")
    frame = open_source(recording, color=True).view(0)
    assert open_source(recording).view(0).colours is None
    assert frame.colours is not None
    assert frame.colours.shape == (576, 640, 3)
    assert not frame.colours[frame.depth == 0].any()
    with av.open(str(recording)) as container:
        picture = next(container.decode(container.streams.video[0])).to_ndarray(format="rgb24")
        calibration = read_calibration(container, recording)
        assert calibration is not None
        camera = colour_camera(calibration, container.streams.video[0])
    assert camera is not None
    lens = camera.lens.camera
    assert (lens.fx, lens.fy) == pytest.approx((0.4779651165 * 1280, 0.6374239326 * 960))
    assert (lens.cx, lens.cy) == pytest.approx((0.4998471439 * 1280 - 0.5, 0.5066176057 * 960 - 120.5))
    points = points_of(frame.metres(), frame.intrinsics, frame.depth > 0)[::500].astype(np.float64)
    matrix = np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1.0]])
    turn, shift = cv.Rodrigues(camera.T_colour_depth[:3, :3])[0], camera.T_colour_depth[:3, 3]
    at = cv.projectPoints(points, turn, shift, matrix, np.array(camera.lens.coefficients))[0][:, 0]
    columns, rows = np.rint(at).astype(int).T
    inside = (columns >= 0) & (columns < 1280) & (rows >= 0) & (rows < 720)
    expected = picture[rows[inside], columns[inside]]
    found = frame.colours[frame.depth > 0][::500][inside]
    assert inside.mean() > 0.9
    assert np.mean(np.all(found == expected, axis=1)) > 0.99  # but for rounding
