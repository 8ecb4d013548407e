"""Smoothing of a run: a low-pass filter without delay.

It is a Butterworth filter of second order, applied forward and backward, as is usual in biomechanics (Winter,
"Biomechanics and Motor Control of Human Movement"). The effective order is four, with half the power at the
cut-off frequency. Frames without a known pose (lost, searching, absent) and missing frames are interpolated
first.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.signal import butter, filtfilt
from scipy.spatial.transform import Rotation

from common.arrays import Array
from common.body import BodyModel
from common.errors import InputError
from common.kinematics.rotations import euler_angles
from coordinator.exports.bones import continuous
from coordinator.results.track import Track


def smooth_track(track: Track, model: BodyModel, cutoff_hz: float) -> Track:
    """The track with low-pass filtered angles, joints and pose; deviations, hypotheses and status stay.

    InputError for a cut-off frequency that is too high for the frame rate, and for tracks that are too short.
    """
    low_pass = LowPass(track, cutoff_hz)
    frames, known = np.arange(len(track.frame)), ~track.unknown
    if known.any():  # each frame's last known one; the first of all for those before it
        frames = np.maximum.accumulate(np.where(known, frames, np.argmax(known)))
    return replace(
        track,
        angle=low_pass(track.angle),
        joint_positions=low_pass(track.joint_positions),
        pose=smooth_pose(model, track.pose[frames], low_pass),
    )


class LowPass:
    """Filters values of a track's frames, resampled to its rate and back to its times."""

    def __init__(self, track: Track, cutoff_hz: float) -> None:
        kept = ~track.unknown
        self._times = track.time_s
        self._kept = kept if kept.sum() > 1 else np.ones_like(kept)
        steps = np.diff(self._times)
        if len(self._times) < 3 or not np.all(steps > 0.0):
            raise InputError("a run of less than three frames cannot be smoothed; leave --smooth out")
        rate = 1.0 / float(np.median(steps))
        if not 0.0 < cutoff_hz < 0.5 * rate:
            raise InputError(
                f"--smooth {cutoff_hz:g} is not between 0 and half of {rate:.3g} frames a second; 6 is usual"
            )
        count = max(3, round((self._times[-1] - self._times[0]) * rate) + 1)
        self._even = np.linspace(self._times[0], self._times[-1], count)
        of_one_pass = (2.0**0.5 - 1.0) ** (1.0 / 4.0)  # two passes leave half the power at the cut-off
        warped = np.tan(np.pi * cutoff_hz / rate) / of_one_pass
        self._filter = butter(2, np.arctan(warped) / np.pi * rate, fs=rate)

    def __call__(self, values: Array) -> Array:
        """Low-pass filter values (F, ...) over the frames."""
        columns = values.reshape(len(values), -1)
        times, kept = self._times[self._kept], columns[self._kept]
        even = np.stack([np.interp(self._even, times, column) for column in kept.T], axis=1)
        usual = 3 * len(self._filter[0])
        smooth = filtfilt(*self._filter, even, axis=0, padlen=min(usual, len(even) - 1))
        back = [np.interp(self._times, self._even, column) for column in smooth.T]
        return np.stack(back, axis=1).reshape(values.shape)


def smooth_pose(model: BodyModel, poses: Array, low_pass: LowPass) -> Array:
    """Filter poses (F, D): spherical joints as quaternions, other values separately, angles unwrapped."""
    turned = np.unwrap(poses, axis=0)
    turned[:, model.kinds == 0] = poses[:, model.kinds == 0]
    smooth = low_pass(turned)
    for first in model.balls.tolist():
        ball = slice(first, first + 3)
        turns = [Rotation.from_rotvec(poses[:, a, None] * model.axes[a]) for a in range(first, first + 3)]
        quaternions = low_pass(continuous(turns[0] * turns[1] * turns[2]))
        smooth[:, ball] = angles_about(model.axes[ball], Rotation.from_quat(quaternions), poses[:, ball])
    return smooth


def angles_about(axes: Array, rotations: Rotation, near: Array) -> Array:
    """Angles (F, 3) of rotations (F,) about a joint's axes (3, 3), on the branch nearest to `near` (F, 3)."""
    handed = np.sign(np.linalg.det(axes))
    inside = handed * axes @ rotations.as_matrix() @ (handed * axes).T
    found = [euler_angles(*each) for each in zip(inside, handed * near, strict=True)]
    angles: Array = handed * np.array(found).reshape(near.shape)
    return angles
