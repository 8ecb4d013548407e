"""One recorded sequence in every input format: the same frames and poses; and damaged files."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from pypcd4.pypcd4 import Encoding

from gepf.common.camera import Intrinsics, back_project
from gepf.common.errors import InputError
from gepf.coordinator.cli import main
from gepf.coordinator.sources import find_format, open_source
from gepf.coordinator.sources.camera import GivenCamera
from gepf.coordinator.sources.utd_mhad import KINECT
from tests.support.recordings import (
    FPS,
    FRAMES,
    WRITERS,
    clouds_of,
    matrix_of,
    read_all,
    recorded,
    write_bag,
    write_pcd,
    write_ply,
    write_tum,
)
from tests.support.refusals import refused

FORMATS = {
    "open3d": "Open3D folder (depth/000000.png)",
    "tum": "TUM RGB-D folder (depth.txt)",
    "ply": "point clouds (.ply or .pcd)",
    "pcd": "point clouds (.ply or .pcd)",
    "walk.bag": "ROS 1 or RealSense .bag, ROS 2 .mcap, .db3 or folder",
    "walk.npz": "numpy .npz (depth, intrinsics)",
    "metres.npz": "numpy .npz (depth, intrinsics)",
    "walk.mat": "UTD-MHAD .mat",
}

RATES = {"walk.mat": 19.0}
"""Frames per second of what was not recorded at the usual rate."""

SCALES = {"open3d": 1000.0}
"""Units per metre of what does not say them without a camera file."""


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_same_frames(tmp_path: Path, name: str) -> None:
    """The format is detected; depth to the unit, the camera, numbers, times and rate."""
    path = WRITERS[name](tmp_path / name, recorded())
    assert find_format(path).name == FORMATS[name]
    source = open_source(path)
    assert source.numbers == range(FRAMES)
    fps = RATES.get(name, FPS)
    assert source.fps == pytest.approx(fps, rel=1e-4)
    camera = source.intrinsics
    assert (camera.width, camera.height) == (KINECT.width, KINECT.height)
    np.testing.assert_allclose(matrix_of(camera), matrix_of(KINECT), rtol=1e-5)
    for n, frame in enumerate(source):
        assert (frame.number, frame.views[0].intrinsics) == (n, camera)
        assert frame.time_s == pytest.approx(n / fps, abs=1e-5)
        np.testing.assert_array_equal(frame.views[0].metres(), recorded()[n] / np.float32(1000.0))


@pytest.mark.parametrize("name", WRITERS)
def test_a_camera_that_the_user_gives_replaces_the_recorded_one(tmp_path: Path, name: str) -> None:
    """Pixels are unchanged, as are the positions of points; a camera file is not needed."""
    path = WRITERS[name](tmp_path / name, recorded())
    (path / "camera_intrinsic.json").unlink(missing_ok=True) if path.is_dir() and name != "ply" else None
    source = open_source(path, GivenCamera((300.0, 301.0, 150.0, 110.0), SCALES.get(name)))
    assert source.intrinsics == Intrinsics(320, 240, 300.0, 301.0, 150.0, 110.0)
    depth, expected = source.view(1).metres(), recorded()[1] / np.float32(1000.0)
    if name not in ("ply", "pcd"):
        np.testing.assert_array_equal(depth, expected)
        return
    seen = back_project(depth, source.intrinsics)[depth > 0.0]
    there = back_project(expected, KINECT)[expected > 0.0]
    assert np.allclose(seen.min(axis=0), there.min(axis=0), atol=0.02)
    assert np.allclose(seen.max(axis=0), there.max(axis=0), atol=0.02)


@pytest.mark.parametrize("encoding", list(Encoding))
def test_every_encoding_of_pcd_is_read(tmp_path: Path, encoding: Encoding) -> None:
    """ASCII, binary, compressed."""
    source = open_source(write_pcd(tmp_path / "clouds", recorded()[:1], encoding))
    np.testing.assert_array_equal(source.view(0).metres(), recorded()[0] / np.float32(1000.0))


def test_an_unorganised_cloud_without_a_camera_has_pixels_as_wide_as_its_spacing(tmp_path: Path) -> None:
    """The camera that recorded it is found up to its size, and every point is a pixel."""
    path = write_ply(tmp_path / "clouds", recorded())
    (path / "camera_intrinsic.json").unlink()
    source = open_source(path)
    assert (source.intrinsics.fx, source.intrinsics.fy) == pytest.approx((KINECT.fx, KINECT.fy), rel=1e-3)
    for frame, whole in zip(source, recorded(), strict=True):
        seen = frame.views[0].metres()
        assert np.count_nonzero(seen) == np.count_nonzero(whole)
        assert seen[seen > 0].mean() == pytest.approx(whole[whole > 0].mean() / 1000.0, abs=1e-3)


def test_a_thinned_cloud_has_a_surface_without_gaps(tmp_path: Path) -> None:
    """Of a quarter of the points at random, pixels are larger, and hardly one within the person is empty."""
    path, rng = tmp_path / "clouds", np.random.default_rng(0)
    path.mkdir()
    for n, cloud in enumerate(clouds_of(recorded())):
        seen = cloud[np.isfinite(cloud).all(axis=2)]
        kept = seen[rng.random(len(seen)) < 0.25]
        (path / f"{n}.ply").write_bytes(trimesh.PointCloud(kept).export(file_type="ply"))  # type: ignore[no-untyped-call]
    source = open_source(path)
    assert source.intrinsics.fx == pytest.approx(0.5 * KINECT.fx, rel=0.15)
    share = (source.intrinsics.fx / KINECT.fx) ** 2
    covered = np.count_nonzero(source.view(0).depth) / (share * np.count_nonzero(recorded()[0]))
    assert 0.9 < covered < 1.1


def test_points_in_millimetres_are_known_by_their_distance(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """As the vendor's tools for Azure Kinect write them; a line says so."""
    path = write_ply(tmp_path / "clouds", recorded(), per_metre=1000.0)
    depth = open_source(path).view(0).metres()
    assert np.median(depth[depth > 0]) == pytest.approx(
        np.median(recorded()[recorded() > 0]) / 1000.0, abs=0.01
    )
    assert "are interpreted as millimetres" in caplog.text


def test_of_points_in_one_pixel_the_nearest_counts(tmp_path: Path) -> None:
    """Points behind it are hidden."""
    (tmp_path / "clouds").mkdir()
    points = "0 0 3\n0 0 2\n0 0 2.5\n0 0 -1\nnan 0 1\n"
    head = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n"
    (tmp_path / "clouds" / "a.ply").write_text(head + "end_header\n" + points)
    depth = open_source(tmp_path / "clouds").view(0).metres()
    assert depth[depth > 0].tolist() == [2.0]


def test_clouds_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    """cloud_10 comes after cloud_9."""
    path = write_ply(tmp_path / "clouds", np.repeat(recorded()[:1], 2, axis=0))
    (path / "cloud_0.ply").rename(path / "cloud_9.ply")
    (path / "cloud_1.ply").write_bytes(b"")
    (path / "cloud_1.ply").rename(path / "cloud_10.ply")
    source = open_source(path)
    assert source.view(0).depth.any()
    with pytest.raises(InputError, match=r"cloud_10\.ply is damaged"):
        source.frame(1)


@pytest.mark.parametrize(
    ("name", "fx"),
    [("rgbd_dataset_freiburg1_xyz", 517.3), ("rgbd_dataset_freiburg3_walking", 535.4), ("mine", 525.0)],
)
def test_a_tum_folder_has_the_camera_that_the_data_set_documents(
    tmp_path: Path, name: str, fx: float
) -> None:
    """By the folder's name; the nominal one for others; 5000 units a metre."""
    depth = np.full((1, 480, 640), 2000, np.uint16)
    source = open_source(write_tum(tmp_path / name, depth, with_camera=False))
    assert source.intrinsics.fx == fx
    assert source.view(0).metres()[0, 0] == 2.0


def test_a_bag_without_units_is_in_millimetres_and_one_with_units_in_those(tmp_path: Path) -> None:
    """Millimetres, as in ROS for 16-bit depth; 0.1 mm for a D405."""
    assert open_source(write_bag(tmp_path / "a.bag", recorded(), None)).view(0).depth_scale == 1000.0
    assert open_source(write_bag(tmp_path / "b.bag", recorded(), 1e-4)).view(0).depth_scale == 10_000.0


def cut(path: Path, share: float = 0.5) -> None:
    """Keep the first part of a file."""
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])


def text(content: str) -> Callable[[Path], object]:
    """Write a text."""
    return lambda path: path.write_text(content)


def arrays(**values: object) -> Callable[[Path], None]:
    """Write other arrays into an `.npz` file."""

    def write(path: Path) -> None:
        kept = {"depth": recorded(), "intrinsics": matrix_of(KINECT), "depth_scale": 1000} | values
        np.savez(path, **{k: np.asarray(v) for k, v in kept.items() if v is not None})  # type: ignore[arg-type]

    return write


DAMAGES: list[tuple[str, str, Callable[[Path], object], str]] = [
    ("tum", "depth.txt", text("# nothing\n"), "depth.txt has 0 times for 3 pictures"),
    ("tum", "depth.txt", lambda path: path.write_bytes(b"\xff\xfe\x00"), "is not a readable text"),
    ("tum", "camera_intrinsic.json", Path.unlink, "frame 0 is 320x240, but its camera 640x480"),
    ("tum", "camera_intrinsic.json", text("{"), "camera_intrinsic.json"),
    ("ply", "cloud_1.ply", cut, "cloud_1.ply is damaged"),
    ("ply", "x.pcd", text(""), "holds both .ply and .pcd"),
    ("pcd", "0.pcd", cut, "0.pcd is damaged"),
    ("walk.bag", "", cut, "walk.bag is damaged or not a ROS bag"),
    ("walk.npz", "", cut, "walk.npz is damaged"),
    ("walk.npz", "", arrays(depth=None), "has no array 'depth', only"),
    ("walk.npz", "", arrays(depth_scale=None), "has no unit; add depth_scale, units per metre"),
    ("walk.npz", "", arrays(depth=np.zeros((3, 4))), "'depth' has shape (3, 4)"),
    ("walk.npz", "", arrays(depth=np.full((1, 2, 2), -5)), "or whole units from 0 to 65535"),
    ("walk.npz", "", arrays(intrinsics=np.zeros((3, 3))), "intrinsics are not fx 0 cx"),
    ("walk.npz", "", arrays(intrinsics=np.eye(4)), "'intrinsics' has shape (4, 4)"),
    ("walk.npz", "", arrays(fps=-1), "-1.0 frames a second is not valid"),
]


@pytest.mark.parametrize(
    ("name", "file", "damage", "says"),
    DAMAGES,
    ids=[f"{n} {row[0]} {row[3]}" for n, row in enumerate(DAMAGES)],
)
def test_damage_is_found_and_reported_in_one_line(
    tmp_path: Path, name: str, file: str, damage: Callable[[Path], object], says: str
) -> None:
    """Each fault in each format is an InputError that names the file and the correction."""
    path = WRITERS[name](tmp_path / name, recorded())
    damage(path / file if file else path)
    with refused() as raised:
        read_all(path)
    assert says in str(raised.value)
    assert "; " in str(raised.value)


@pytest.mark.parametrize("name", ["x.bag", "x.mat"])
def test_a_file_cut_or_changed_anywhere_is_read_or_refused(tmp_path: Path, name: str) -> None:
    """No damage raises another library's error."""
    if name == "x.bag":
        path = write_bag(tmp_path / name, recorded()[:1, 100:140, 140:180], camera=small())
    else:
        path = WRITERS["walk.mat"](tmp_path / name, recorded()[:1] % 9)
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    refusals = []
    for place in rng.integers(0, len(whole), 20):
        changed = bytearray(whole)
        changed[place] ^= 1 << rng.integers(8)
        for content in (whole[:place], bytes(changed)):
            path.write_bytes(content)
            try:
                read_all(path)
            except InputError as error:
                refusals.append(str(error))
    assert len(refusals) >= 20
    assert not any("\n" in line for line in refusals)


def small() -> Intrinsics:
    """The camera of a crop of 40 x 40 pixels."""
    return KINECT.crop(140, 100, 40, 40)


def test_a_bag_without_what_is_needed_says_so(tmp_path: Path) -> None:
    """No depth image; frames of another size than their camera."""
    with pytest.raises(InputError, match=r"holds no depth images \(16UC1 or 32FC1\); record"):
        open_source(write_bag(tmp_path / "empty.bag", recorded()[:0]))
    source = open_source(write_bag(tmp_path / "sizes.bag", recorded(), camera=small()))
    with pytest.raises(InputError, match="frame 0 is 320x240, but its camera 40x40"):
        source.frame(0)


def test_an_organised_cloud_that_no_pinhole_camera_sees_needs_a_camera(tmp_path: Path) -> None:
    """Rows and columns of a laser scanner are no image."""
    path = write_pcd(tmp_path / "clouds", np.roll(recorded()[:1], 40, axis=2))
    twisted = write_pcd(tmp_path / "twisted", recorded()[:1])
    cloud = (path / "0.pcd").read_bytes()
    (twisted / "0.pcd").write_bytes(
        cloud.replace(b"WIDTH 320", b"WIDTH 240").replace(b"HEIGHT 240", b"HEIGHT 320")
    )
    with pytest.raises(InputError, match=r"not by a pinhole camera; add camera_intrinsic\.json"):
        open_source(twisted)


def test_info_says_what_a_sequence_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Format, frames, size, rate and range as JSON, and a picture."""
    path = write_tum(tmp_path / "walk", recorded())
    assert main(["info", str(path), "--json", "--picture", str(tmp_path / "x.png")]) == 0
    facts = json.loads(capsys.readouterr().out)
    seen = recorded()[recorded() > 0] / 1000.0
    assert (facts["format"], facts["frames"]) == ("TUM RGB-D folder (depth.txt)", FRAMES)
    assert (facts["width"], facts["height"], facts["intrinsics"]["fx"]) == (320, 240, KINECT.fx)
    assert (facts["nearest_m"], facts["farthest_m"]) == (pytest.approx(seen.min()), pytest.approx(seen.max()))


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (["--depth-scale", "50"], "between 40 and 40 m, half of it beyond 40 m; if the unit is wrong"),
        (["--depth-scale", "10000"], "between 0.2 and 0.2 m, half of it beyond 0.2 m; if the unit"),
        (["--intrinsics", "500,500,3200,240"], "centre (3200, 240) is outside its 40x30 image"),
        (["--depth-scale", "1000"], ""),
    ],
)
def test_units_and_a_camera_that_cannot_be_are_told(
    given: list[str], says: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """`gepf info` still shows the facts, with a line on stderr that names the correction."""
    np.save(tmp_path / "flat.npy", np.full((2, 30, 40), 2000, dtype=np.uint16))
    camera = [] if "--intrinsics" in given else ["--intrinsics", "40,40,20,15"]
    assert main(["info", str(tmp_path / "flat.npy"), "--json", *camera, *given]) == 0
    assert says in caplog.text
    assert bool(caplog.records) == bool(says)
