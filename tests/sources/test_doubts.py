"""Wrong cameras and units, rates and mirrored images: `gepf info` and `gepf track` say the same lines."""

from __future__ import annotations

import logging
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import gepf
from gepf.common.arrays import Array
from gepf.common.camera import Intrinsics
from gepf.common.kinematics import joint_positions
from gepf.coordinator.bodies.human.people import PEOPLE
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.cli import main
from gepf.coordinator.sources import open_source
from gepf.coordinator.sources.background import read_background
from gepf.coordinator.sources.camera import GivenCamera
from gepf.coordinator.sources.colour_folder import ColourFolder
from gepf.coordinator.sources.doubts import find_doubts
from tests.support.people import CAMERA, STANDING, raised, rendered
from tests.support.recordings import Depth, write_open3d
from tests.support.stand_ins import Direct

FRAMES = 8
OPTIONS = ("--particles", "6", "--points", "1500", "--no-pictures")
WAVING = {"l_elbow_flexion": 0.2, "l_shoulder_flexion": 0.15}


@cache
def walk() -> tuple[Depth, Array]:
    """Millimetres (F, H, W) of a person who raises the left arm before a wall, and joints (F, J, 3)."""
    model = human(1.82)
    poses = np.array([name_pose(model, raised(STANDING, n, WAVING)) for n in range(FRAMES)])
    pictures = np.array(rendered(model, poses, CAMERA))
    return np.rint(1000.0 * np.where(pictures > 0, pictures, 4.0)).astype(np.uint16), joint_positions(
        model, poses
    )


def doubts(path: Path, given: GivenCamera | None = None) -> str:
    """All lines about a recording."""
    return "\n".join(find_doubts(open_source(path, given or GivenCamera()), PEOPLE.nearest_m))


def test_a_good_recording_raises_no_doubt(tmp_path: Path) -> None:
    """Neither unit, lens, rate, mirrored images nor gaps."""
    assert doubts(write_open3d(tmp_path / "walk", walk()[0], CAMERA)) == ""


WRONG = Intrinsics(320, 240, 580.0, 580.0, 319.5, 239.5)  # of images of twice the size
FAULTS = [
    (CAMERA, 30.0, ["--depth-scale", "4000"], "m; if the unit is wrong, correct it with --depth-scale N"),
    (CAMERA, 30.0, ["--depth-scale", "100"], "m; if the unit is wrong, correct it with --depth-scale N"),
    (CAMERA, 30.0, ["--depth-scale", "1"], "m; if the unit is wrong, correct it with --depth-scale N"),
    (CAMERA, 3333.0, [], "3333 frames per second are implausible; write the frames' times to timestamps.txt"),
    (WRONG, 30.0, [], "the centre (319.5, 239.5) is far from the middle of its 320x240 image; "),
    (CAMERA, 30.0, ["--intrinsics", "290,390,160,120"], "mean that pixels are not square; "),
]


@pytest.mark.parametrize(("camera", "fps", "options", "says"), FAULTS)
def test_info_and_track_say_what_is_suspicious(
    tmp_path: Path,
    camera: Intrinsics,
    fps: float,
    options: list[str],
    says: str,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """The same line with a mend, once, though the run then ends without a person."""
    path = write_open3d(tmp_path / "walk", walk()[0][:2], camera, fps)
    main(["info", str(path), *options])
    (told,) = [line for line in caplog.messages if says in line]
    caplog.clear()
    main(["track", str(path), "--out", str(tmp_path / "run"), *OPTIONS, *options], Direct().connect)
    assert [line for line in caplog.messages if says in line] == [told]


def test_a_run_that_fails_says_where_the_depth_lies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Units that may be right and show nobody: the range of depth, and what to correct."""
    path = write_open3d(tmp_path / "wall", np.full((2, 240, 320), 2500, np.uint16), CAMERA)
    assert main(["track", str(path), "--out", str(tmp_path / "run"), *OPTIONS], Direct().connect) == 3
    said = " ".join(capsys.readouterr().err.split())
    assert (
        "depth lies between 2.5 and 2.5 m, half of it beyond 2.5 m; if that is wrong, correct --depth-"
        in said
    )


def test_a_kinect_v2_may_be_mirrored(tmp_path: Path) -> None:
    """Of its size alone, and until the user says whether it is."""
    path = write_open3d(
        tmp_path / "walk",
        np.full((2, 424, 512), 2000, np.uint16),
        Intrinsics(512, 424, 365, 365, 255.5, 211.5),
    )
    assert "add --mirrored, else --not-mirrored" in doubts(path)
    for known in (True, False):
        assert doubts(path, GivenCamera(mirrored=known)) == ""


def test_a_mirrored_recording_is_tracked_as_the_person_moved(tmp_path: Path) -> None:
    """With `--mirrored` the left arm rises, where it is, with the undisturbed error within 0.3 cm."""
    depth, truth = walk()
    off = {}
    camera = Intrinsics(320, 240, CAMERA.fx, CAMERA.fy, 319 - CAMERA.cx, CAMERA.cy)
    for name, images, options in (("plain", depth, ()), ("mirrored", depth[:, :, ::-1], ("--mirrored",))):
        path = write_open3d(tmp_path / name, images, camera if options else CAMERA)
        out = tmp_path / f"run_{name}"
        assert main(["track", str(path), "--out", str(out), *OPTIONS, *options], Direct().connect) == 0
        off[name] = np.linalg.norm(gepf.load(out).track.joint_positions - truth, axis=-1).mean()
    assert off["mirrored"] == pytest.approx(off["plain"], abs=0.003)
    assert off["plain"] < 0.03


def test_all_that_belongs_to_a_mirrored_recording_is_mirrored_back(tmp_path: Path) -> None:
    """Depth, its camera, the empty room and colour images; a rig and live input refuse the option."""
    depth = np.arange(1000, 1000 + 6 * 8, dtype=np.uint16).reshape(1, 6, 8)
    path = write_open3d(tmp_path / "walk", depth, Intrinsics(8, 6, 10.0, 11.0, 2.0, 3.0))
    source = open_source(path, GivenCamera(mirrored=True))
    assert (source.intrinsics.cx, source.mirrored) == (5.0, True)
    np.testing.assert_array_equal(source.view(0).depth, depth[0, :, ::-1])
    for asked in (str(path), str(path / "depth" / "000000.png"), "0"):
        np.testing.assert_array_equal(read_background(asked, source), depth[0, :, ::-1] / np.float32(1000.0))
    (tmp_path / "color").mkdir()
    Image.fromarray(np.arange(6 * 8 * 3, dtype=np.uint8).reshape(6, 8, 3)).save(tmp_path / "color" / "0.png")
    plain, back = (
        np.asarray(ColourFolder(tmp_path / "color", source.intrinsics, [0], mirrored=known).frame(0))
        for known in (False, True)
    )
    np.testing.assert_array_equal(back, plain[:, ::-1])


def test_live_input_refuses_the_option(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """One line."""
    with caplog.at_level(logging.ERROR):
        options = ["--listen", "tcp/127.0.0.1:0", "--insecure", "--mirrored", "--out", str(tmp_path / "run")]
        assert main(["track", "zenoh:camera", *options]) == 2
