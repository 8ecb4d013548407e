"""Subscribe to the results of a tracker while it tracks.

gepf track SEQ --out DIR --listen tcp/127.0.0.1:7447 --publish robot/person
python examples/live_results.py tcp/127.0.0.1:7447 robot/person [JOINT ANGLE]
"""

from __future__ import annotations

import sys

import msgpack  # type: ignore[import-untyped]
import zenoh


def main(endpoint: str, key: str, joint: str = "right_wrist", angle: str = "right_elbow_flexion") -> None:
    """Print a line for each frame: the position of a joint and an angle, if they are known."""
    with connect(endpoint) as session, session.declare_subscriber(key) as subscriber:
        for sample in subscriber:
            estimate = msgpack.unpackb(sample.payload.to_bytes())
            if estimate["kind"] == "estimates-end":
                break
            joints, angles = estimate["joints"], estimate["angles"]
            if joint not in joints or angle not in angles:
                sys.exit(f"choose a joint of {', '.join(joints)} and an angle of {', '.join(angles)}")
            known = ""
            if joints[joint] is not None:  # null before a person is found
                x, y, z = joints[joint]
                known = f": {joint} {x:.2f} {y:.2f} {z:.2f} m, {angle} {angles[angle]:.2f} rad"
            print(f"{estimate['frame']} {estimate['status']}{known}", flush=True)


def connect(endpoint: str) -> zenoh.Session:
    """Connect, and wait for the tracker if necessary. Ctrl-C takes effect after an attempt, at most 2 s."""
    once = f'endpoints: ["{endpoint}"], timeout_ms: 2000, exit_on_failure: true'
    config = zenoh.Config.from_json5(f'{{mode: "client", connect: {{{once}}}}}')
    said = False
    while True:
        try:
            return zenoh.open(config)
        except zenoh.ZError as error:
            if "Unable to connect" not in str(error):
                raise
            if not said:
                print(f"no answer at {endpoint} yet; waiting", file=sys.stderr)
            said = True


if __name__ == "__main__":
    if len(sys.argv) not in (3, 5):
        sys.exit(__doc__)
    main(*sys.argv[1:])
