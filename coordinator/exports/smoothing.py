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

from gepf.common.arrays import Array
from gepf.common.body import ROTATION, BodyModel
from gepf.common.errors import InputError
from gepf.common.kinematics.rotations import euler_angles, handedness
from gepf.coordinator.exports.bones import continuous
from gepf.coordinator.results.track import Track
from gepf.coordinator.sources.source import rising


def smooth_track(track: Track, model: BodyModel, cutoff_hz: float) -> Track:
    """The track with low-pass filtered angles, joints and pose; deviations, hypotheses and status stay.

    Spherical joints are filtered as quaternions, other values separately. InputError for a cut-off frequency
    that is too high for the frame rate, and for tracks that are too short.
    """
    low_pass = LowPass(track, cutoff_hz)
    poses = track.pose[low_pass.kept]
    smooth = low_pass(np.where(model.kinds == ROTATION, np.unwrap(poses, axis=0), poses))
    for first in model.balls.tolist():
        ball = slice(first, first + 3)
        turns = Rotation.from_davenport(model.axes[ball], "intrinsic", poses[:, ball])
        turns = Rotation.from_quat(low_pass(continuous(turns)))
        smooth[:, ball] = angles_about(model.axes[ball], turns, smooth[:, ball])
    angle, joints = low_pass(track.angle[low_pass.kept]), low_pass(track.joint_positions[low_pass.kept])
    return replace(track, angle=angle, joint_positions=joints, pose=smooth)


class LowPass:
    """Filters values of a track's known frames, resampled to its rate and back to all its times."""

    def __init__(self, track: Track, cutoff_hz: float) -> None:
        self.kept = ~track.unknown | track.unknown.all()
        self._times = rising(track.time_s)
        steps = np.diff(self._times)
        if len(steps) < 2:
            raise InputError("a run of fewer than three frames cannot be smoothed; leave --smooth out")
        rate = 1.0 / float(np.median(steps))
        if not 0.0 < cutoff_hz < 0.5 * rate:
            raise InputError(
                f"--smooth {cutoff_hz:g} is not between 0 and {0.5 * rate:.3g} Hz, half the frame rate; try 6"
            )
        count = max(3, round((self._times[-1] - self._times[0]) * rate) + 1)
        self._even = np.linspace(self._times[0], self._times[-1], count)
        of_one_pass = (2.0**0.5 - 1.0) ** (1.0 / 4.0)  # two passes leave half the power at the cut-off
        warped = np.tan(np.pi * cutoff_hz / rate) / of_one_pass
        self._filter = butter(2, np.arctan(warped) / np.pi * rate, fs=rate)

    def __call__(self, values: Array) -> Array:
        """Values (F, ...) of all frames from those (K, ...) of the `kept` (F,)."""
        columns = values.reshape(len(values), -1).T
        even = [np.interp(self._even, self._times[self.kept], column) for column in columns]
        padding = min(3 * len(self._filter[0]), len(self._even) - 1)
        back = [np.interp(self._times, self._even, filtfilt(*self._filter, c, padlen=padding)) for c in even]
        return np.stack(back, axis=1).reshape(-1, *values.shape[1:])


def angles_about(axes: Array, rotations: Rotation, near: Array) -> Array:
    """Angles (F, 3) of rotations (F,) about a joint's axes (3, 3), on the branch nearest to `near` (F, 3)."""
    handed = handedness(axes, 0)
    inside = axes @ rotations.as_matrix() @ axes.T
    found = [euler_angles(*each) for each in zip(inside, handed * near, strict=True)]
    return np.array(found) * handed
