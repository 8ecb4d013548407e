"""Angles of a tracked person against those of the true joints, and how far they step from frame to frame.

python -m benchmarks.angles RUN [TRUTH.npz]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coordinator.results.evaluation import errors_by_angle, read_truth
from coordinator.results.track import Track, read_track_with_angles

Array = NDArray[np.float64]


def main(run: str, truth: str | None = None) -> None:
    """Print the largest steps, and with a truth the errors of each angle, degrees."""
    track = read_track_with_angles(Path(run))
    print(f"largest step of the pose {largest(track.pose[:, 3:], turns=True)}, of the angles ", end="")
    print(largest(angles_of(track), turns=False))
    if truth is None:
        return
    for name, errors in errors_by_angle(track, read_truth(Path(truth))).items():
        print(
            f"{name:26} mean {np.nanmean(errors):5.1f}  median {np.nanmedian(errors):5.1f}"
            f"  worst {np.nanmax(errors):5.1f}"
        )


def angles_of(track: Track) -> Array:
    """The angles (F, A), radians."""
    if track.angle is None:
        raise SystemExit("this run has no angles and no body to take them from; track it again")
    return track.angle


def largest(values: Array, *, turns: bool) -> str:
    """The largest change between frames, degrees, whole turns aside, and how many are above 60."""
    steps = np.degrees(np.diff(values, axis=0))
    steps = np.abs((steps + 180.0) % 360.0 - 180.0 if turns else steps)
    return f"{steps.max():.1f} ({int((steps > 60.0).sum())} above 60)"


if __name__ == "__main__":
    main(*sys.argv[1:3])
