"""Cameras: frames from recordings that a vendor's SDK plays back, lost cameras, and what is wrong."""

from __future__ import annotations

import sys
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from PIL import Image as Picture

from gepf.common.errors import InputError
from gepf.common.frame import Frame, View
from gepf.common.protocol.frames import LIVE_END, decode_colour, decode_live
from gepf.coordinator.cli import main
from gepf.coordinator.results.track import read_track
from gepf.coordinator.settings import SceneSettings
from gepf.coordinator.sources import open_source
from gepf.coordinator.sources.devices import device
from gepf.coordinator.sources.devices.device import (
    VENDORS,
    AttachedCamera,
    Camera,
    CameraLost,
    Shot,
    explain_absence,
)
from gepf.coordinator.tracking.segmenter import ExpectedSurface, Segmenter
from tests.support.live import KEY, listening
from tests.support.processes.programs import wait_until
from tests.support.stand_ins import CAMERA, StillWorkers, standing

record = pytest.importorskip("tests.support.realsense").record
DEPTH = [np.where(standing() > 0, standing() + n, 0).astype(np.uint16) for n in range(6)]
TILTED = (0.0, -9.8 * np.cos(0.2), 9.8 * np.sin(0.2))  # measured by a camera that looks down by 0.2 rad


def film(folder: Path, **given: object) -> str:
    """A recording by the SDK of a person at two metres who moves away, 1 mm per image."""
    return f"realsense:{record(folder / 'film.db3', DEPTH, CAMERA, 30, **given)}"


def test_a_recording_is_played_back_as_it_was(tmp_path: Path) -> None:
    """Depth, camera, unit, and times of the camera's clock are the rendered ones; gaps are kept."""
    numbers, said = [7, 8, 9, 12, 13, 14], list[str]()
    # Slow enough that the SDK drops no image on a loaded machine.
    spec = film(tmp_path, numbers=numbers, unit_m=0.002, acceleration=TILTED, pause_s=0.3)
    camera = AttachedCamera(spec, said.append)
    frames = [frame for frame, _ in camera]
    assert [frame.number for frame in frames] == [0, 1, 2, 5, 6, 7]
    assert camera.dropped == 2
    assert "Rendered 1234, 64x48 at 30 frames/s" in said[0]
    assert "dropped" in said[1]
    for frame, truth in zip(frames, DEPTH, strict=True):
        np.testing.assert_array_equal(frame.depth, truth)
        assert (frame.intrinsics, frame.depth_scale) == (CAMERA, 500.0)
        assert frame.gravity is not None
        np.testing.assert_allclose(frame.gravity, [0.0, np.cos(0.2), -np.sin(0.2)], atol=1e-6)
    np.testing.assert_allclose(np.diff([frame.time_s for frame in frames]), 1.0 / 30.0, atol=1e-6)


def test_distortion_is_removed(tmp_path: Path) -> None:
    """A pixel beside the centre shows what the lens moved outwards."""
    (frame, _), *_ = AttachedCamera(film(tmp_path, coefficients=(0.5, 0.0, 0.0, 0.0, 0.0)), print)
    x = (50 - CAMERA.cx) / CAMERA.fx
    there = round(x * (1.0 + 0.5 * x * x) * CAMERA.fx + CAMERA.cx)
    assert there != 50
    np.testing.assert_array_equal(frame.depth[24, 50], DEPTH[0][24, there])
    assert not np.array_equal(frame.depth, DEPTH[0])


def test_a_published_camera_is_tracked_and_kept(endpoint: str, tmp_path: Path) -> None:
    """`gepf publish` sends each image with gravity, and before it its colours; then the end."""
    colours = [np.full((48, 64, 3), (200, 20 * n, 10), np.uint8) for n in range(6)]
    spec = film(tmp_path, acceleration=TILTED, colour=colours)
    with listening(endpoint, f"{KEY}/color", KEY) as listener:
        assert main(["publish", spec, "--key", KEY, "--listen", endpoint, "--color"]) == 0
        wait_until(lambda: LIVE_END in listener.on(KEY))
    came, arrived = listener.on(KEY), listener.on(f"{KEY}/color")
    for payload in came[:-1]:
        frame = decode_live(payload)
        assert frame is not None
        np.testing.assert_array_equal(frame.depth, DEPTH[frame.number])
        assert frame.gravity is not None
        np.testing.assert_allclose(frame.gravity, [0.0, np.cos(0.2), -np.sin(0.2)], atol=1e-6)
    (tmp_path / "first.jpg").write_bytes(decode_colour(arrived[0])[1])
    found = np.asarray(Picture.open(tmp_path / "first.jpg"), dtype=np.float64)
    assert np.median(np.abs(found - colours[0])[DEPTH[0] > 0]) < 20.0  # a file with losses
    assert len(came) > 1
    assert len(arrived) >= len(came) - 1


class Unheard(StillWorkers):
    """Publishes results to no one."""

    def speak(self, key: str) -> Any:
        """A publisher without subscribers."""
        del key
        return Mock(has_subscriber=False)


def test_a_camera_is_tracked_in_one_command(tmp_path: Path) -> None:
    """The kept frames are recorded ones, and each is in the results."""
    spec, out, kept = film(tmp_path, acceleration=TILTED, pause_s=0.3), tmp_path / "run", tmp_path / "kept"
    (tmp_path / "init.json").write_text('{"root_tz": 2.0, "r_elbow_flexion": 0.5}')
    options = ("--init", str(tmp_path / "init.json"), "--record", str(kept))
    assert Unheard().track(Path(spec), out, *options) in (0, 3)
    track, frames = read_track(out), [*open_source(kept)]
    assert track.frame.tolist() == [frame.number for frame in frames]
    assert len(frames) > 1
    assert all(np.array_equal(frame.views[0].depth, DEPTH[frame.number]) for frame in frames)


def test_a_rotation_that_the_user_gives_is_stronger_than_the_accelerometer(tmp_path: Path) -> None:
    """Live; a recording does the same (test_azure_kinect)."""
    (tmp_path / "init.json").write_text('{"root_tz": 2.0, "r_elbow_flexion": 0.5}')
    spec, options = film(tmp_path, acceleration=TILTED), ("--init", str(tmp_path / "init.json"))
    assert Unheard().track(Path(spec), tmp_path / "run", *options, "--rotate", "90") in (0, 3)
    up = read_track(tmp_path / "run").up
    assert up is not None
    np.testing.assert_allclose(up, [-1.0, 0.0, 0.0], atol=1e-9)


def test_the_measured_gravity_gives_the_vertical() -> None:
    """Without a floor in the image, up is against it."""
    gravity = np.array([0.0, np.cos(0.2), -np.sin(0.2)])
    frame = Frame.of(View(0, 0.0, DEPTH[0], 1000.0, CAMERA, gravity=gravity))
    (segmented,) = Segmenter(1000, SceneSettings()).segment(frame, [ExpectedSurface()]).views
    np.testing.assert_allclose(segmented.scene.planes.up, -gravity, atol=1e-6)


LOST, BROKEN = CameraLost("no image comes"), RuntimeError("hwmon command failed")


def loose(failure: Exception = LOST, images: int = 2, at_stop: Exception | None = None) -> Camera:
    """A camera that fails after some images, and perhaps as it stops; numbers and clock start again."""

    def shots() -> Generator[Shot]:
        try:
            for n in range(images):
                yield View(40 + n, 9.0 + n / 30.0, DEPTH[0], 1000.0, CAMERA), None
            raise failure
        finally:
            if at_stop is not None:
                raise at_stop

    return Camera("loose", shots())


@pytest.mark.parametrize(("failure", "at_stop"), [(LOST, None), (BROKEN, None), (LOST, BROKEN)])
def test_a_camera_that_comes_back_is_picked_up(
    monkeypatch: pytest.MonkeyPatch, failure: Exception, at_stop: Exception | None
) -> None:
    """Absent for two tries, then it goes on, with ascending numbers and times; nothing counts as dropped.

    Whatever its SDK raises, also as it stops, and when it is opened too early.
    """
    lost = [loose(failure, at_stop=at_stop) for _ in range(3)]
    openings: Iterator[Camera | Exception] = iter([lost[0], InputError("no camera"), BROKEN, *lost[1:]])

    def reopen(*_: object, **__: object) -> Camera:
        if isinstance(opened := next(openings), Exception):
            raise opened
        return opened

    monkeypatch.setattr(device, "open_camera", reopen)
    monkeypatch.setattr(device, "LIMITS", device.CameraLimits(retry_s=0.01))
    camera, frames = AttachedCamera("realsense:", print), []
    for frame, _ in camera:
        frames.append(frame)
        if len(frames) == 5:
            camera.close()
    assert [frame.number for frame in frames] == [0, 1, 2, 3, 4]
    assert np.all(np.diff([frame.time_s for frame in frames]) > 0.0)
    assert camera.dropped == 0


@pytest.mark.parametrize(
    ("spec", "images"), [("realsense:", 0), ("realsense:film.bag", 3)], ids=["at first", "in a recording"]
)
def test_an_sdk_that_fails_for_good_ends_the_run_with_an_error(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    spec: str,
    images: int,
) -> None:
    """Before the first image of a camera, or in a recording: one line, exit code 1; the frames are kept."""
    monkeypatch.setattr(device, "open_camera", lambda *_, **__: loose(BROKEN, images))
    (tmp_path / "init.json").write_text('{"root_tz": 2.0, "r_elbow_flexion": 0.5}')
    out = tmp_path / "run"
    assert Unheard().track(Path(spec), out, "--init", str(tmp_path / "init.json")) == 1
    said = capsys.readouterr().err.splitlines()
    assert said[-1] == f"gepf: {spec}: RuntimeError: hwmon command failed"
    assert not any("Traceback" in line for line in said)
    if images:
        kept = read_track(out).frame.tolist()
        assert 0 < len(kept) <= images
        assert any(f"ended early with {len(kept)} frame" in line for line in said)


def test_an_sdk_that_fails_to_open_a_camera_is_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The camera, and what its SDK says."""

    def open_device(_: str, __: bool) -> Camera:
        raise BROKEN

    monkeypatch.setattr("gepf.coordinator.sources.devices.realsense.open_device", open_device)
    assert Unheard().track(Path("realsense:"), tmp_path / "run") == 1
    (line,) = (line for line in capsys.readouterr().err.splitlines() if line.startswith("gepf:"))
    assert "realsense:: cannot be opened (RuntimeError: hwmon command failed)" in line


def test_each_problem_has_one_line_with_its_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No package, no device, a device without permission, and one that is in use."""
    monkeypatch.setitem(sys.modules, "pyk4a", None)
    with pytest.raises(InputError, match=r"pip install 'gepf\[azure-kinect\]'"):
        AttachedCamera("azure-kinect:", print)
    with pytest.raises(InputError, match="no RealSense camera is connected to this host"):
        AttachedCamera("realsense:", print)
    with pytest.raises(InputError, match="no such file"):
        AttachedCamera("realsense:nowhere.bag", print)
    usb, node = tmp_path / "devices" / "1-4", tmp_path / "nodes" / "001" / "004"
    usb.mkdir(parents=True)
    node.parent.mkdir(parents=True)
    for name, value in {"idVendor": "8086", "idProduct": "0b07", "busnum": "1", "devnum": "4"}.items():
        (usb / name).write_text(f"{value}\n")
    assert "udev rules" in explain_absence(VENDORS["realsense"], usb.parent, tmp_path / "nodes")
    node.touch()
    assert "in use" in explain_absence(VENDORS["realsense"], usb.parent, tmp_path / "nodes")
    assert "no Orbbec" in explain_absence(VENDORS["orbbec"], usb.parent, tmp_path / "nodes")
