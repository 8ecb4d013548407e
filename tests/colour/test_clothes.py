"""The colour of clothes: what is seen, how alike two colours are, and what is remembered."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import norm

from gepf.common.arrays import Array
from gepf.common.body import KEYPOINTS
from gepf.common.frame import Frame, View
from gepf.coordinator.colour.clothes import Clothes, alike_nats, clothes_in, remember
from gepf.coordinator.colour.matching import with_keypoints
from gepf.coordinator.settings import ClothesSettings
from gepf.coordinator.tracking.observation import isolate
from tests.support.people import CAMERA, changed

SETTINGS = ClothesSettings()
RED, BLUE = np.array([0.6, 0.5, 0.2]), np.array([0.5, -0.1, -0.4])


def frame_with(colours: NDArray[np.uint8], depth: NDArray[np.uint16]) -> Frame:
    """A frame with a colour image at any scale."""
    return Frame.of(View(0, 0.0, depth, 1000.0, CAMERA, colours=colours))


def standing_at(column: float, row: float) -> NDArray[np.float32]:
    """Keypoints (17, 3) of a person whose trunk is 20 pixels wide and 40 high, around a pixel."""
    places = np.full((len(KEYPOINTS), 3), 0.1, np.float32)
    for name, across, down in (("shoulder", 10, -20), ("hip", 10, 20)):
        for side, sign in (("left", 1), ("right", -1)):
            places[KEYPOINTS.index(f"{side}_{name}"), :2] = column + sign * across, row + down
    return places


def person_at_100() -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    """Colours and depth of a person in red around pixel (100, 100), in a green room that is not measured."""
    colours = np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)
    depth = np.zeros((CAMERA.height, CAMERA.width), np.uint16)
    colours[:] = 10, 200, 10
    colours[80:121, 90:111], depth[70:131, 85:116] = (180, 60, 30), 2000
    return colours, depth


def seen_of(frame: Frame, keypoints: NDArray[np.float32] | None) -> Array | None:
    """The colour of the clothes of the subject, which is all that the frame measures."""
    subject = isolate(frame, 100)
    assert subject is not None
    return clothes_in(frame, subject if keypoints is None else with_keypoints(subject, {"": keypoints}))


@pytest.mark.parametrize("scale", [1, 2])
def test_the_colour_is_that_of_the_trunk(scale: int) -> None:
    """Of an image at any scale, with a forearm in front of it, and with a rail that is not the subject's."""
    colours, depth = person_at_100()
    colours[95:100, 90:111] = 230, 180, 150  # the forearm
    colours[103:116, 85:116], depth[103:116, 85:116] = (20, 20, 240), 0  # the rail
    image = np.repeat(np.repeat(colours, scale, axis=0), scale, axis=1)
    seen = seen_of(frame_with(image, depth), standing_at(100.0, 100.0))
    assert seen is not None
    red, green, blue = np.array([180, 60, 30]) / 255.0
    expected = np.sqrt((red + green + blue) / 3.0), red - green, 0.5 * (red + green) - blue
    np.testing.assert_allclose(seen, expected, atol=1e-6)


def test_no_colour_is_seen_beside_the_subject_or_without_keypoints() -> None:
    """Nor in a frame without colour, or outside the image."""
    colours, depth = person_at_100()
    frame = frame_with(colours, depth)
    assert seen_of(frame, standing_at(100.0, 100.0)) is not None
    assert seen_of(frame, None) is None
    for column in (-20.0, 125.0, 300.0):
        assert seen_of(frame, standing_at(column, 100.0)) is None
    assert seen_of(changed(frame, colours=None), standing_at(100.0, 100.0)) is None


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
    """Of the last `memory_s` seconds, about."""
    settings = msgspec.structs.replace(SETTINGS, hidden_odds=1e-9)
    rng, seen, clothes = np.random.default_rng(0), list[np.ndarray](), None
    for _ in range(20):
        seen.append(RED + 0.02 * rng.normal(size=3))
        clothes = remember(clothes, seen[-1], 0.5, settings)
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
