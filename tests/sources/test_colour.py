"""Colour frames that go with the depth: of folders, and of live cameras in `test_live_frames`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from gepf.common.camera import Intrinsics
from gepf.common.errors import InputError
from gepf.coordinator.sources import open_source
from gepf.coordinator.sources.camera import AS_RECORDED, GivenCamera
from gepf.coordinator.sources.colour_folder import ColourFolder, with_colours
from tests.support.recordings import write_open3d

CAMERA = Intrinsics(64, 48, 50.0, 50.0, 31.5, 23.5)
GREEN, RED = (0, 200, 0), (200, 0, 0)


def save(folder: Path, name: str, size: tuple[int, int] = (64, 48)) -> None:
    """A picture that is red to the left and green to the right."""
    picture = Image.new("RGB", size, GREEN)
    picture.paste(RED, (0, 0, size[0] // 2, size[1]))
    folder.mkdir(exist_ok=True)
    picture.save(folder / name)


def test_frames_are_found_by_number(tmp_path: Path) -> None:
    """With other text in the names, and with other files in the folder."""
    save(tmp_path, "color_000007.png")
    save(tmp_path, "000008.png", (128, 96))
    (tmp_path / "notes.txt").write_text("x")
    colours = ColourFolder(tmp_path, CAMERA, range(7, 9))
    assert colours.frame(7).size == (64, 48)
    assert colours.frame(8).getpixel((0, 0)) == RED


@pytest.mark.parametrize(
    ("name", "size", "says"),
    [
        ("000000.png", (64, 48), "lacks 1 of 2 colour frames, first 1"),
        ("000001.png", (64, 64), "000001.png has another shape than the depth"),
    ],
)
def test_wrong_counts_and_sizes_are_refused_before_tracking(
    tmp_path: Path, name: str, size: tuple[int, int], says: str
) -> None:
    """All frames are checked, not only the first."""
    save(tmp_path, "000000.png")
    save(tmp_path, name, size)
    with pytest.raises(InputError) as caught:
        ColourFolder(tmp_path, CAMERA, range(2))
    assert says in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"no picture"])
def test_damage_is_reported(tmp_path: Path, content: bytes) -> None:
    """So is a missing folder."""
    (tmp_path / "0.png").write_bytes(content)
    with pytest.raises(InputError, match="damaged"):
        ColourFolder(tmp_path, CAMERA, range(1))
    with pytest.raises(InputError, match="no such folder"):
        ColourFolder(tmp_path / "x", CAMERA, range(1))


def test_frames_of_a_recording_carry_colour_where_there_is_any(tmp_path: Path) -> None:
    """From `color/` beside the depth, which is the same without. Missing and damaged images are left out."""
    depth = np.full((5, CAMERA.height, CAMERA.width), 2000, np.uint16)
    folder = write_open3d(tmp_path / "recording", depth, CAMERA)
    save(folder / "color", "000000.jpg")
    save(folder / "color", "000001.png", (128, 96))
    (folder / "color" / "000002.png").write_bytes(b"no picture")
    save(folder / "color", "000003.png", (64, 64))
    plain = open_source(folder)
    coloured = with_colours(plain)
    images = [frame.views[0].colours for frame in coloured]
    shapes = [None if image is None else image.shape for image in images]
    assert shapes == [(48, 64, 3), (96, 128, 3), None, None, None]
    assert all(each.views[0].colours is None for each in plain)
    assert all(
        np.array_equal(a.views[0].depth, b.views[0].depth) for a, b in zip(plain, coloured, strict=True)
    )


def test_colour_of_another_folder_is_mirrored_like_depth(tmp_path: Path) -> None:
    """Red is at the right in a recording that was mirrored; a folder that is not there is named."""
    depth = np.full((1, CAMERA.height, CAMERA.width), 2000, np.uint16)
    folder = write_open3d(tmp_path / "recording", depth, CAMERA)
    save(tmp_path / "elsewhere", "0.png")
    for given, at_left in ((AS_RECORDED, RED), (GivenCamera(mirrored=True), GREEN)):
        colours = with_colours(open_source(folder, given), tmp_path / "elsewhere").view(0).colours
        assert colours is not None
        assert tuple(colours[0, 0]) == at_left
    with pytest.raises(InputError, match="no such folder of colour frames"):
        with_colours(open_source(folder), tmp_path / "nowhere")
