"""What has moved is told from what was always there, also where pixels flicker between two surfaces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gepf.common.arrays import Mask
from gepf.coordinator.scene.noise import noise_of
from gepf.coordinator.scene.occupancy import ALWAYS, Occupancy, OccupancyChange, accumulate, permanence_of
from gepf.coordinator.scene.scene import Scene
from gepf.coordinator.settings import NoiseSettings, SceneSettings
from tests.support.rooms import CABINET, PERSON, Room

WALL, NEAR = 3.0, 2.0  # metres
NOISE = noise_of(0.001, NoiseSettings())
PIXEL = (0, 0, 1, 1)  # the window of an image of one pixel


def watch(depths: list[float]) -> float:
    """The permanence of the last of the depths that one pixel showed."""
    occupancy = Occupancy.unknown((1, 1))
    for n, depth in enumerate(depths):
        image = np.full((1, 1), depth, np.float32)
        accumulate(image, NOISE, occupancy, 1.0 / (n + 1))
    return float(permanence_of(image, NOISE, occupancy, PIXEL)[0, 0])


@given(st.lists(st.booleans(), min_size=1, max_size=60))
def test_permanence_is_the_share_of_the_time_without_anything_behind(near: list[bool]) -> None:
    """Of a pixel that shows a wall or something nearer, as counted in plain Python."""
    permanence = watch([WALL, *(NEAR if each else WALL for each in near)])
    covered = sum(near) / (len(near) + 1)
    assert abs(permanence - (covered if near[-1] else 1.0 - covered)) < 1e-3


@given(st.integers(1, 20), st.integers(0, 5))
def test_what_hides_the_scene_from_the_first_frame_on_is_permanent(frames: int, holes: int) -> None:
    """Whatever is behind: a person, or a chair. Frames in which it has no depth do not matter."""
    assert watch([NEAR] * frames + [0.0] * holes + [NEAR]) == 1.0


def test_what_comes_before_something_out_of_range_has_moved() -> None:
    """Nothing was measured at the pixel before."""
    assert watch([0.0] * 9 + [NEAR]) < 0.11


def test_what_a_person_uncovers_is_no_part_of_the_past() -> None:
    """A wall behind somebody who goes away has been visible for a short time only."""
    assert watch([NEAR] * 9 + [WALL]) < 0.11


def test_a_single_wrong_depth_is_forgotten() -> None:
    """An outlier behind a wall, then the wall for long: somebody in front of it has moved."""
    occupancy = Occupancy.unknown((1, 1))
    for depth in (WALL, WALL + 0.5, *[WALL] * 300):
        accumulate(np.full((1, 1), depth, np.float32), NOISE, occupancy, 0.03)
    assert permanence_of(np.full((1, 1), WALL, np.float32), NOISE, occupancy, PIXEL)[0, 0] > 0.99
    assert permanence_of(np.full((1, 1), NEAR, np.float32), NOISE, occupancy, PIXEL)[0, 0] < 0.01


def test_the_change_of_an_image_leads_to_the_same_occupancy() -> None:
    """Pixels that did not change are not in it; a pixel that always shows a wall does not change."""
    first, second = Occupancy.unknown((2, 3)), Occupancy.unknown((2, 3))
    counts = []
    for n in range(5):
        image = np.full((2, 3), WALL, np.float32)
        image[0, : n % 3] = NEAR
        pixels = accumulate(image, NOISE, first, 1.0 / (n + 1))
        OccupancyChange.of(first, pixels).apply(second)
        counts.append(len(pixels))
    assert counts[0] == 6
    assert max(counts[1:]) <= 2
    np.testing.assert_array_equal(first.farthest, second.farthest)
    np.testing.assert_array_equal(first.shown, second.shown)
    assert np.all(first.shown[1] == ALWAYS)


def test_who_walks_is_told_from_furniture() -> None:
    """In a room where a cabinet stands and a person walks: by the time since the first frame."""
    scene, room = Scene(SceneSettings()), Room((CABINET,), noise=0.001)
    for number in range(12):
        person = (PERSON[0] - 0.08 * number, PERSON[1])
        image, mask = room.see(person, number)
        view = scene.observe(image)
        scene.learn(view)
    permanence = view.permanence((0, 0, mask.shape[1], mask.shape[0]))
    assert permanence is not None
    cabinet: Mask = room.see(None).view.metres() < Room().see(None).view.metres() - 0.2
    assert np.median(permanence[mask]) < 0.5
    assert np.median(permanence[cabinet & ~mask]) > 0.95


def test_a_smaller_image_starts_again() -> None:
    """Another camera: nothing of the former one is left, also while its frames are empty."""
    scene, room = Scene(SceneSettings()), Room((CABINET,), noise=0.001)
    image, _ = room.see(PERSON)
    scene.learn(scene.observe(image))
    small = replace(image, number=1, time_s=0.1, depth=np.zeros((30, 40), np.uint16))
    change = scene.learn(scene.observe(small))
    assert change.size == (30, 40)
    assert len(change.occupancy.pixels) == 0
