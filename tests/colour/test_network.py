"""The network of keypoints: the file, its outputs, and crops."""

from __future__ import annotations

import hashlib
import io
import tarfile
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from gepf.common.arrays import Array, Mask
from gepf.common.camera import Intrinsics, project
from gepf.common.errors import InputError
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.colour.build import MEMBER, SHA256, extract
from gepf.coordinator.colour.crop import SIDE_PX, Colours, Crop, close_gaps, crop_of_body
from gepf.coordinator.colour.keypoints import LANDMARK_OF, find_keypoints
from gepf.coordinator.colour.network import FILE, PoseNetwork
from gepf.coordinator.settings import ColourSettings
from gepf.coordinator.synthesis.clothes import dress
from gepf.coordinator.synthesis.rendering import ColouredSurface, DepthRenderer

SETTINGS = ColourSettings()

pytest.importorskip("ai_edge_litert", reason="the extra color is not installed")

CAMERA = Intrinsics(320, 240, 290.0, 290.0, 159.5, 119.5)
STANDING = {
    "root_tx": 0.3, "root_tz": 2.9, "r_shoulder_abduct": 1.2, "l_shoulder_flexion": 0.5,
    "l_elbow_flexion": 1.2, "r_hip_abduct": 0.3,
}  # fmt: skip


@cache
def person(turned: bool = False) -> tuple[Colours, Array, Array]:
    """An image of a dressed person, turned on the side or not: colours, vertices, joints."""
    model = human()
    pose = name_pose(model, STANDING | ({"root_rz": 1.5} if turned else {}))[None]
    surface = ColouredSurface(
        pose_vertices(model, pose)[0], model.triangles, dress(model, np.random.default_rng(0))
    )
    with DepthRenderer(CAMERA) as renderer:
        image = renderer.colours(surface, np.array([0.6, 0.6, 0.5]), np.array([0.3, -0.5, -1.0]))
    return image, surface.vertices, joint_positions(model, pose)[0]


def everything(image: Colours) -> Mask:
    """All pixels have depth."""
    return np.ones(image.shape[:2], np.bool_)


def limbs(joints: Array) -> dict[str, Array]:
    """Pixels (2,) of the joints that are keypoints, too."""
    named = zip(human().joint_names, project(joints, CAMERA), strict=True)
    return {name: at for name, at in named if name in LANDMARK_OF}


def test_the_file_is_that_of_the_package() -> None:
    """Its hash is the one that the build script demands, and its licence stands beside it with the source."""
    assert hashlib.sha256(FILE.read_bytes()).hexdigest() == SHA256
    licence = FILE.with_suffix(".LICENSE").read_text()
    assert "Apache License" in licence
    assert "@mediapipe/pose 0.5.1675469404" in licence


@pytest.mark.parametrize("changed", [False, True])
def test_only_the_right_file_is_taken_from_a_package(changed: bool, tmp_path: Path) -> None:
    """Its bytes are returned; a package with another file is refused, and so is one without it."""
    content = FILE.read_bytes()[: -1 if changed else None]
    with tarfile.open(tmp_path / "package.tgz", "w:gz") as archive:
        member = tarfile.TarInfo(MEMBER)
        member.size = len(content)
        archive.addfile(member, io.BytesIO(content))
    if not changed:
        assert extract(tmp_path / "package.tgz") == content
        return
    with pytest.raises(InputError, match="expected f17bfbec"):
        extract(tmp_path / "package.tgz")
    (tmp_path / "empty.tgz").write_bytes(b"")
    with pytest.raises(InputError, match="does not contain package/pose_landmark_lite"):
        extract(tmp_path / "empty.tgz")


def test_threads_do_not_change_a_byte() -> None:
    """One, two and again one thread: the same keypoints."""
    image, _, _ = person()
    crop = Crop(160.0, 120.0, 240.0)
    seen = [find_keypoints(PoseNetwork(n), image, everything(image), crop, SETTINGS) for n in (1, 2, 1)]
    assert all(each is not None for each in seen)
    assert len({each.tobytes() for each in seen if each is not None}) == 1


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("scale", [1, 3])
def test_a_person_is_found_where_it_is(turned: bool, scale: int) -> None:
    """Upright or not, in images larger than depth: 6 cm at the median, 20 at most.

    Precise keypoints are not far off by their own measure.
    """
    image, vertices, joints = person(turned)
    larger = np.repeat(np.repeat(image, scale, axis=0), scale, axis=1)
    at = limbs(joints)
    left, right, neck = (
        joints[human().joint_names.index(each)] for each in ("left_hip", "right_hip", "neck")
    )
    crop = crop_of_body(vertices, 0.5 * (left + right), neck, CAMERA)
    assert crop is not None
    seen = find_keypoints(PoseNetwork(), larger, everything(image), crop, SETTINGS)
    assert seen is not None
    found = dict(zip(LANDMARK_OF, seen, strict=True))
    off = np.array([np.linalg.norm(found[name][:2] - pixel) for name, pixel in at.items()])
    metres = off * 2.9 / CAMERA.fx
    assert np.median(metres) < 0.06
    assert metres.max() < 0.2
    assert np.median(off**2 * [found[name][2] for name in at]) < 9.0


def test_nobody_is_found_in_an_empty_image() -> None:
    """Where there is nobody, there are no keypoints."""
    image = np.full((240, 320, 3), 120, np.uint8)
    assert (
        find_keypoints(PoseNetwork(), image, everything(image), Crop(160.0, 120.0, 200.0), SETTINGS) is None
    )


def test_a_crop_shows_the_image() -> None:
    """An upright crop of an image's own size has the pixels of the image."""
    image = np.random.default_rng(1).integers(20, 255, (SIDE_PX, SIDE_PX, 3), np.uint8)
    whole = Crop((SIDE_PX - 1) / 2, (SIDE_PX - 1) / 2, SIDE_PX)
    assert np.array_equal(whole.take(image, everything(image), SETTINGS.max_gap_px), image)


def test_only_narrow_gaps_of_registered_colour_are_closed() -> None:
    """A line without depth and colour is closed; a large area stays black, and what is black itself, too."""
    image = np.full((60, 60, 3), 200, np.uint8)
    measured = np.ones((60, 60), np.bool_)
    for rows, columns in ((slice(5, 8), slice(0, 60)), (slice(20, 50), slice(10, 40))):
        image[rows, columns], measured[rows, columns] = 0, False
    image[55:58] = 0  # a black thing, with depth
    closed = close_gaps(image, measured, 12.0)
    assert np.all(closed[5:8] == 200)
    assert np.all(closed[30:40, 20:30] == 0)
    assert np.all(closed[55:58] == 0)
