"""Floor and walls are found at the right place, and no other surface is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.camera import Intrinsics
from gepf.coordinator.scene.noise import fit_growth, fit_noise
from gepf.coordinator.scene.planes import UP_DIRECTIONS, Planes, find_planes, refit, sample_rays
from gepf.coordinator.settings import SceneSettings
from tests.support.rooms import CABINET, CAMERA, HEIGHT, PERSON, TABLE, WALL, Box, Room

SIDE_WALL: Box = ((-1.4, -3.0, 0.3), (-1.3, HEIGHT, WALL))
CEILING: Box = ((-3.0, -1.4, 0.3), (3.0, -1.3, WALL))


def planes_of(room: Room) -> Planes:
    """What is found with a person in the room."""
    depth = room.see(PERSON).view.metres()
    return find_planes(rays_of(depth), UP_DIRECTIONS, SceneSettings().planes)


def rays_of(depth: NDArray[np.float32]) -> Array:
    """Rays of a depth image (H, W) in metres."""
    return sample_rays(depth, CAMERA, fit_noise(depth, SceneSettings().noise), 80)


@pytest.mark.parametrize("pitch", [0.0, 0.2, 0.5])
def test_the_floor_is_found_at_its_height_and_angle(pitch: float) -> None:
    """Height within 1.5 cm, up within a degree, with noise, furniture and a person, for a tilted camera."""
    room = Room((TABLE, CABINET), pitch, noise=0.002)
    found = planes_of(room)
    assert found.camera_height == pytest.approx(HEIGHT, abs=0.015)
    assert found.up @ (room.tilt.T @ np.array([0.0, -1.0, 0.0])) > np.cos(np.radians(1.0))


def test_the_wall_is_found_and_no_furniture() -> None:
    """Besides the floor there is one plane, as far away as the wall."""
    found = planes_of(Room((TABLE, CABINET), noise=0.002))
    assert len(found.coefficients) == 2
    assert 1.0 / np.linalg.norm(found.coefficients[1]) == pytest.approx(WALL, abs=0.02)


def test_planes_are_followed_when_the_camera_moves_a_little() -> None:
    """A camera that tilts by half a degree a frame keeps its floor."""
    followed = planes_of(Room(noise=0.002))
    for number in range(1, 9):
        after = Room(noise=0.002, pitch=np.radians(0.5 * number))
        depth = after.see(PERSON, number).view.metres()
        followed = replace(followed, coefficients=refit(followed.coefficients, rays_of(depth), 30))
    assert followed.up @ (after.tilt.T @ np.array([0.0, -1.0, 0.0])) > np.cos(np.radians(0.7))


def test_a_person_alone_has_no_planes() -> None:
    """If only a person is measured, no part of it becomes a wall or a floor."""
    seen = Room().see(PERSON)
    depth = np.where(seen.mask, seen.view.metres(), np.float32(0.0))
    assert len(find_planes(rays_of(depth), UP_DIRECTIONS, SceneSettings().planes).coefficients) == 0


@pytest.mark.parametrize("growth", [0.001, 0.004])
def test_noise_is_measured(growth: float) -> None:
    """The growth of the noise is found within a quarter, whatever is seen."""
    depth = Room((TABLE,), noise=growth).see(PERSON).view.metres()
    assert fit_growth(depth, SceneSettings().noise) == pytest.approx(growth, rel=0.25)


def test_a_floor_between_furniture_is_found() -> None:
    """Boxes hide all of the floor but a patch: height within 10 cm, up within two degrees."""
    boxes: tuple[Box, ...] = (
        ((-2.5, -0.2, 1.5), (-0.9, HEIGHT, 2.6)),
        ((0.3, 0.1, 1.4), (2.5, HEIGHT, 2.3)),
        ((-0.2, 0.2, 3.0), (0.5, HEIGHT, 3.3)),
        ((-1.2, -0.4, 2.9), (-0.5, HEIGHT, 3.3)),
    )
    found = planes_of(Room(boxes, noise=0.002))
    assert found.camera_height == pytest.approx(HEIGHT, abs=0.1)
    assert found.up @ np.array([0.0, -1.0, 0.0]) > np.cos(np.radians(2.0))


def test_no_floor_is_made_up() -> None:
    """If boxes hide all of it, no slanted plane through edges of objects is used instead."""
    room = Room((((-2.5, 0.3, 1.3), (2.5, HEIGHT, 1.6)), CABINET), noise=0.002)
    depth = room.see(PERSON).view.metres()
    rows = (np.arange(CAMERA.height) - CAMERA.cy)[:, None] / CAMERA.fy
    shown = (np.abs(rows * depth - HEIGHT) > 0.05) | (rows < 0)  # without the floor itself
    above = np.where(shown, depth, np.float32(0.0))
    found = find_planes(rays_of(above), UP_DIRECTIONS, SceneSettings().planes)
    assert not found.has_floor


def test_points_on_a_line_do_not_stop_the_fit() -> None:
    """No plane is determined by them; rounding must not make the equations singular."""
    for seed in range(300):
        rng = np.random.default_rng(seed)
        x = rng.uniform(-0.5, 0.5, 40)
        rays = np.column_stack([x, rng.uniform() * x + rng.uniform(), 0.2 + 0.1 * x, np.full(40, 1e-3)])
        assert np.isfinite(refit(np.array([[0.1, 0.0, 0.2]]), rays, 30)).all()


@pytest.mark.parametrize("quarters", range(4))
@pytest.mark.parametrize(
    ("boxes", "people"),
    [((), 1), ((TABLE, CABINET), 1), ((CABINET, SIDE_WALL), 1), ((TABLE, CABINET, SIDE_WALL, CEILING), 2)],
    ids=["a person", "furniture", "a wall beside", "walls, a ceiling and two people"],
)
def test_the_floor_of_a_rotated_camera_is_that_on_which_things_stand(
    quarters: int, boxes: tuple[Box, ...], people: int
) -> None:
    """Without gravity, up is found within a degree in images rotated by any multiple of 90 degrees."""
    room = Room(boxes, 0.1, noise=0.002)
    seen = room.see(PERSON).view.metres()
    if people == 2:
        other = room.see((0.45, 2.0))
        seen = np.where(other.mask, other.view.metres(), seen)
    depth, camera, up = seen, CAMERA, room.tilt.T @ np.array([0.0, -1.0, 0.0])
    for _ in range(quarters):
        depth, up = np.rot90(depth), np.array([up[1], -up[0], up[2]])
        middle = camera.cy, camera.width - 1 - camera.cx
        camera = Intrinsics(camera.height, camera.width, camera.fy, camera.fx, *middle)
    found = find_planes(
        sample_rays(depth, camera, fit_noise(depth, SceneSettings().noise), 80),
        UP_DIRECTIONS,
        SceneSettings().planes,
    )
    assert found.up @ up > np.cos(np.radians(1.0))
    assert found.camera_height == pytest.approx(HEIGHT, abs=0.02)


def test_a_wall_beside_is_no_floor_if_the_floor_is_not_visible() -> None:
    """A camera that sees a person to the knees, a wall ahead and one at its side is not taken as rotated."""
    seen = Room((SIDE_WALL,), noise=0.002).see(PERSON)
    depth = seen.view.metres()
    depth[85:] = 0.0  # the floor starts there
    assert not find_planes(rays_of(depth), UP_DIRECTIONS, SceneSettings().planes).has_floor
