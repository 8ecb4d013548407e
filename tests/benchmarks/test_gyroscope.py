"""Angular speeds beside a gyroscope's, on motion that is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io

from benchmarks.gyroscope import GYROSCOPE_HZ, agree, angular_speed, compare, read_gyroscope
from benchmarks.recordings import JOINTS, Recording
from benchmarks.tracking import Outcome
from gepf.common.arrays import Array
from gepf.common.errors import InputError

FPS, SECONDS, LATE_S = 19.0, 4.0, 0.3
FRAMES = round(SECONDS * FPS)


def angle(time_s: Array) -> Array:
    """A limb that swings to and fro, ever faster, radians."""
    return np.asarray(0.8 * np.sin(2.0 * time_s + 0.6 * time_s**2))


def bones(fps: float = FPS) -> Array:
    """The limb's directions (F, 3), with a length that changes, as bones of skeletons do."""
    turned = angle(np.arange(round(SECONDS * fps)) / fps)
    length = 0.25 + 0.02 * np.cos(np.arange(len(turned)))
    return np.asarray(length[:, None] * np.stack([np.sin(turned), -np.cos(turned), 0.0 * turned], axis=1))


def gyroscope() -> Array:
    """Its angular speed (N,), radians per second, by a clock that started earlier."""
    times = np.arange(round((SECONDS + 2.0 * LATE_S) * GYROSCOPE_HZ)) / GYROSCOPE_HZ - LATE_S
    return np.asarray(np.abs(np.gradient(angle(times), times)))


def test_a_perfect_track_agrees_and_its_lag_is_measured() -> None:
    """Speeds of the true directions: correlation 1, an error that only sampling makes, the lag."""
    found = agree(angular_speed(bones(), FPS), FPS, gyroscope())
    assert found.correlation > 0.995
    assert found.rms < 0.1 * np.degrees(gyroscope().max())
    assert found.lag_s == pytest.approx(LATE_S, abs=0.03)


def test_a_wrong_frame_rate_is_noticed() -> None:
    """The same directions, as if they were of 30 frames a second: other speeds at other times."""
    right = agree(angular_speed(bones(), FPS), FPS, gyroscope())
    wrong = agree(angular_speed(bones(), 30.0), 30.0, gyroscope())
    assert wrong.correlation < right.correlation - 0.1
    assert wrong.rms > 2.0 * right.rms


def test_frames_without_a_pose_do_not_count() -> None:
    """A gap in a track leaves the rest of it."""
    gap = bones()
    gap[10:16] = np.nan
    found = agree(angular_speed(gap, FPS), FPS, gyroscope())
    assert found.correlation > 0.99


@pytest.mark.parametrize(
    ("action", "limb"), [(21, ("left_elbow", "left_wrist")), (22, ("left_hip", "left_knee"))]
)
def test_the_limb_with_the_gyroscope_is_compared(action: int, limb: tuple[str, str]) -> None:
    """The person's right forearm in actions 1 to 21, then the right thigh: left in the mirrored image."""
    upper, lower = map(JOINTS.index, limb)
    unrelated = np.random.default_rng(0).normal(size=(FRAMES, len(JOINTS), 3))
    joints = unrelated.copy()
    joints[:, lower] = joints[:, upper] + bones()
    recording = Recording("a_s", Path(), Path(), action, 1)
    holds, seconds = np.ones(joints.shape[:2], dtype=bool), np.zeros(FRAMES)
    outcome = Outcome(recording, joints, unrelated, holds, seconds, FPS, {}, 1.75)
    found = compare(0, outcome, gyroscope())
    assert found.tracked.correlation > 0.995
    assert found.vendor.correlation < 0.9


def test_speeds_are_read_from_the_three_angular_rates(tmp_path: Path) -> None:
    """After the accelerations, in degrees per second; a missing file is named."""
    recording = Recording("a5_s3", tmp_path / "depth" / "a5_s3_t1_depth.mat", tmp_path, 5, 3)
    with pytest.raises(InputError, match=r"a5_s3_t1_inertial\.mat is missing"):
        read_gyroscope(recording)
    (tmp_path / "inertial").mkdir()
    rows = np.array([[0.0, 1.0, 0.0, 0.0, 0.0, 90.0], [0.0, 1.0, 0.0, 180.0, 0.0, 0.0]])
    scipy.io.savemat(tmp_path / "inertial" / "a5_s3_t1_inertial.mat", {"d_iner": rows})
    np.testing.assert_allclose(read_gyroscope(recording), [0.5 * np.pi, np.pi])
