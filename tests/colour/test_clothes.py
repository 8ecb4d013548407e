"""The colour of clothes: what is seen, how alike two colours are, and what is remembered."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from scipy.stats import norm

from gepf.common.body import KEYPOINTS
from gepf.common.frame import Frame, View
from gepf.coordinator.colour.clothes import Clothes, alike_nats, clothes_in, remember
from gepf.coordinator.settings import ClothesSettings
from tests.support.people import CAMERA

SETTINGS = ClothesSettings()
RED, BLUE = np.array([0.6, 0.5, 0.2]), np.array([0.5, -0.1, -0.4])


def frame_with(colours: np.ndarray) -> Frame:
    """A frame with a colour image at any scale, and no depth."""
    return Frame.of(
        View(0, 0.0, np.zeros((CAMERA.height, CAMERA.width), np.uint16), 1000.0, CAMERA, colours=colours)
    )


def standing_at(column: float, row: float) -> np.ndarray:
    """Keypoints (17, 3) of a person whose trunk is 20 pixels wide and 40 high, around a pixel."""
    places = np.full((len(KEYPOINTS), 3), 0.1, np.float32)
    for name, across, down in (("shoulder", 10, -20), ("hip", 10, 20)):
        for side, sign in (("left", 1), ("right", -1)):
            places[KEYPOINTS.index(f"{side}_{name}"), :2] = column + sign * across, row + down
    return places


@pytest.mark.parametrize("scale", [1, 2])
def test_the_colour_is_that_of_the_trunk(scale: int) -> None:
    """Of an image at any scale, with gaps of the registration, and with an arm in front of a part."""
    colours = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
    colours[:] = 10, 200, 10
    colours[80:121, 90:111] = 180, 60, 30
    colours[95:100, 90:111] = 230, 180, 150  # a forearm
    colours[105:110, 90:111] = 0  # a gap
    image = np.repeat(np.repeat(colours, scale, axis=0), scale, axis=1)
    seen = clothes_in(frame_with(image), {"": standing_at(100.0, 100.0)})
    assert seen is not None
    red, green, blue = np.array([180, 60, 30]) / 255.0
    expected = np.sqrt((red + green + blue) / 3.0), red - green, 0.5 * (red + green) - blue
    np.testing.assert_allclose(seen, expected, atol=1e-6)


def test_no_colour_is_seen_outside_the_image_or_without_keypoints() -> None:
    """Nor in a frame without colour, or where registration left a gap."""
    colours = np.full((CAMERA.height, CAMERA.width, 3), 99, np.uint8)
    assert clothes_in(frame_with(colours), {}) is None
    assert clothes_in(frame_with(colours), {"": standing_at(-20.0, 100.0)}) is None
    assert clothes_in(frame_with(0 * colours), {"": standing_at(100.0, 100.0)}) is None


def test_how_alike_two_colours_are() -> None:
    """A ratio of two normal densities, one of which may be that of something else."""
    rng = np.random.default_rng(0)
    same, other = (
        np.array([brightness, hue, hue])
        for brightness, hue in (
            (SETTINGS.brightness_deviation, SETTINGS.hue_deviation),
            (SETTINGS.other_brightness_deviation, SETTINGS.other_hue_deviation),
        )
    )
    for _ in range(20):
        seen = RED + rng.normal(size=3) * other * rng.uniform(0.0, 2.0)
        by_same, by_other = (norm.logpdf(seen, RED, scatter).sum() for scatter in (same, other))
        share = SETTINGS.hidden_odds / (1.0 + SETTINGS.hidden_odds)
        mixed = np.logaddexp(np.log(1.0 - share) + by_same, np.log(share) + by_other)
        assert np.isclose(alike_nats(Clothes(tuple(RED), 1.0), seen, SETTINGS), mixed - by_other)
    assert alike_nats(Clothes(tuple(RED), 1.0), RED, SETTINGS) > 2.0
    assert alike_nats(Clothes(tuple(RED), 1.0), BLUE, SETTINGS) < -2.0
    assert alike_nats(None, RED, SETTINGS) == alike_nats(Clothes(tuple(RED), 1.0), None, SETTINGS) == 0.0


def test_what_is_remembered_is_the_mean_of_what_was_seen() -> None:
    """Of the last `memory_s` seconds, about. Nothing seen changes nothing."""
    settings = msgspec.structs.replace(SETTINGS, hidden_odds=1e-9)
    rng, seen, clothes = np.random.default_rng(0), list[np.ndarray](), None
    for _ in range(20):
        seen.append(RED + 0.02 * rng.normal(size=3))
        clothes = remember(clothes, seen[-1], 0.5, settings)
        assert remember(clothes, None, 0.5, settings) is clothes
    assert clothes is not None
    np.testing.assert_allclose(clothes.colour, np.mean(seen, axis=0), rtol=1e-6)
    assert np.isclose(clothes.seen_s, 10.0)


def test_somebody_in_front_does_not_change_what_is_remembered_but_new_clothes_do() -> None:
    """A second changes little; after some minutes the new clothes are those of the person."""
    clothes: Clothes | None = Clothes(tuple(RED), SETTINGS.memory_s)
    for step in range(int(600.0 / 0.1)):
        clothes = remember(clothes, BLUE, 0.1, SETTINGS)
        if step == 10:
            assert alike_nats(clothes, RED, SETTINGS) > 2.0
    assert alike_nats(clothes, BLUE, SETTINGS) > 2.0
