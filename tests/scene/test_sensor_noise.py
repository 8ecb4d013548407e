"""The camera's noise, measured in a depth image whose noise is known."""

from __future__ import annotations

import json
from functools import cache, partial
from pathlib import Path

import msgspec
import numpy as np
import pytest

from gepf.common.arrays import Array
from gepf.common.camera import Intrinsics
from gepf.common.frame import View
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.commands.job import choose_settings
from gepf.coordinator.commands.options import TrackOptions
from gepf.coordinator.scene.noise import NO_NOISE, SensorNoise, assume_noise, measure_noise
from gepf.coordinator.settings import NoiseSettings, preset
from gepf.coordinator.synthesis.noise import add_noise
from gepf.coordinator.synthesis.scenes import arm
from tests.support.people import rendered

CAMERA = Intrinsics(256, 256, 395.0, 395.0, 127.5, 127.5)
DEFAULT = preset("default").refine


@cache
def person() -> Array:
    """Depth (H, W) in metres of the arm's first frame, at half the size."""
    return rendered(human(), arm().poses[:1], CAMERA)[0]


def noisy(noise: SensorNoise, seed: int = 0, scale: float = 5000.0) -> View:
    """The person behind noise."""
    depth_m = add_noise(person(), CAMERA, noise, np.random.default_rng(seed))
    return View(0, 0.0, np.rint(depth_m * scale).astype(np.uint16), scale, CAMERA)


@pytest.mark.parametrize(("depth", "lateral"), [(0.01, 0.0), (0.05, 0.02), (0.15, 0.0), (0.15, 0.02)])
def test_noise_along_depth_is_measured(depth: float, lateral: float) -> None:
    """Within 10 %, noise across or not: on slopes it adds some along depth, less than this."""
    assert measure_noise(noisy(SensorNoise(depth, lateral)), NoiseSettings()).depth == pytest.approx(
        depth, rel=0.1
    )


@pytest.mark.parametrize("lateral", [0.015, 0.025])
def test_noise_across_is_measured(lateral: float) -> None:
    """Within 40 %: an outline is all that shows it, and narrow gaps that noise closes make it seem more."""
    found = measure_noise(noisy(SensorNoise(0.15, lateral)), NoiseSettings())
    assert found.lateral == pytest.approx(lateral, rel=0.4)


def test_a_clean_camera_is_assumed_no_worse_than_it_was() -> None:
    """Without noise, and with steps of a millimetre, settings are unchanged, so are the bytes."""
    for scale in (5000.0, 1000.0):
        assert assume_noise(DEFAULT, measure_noise(noisy(NO_NOISE, scale=scale), NoiseSettings())) == DEFAULT


def test_settings_take_the_noise() -> None:
    """At least what they assume, and across never more than along."""
    loud = assume_noise(DEFAULT, SensorNoise(0.15, 0.03))
    assert (loud.noise_depth, loud.noise_lateral) == (0.15, 0.03)
    assert msgspec.structs.replace(loud, noise_depth=0.01, noise_lateral=0.01) == DEFAULT
    assert assume_noise(DEFAULT, SensorNoise(0.001, 0.3)) == DEFAULT
    assert assume_noise(DEFAULT, SensorNoise(0.02, 0.3)).noise_lateral == 0.02


def test_of_an_image_of_points_the_usual_noise_is_assumed() -> None:
    """Where no three pixels in a row are measured, it is what depth cameras have at that distance."""
    depth = np.zeros((9, 9), dtype=np.uint16)
    depth[::3, ::3] = 2000
    measured = measure_noise(View(0, 0.0, depth, 1000.0, CAMERA), NoiseSettings())
    assert measured.depth == pytest.approx(0.007, abs=0.003)


def test_rounding_is_noise() -> None:
    """A Kinect's steps of 23 mm on smooth slopes: between a step's own deviation and a step by root of 6."""
    step = 2.85e-3 * 2.8**2
    inverse = 1.0 / np.clip(person(), 1e-6, None)
    rounded = np.where(person() > 0.0, 1.0 / (np.rint(inverse / 2.85e-3) * 2.85e-3), 0.0)
    frame = View(0, 0.0, np.rint(1000.0 * rounded).astype(np.uint16), 1000.0, CAMERA)
    found = measure_noise(frame, NoiseSettings())
    expected = step * (found.distance / 2.8) ** 2
    assert expected / np.sqrt(12.0) < found.depth < 1.2 * expected / np.sqrt(6.0)


def test_noise_grows_with_distance() -> None:
    """Along with its square, across in proportion; a noise without a distance is the same at any."""
    near = SensorNoise(0.011, 0.004, 2.0)
    far = near.at(4.0, 0.001)
    assert far.distance == pytest.approx(4.0, rel=0.1)
    assert far.depth == pytest.approx(0.001 + 0.010 * (far.distance / 2.0) ** 2)
    assert far.lateral == pytest.approx(0.004 * far.distance / 2.0)
    assert near.at(2.01, 0.001) == near
    assert SensorNoise(0.15, 0.01).at(3.0, 0.001) == SensorNoise(0.15, 0.01)


def test_densities_begin_as_sharp_as_costs_end() -> None:
    """Where correspondences become soft, a point's cost and its density weigh the same."""
    noises = (
        msgspec.structs.replace(DEFAULT, noise_depth=0.01 * n, noise_lateral=0.1) for n in range(1, 999)
    )
    at = next(each for each in noises if each.is_soft)
    along_cost = (at.noise_lateral / at.noise_depth / at.likelihood_scale) ** 2  # of a squared metre
    assert at.independent_points / at.noise_depth**2 == pytest.approx(along_cost, rel=0.1)


def test_what_the_user_gives_is_not_measured() -> None:
    """Given noise goes into the settings as it is; what is not given stays the preset's."""
    asked = partial(TrackOptions, sequences=[Path("recording")], out=Path("run"))
    assert choose_settings(asked()) == preset("default")
    known = choose_settings(asked(noise_depth=0.1))
    assert (known.refine.noise_depth, known.refine.noise_lateral) == (0.1, DEFAULT.noise_lateral)
    assert not known.measure_noise
    assert choose_settings(asked(noise_depth=0.1, noise_lateral=0.02)).refine.noise_lateral == 0.02
    json.loads(msgspec.json.encode(known))
