"""Track the frames that a camera publishes. Tracker and publisher can be started in either order.

python examples/live_tracking.py camera/depth tcp/127.0.0.1:7447 [INIT]
gepf publish SEQ --key camera/depth --connect tcp/127.0.0.1:7447
"""

from __future__ import annotations

import sys

import gepf


def main(key: str, endpoint: str, start: str | None = None) -> None:
    """Print a line for each frame, with the right wrist if it is known, until no frame comes for 10 s."""
    camera = gepf.live(key, listen=endpoint, idle_timeout=10.0)
    with gepf.Tracker(workers=2, start=start) as tracker:
        for estimate in tracker.follow(camera):
            x, y, z = estimate.joint("right_wrist")
            known = f": {x:.2f} {y:.2f} {z:.2f} m" if estimate.status in ("tracked", "ambiguous") else ""
            print(f"frame {estimate.frame} {estimate.status}{known}", flush=True)
    print(f"{camera.counts['skipped']} of {camera.counts['received']} frames were skipped")


if __name__ == "__main__":
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    main(*sys.argv[1:])
