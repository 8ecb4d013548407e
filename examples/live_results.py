"""Hear what a tracker knows while it tracks.

gepf track SEQ --out DIR --listen tcp/127.0.0.1:7447 --publish robot/person
python examples/live_results.py tcp/127.0.0.1:7447 robot/person
"""

from __future__ import annotations

import sys

import msgpack  # type: ignore[import-untyped]
import zenoh


def main(endpoint: str, key: str) -> None:
    """A line a frame: where the right wrist is, and how far the right elbow is bent."""
    with connect(endpoint) as session, session.declare_subscriber(key) as subscriber:
        for sample in subscriber:
            told = msgpack.unpackb(sample.payload.to_bytes())
            if told["kind"] == "estimates-end":
                break
            x, y, z = told["joints"].get("right_wrist", (0.0, 0.0, 0.0))
            elbow = told["angles"].get("right_elbow_flexion", 0.0)
            print(f"{told['frame']} {told['status']}: wrist {x:.2f} {y:.2f} {z:.2f} m, elbow {elbow:.2f} rad")


def connect(endpoint: str) -> zenoh.Session:
    """Wait for the tracker, if it is not there yet; while an attempt lasts, 2 s, Python hears no Ctrl-C."""
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
                print(f"nobody answers at {endpoint} yet; waiting", file=sys.stderr)
            said = True


if __name__ == "__main__":
    main(*sys.argv[1:3])
