"""Track a recording from Python and print one joint.

python examples/library.py SEQ [FRAMES]
"""

from __future__ import annotations

import sys
from itertools import islice

from gepf import Tracker, open_source


def main(path: str, frames: int | None = None) -> None:
    """Print a line for each frame: status, right wrist with its deviation, number of hypotheses."""
    source = open_source(path)
    with Tracker(workers=None, start=source.init) as tracker:  # workers=2 for two processes
        for frame in islice(source, frames):
            estimate = tracker.track(frame)
            x, y, z = estimate.joint("right_wrist")
            deviation = estimate.joint_deviation("right_wrist")
            print(
                f"frame {estimate.frame}, {estimate.status}: right wrist at {x:.2f} {y:.2f} {z:.2f} m, "
                f"give or take {deviation:.2f} m; {len(estimate.hypothesis_weight)} hypotheses"
            )


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else None)
