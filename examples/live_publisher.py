"""Publish the depth images of a camera, here of a plate that moves away, for a tracker that listens.

gepf track zenoh:camera/depth --out live/ --listen tcp/127.0.0.1:7447
python examples/live_publisher.py tcp/127.0.0.1:7447 camera/depth
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator

import msgpack  # type: ignore[import-untyped]
import numpy as np
import zenoh
from numpy.typing import NDArray

END = msgpack.packb({"kind": "live-end", "version": 1})


def message(number: int, time_s: float, depth: NDArray[np.uint16]) -> bytes:
    """One image (H, W) in millimetres, 0 where there is no depth."""
    height, width = depth.shape
    camera = {"width": width, "height": height, "fx": 580.0, "fy": 580.0, "cx": 319.5, "cy": 239.5}
    fields = {"kind": "live-frame", "version": 1, "number": number, "time_s": time_s, "depth_scale": 1000.0}
    image = ["<u2", [height, width], depth.astype("<u2").tobytes()]
    return bytes(msgpack.packb({**fields, "intrinsics": camera, "depth": image}))


def camera() -> Iterator[tuple[float, NDArray[np.uint16]]]:
    """Times in seconds and images: replace it by your camera."""
    for number in range(90):
        depth = np.zeros((480, 640), np.uint16)
        depth[200:280, 280:360] = 2000 + number
        yield time.monotonic(), depth
        time.sleep(1 / 30)


def main(endpoint: str, key: str) -> None:
    """Publish all images, and then the end, which must not be dropped."""
    config = zenoh.Config.from_json5(f'{{mode: "client", connect: {{endpoints: ["{endpoint}"]}}}}')
    with zenoh.open(config) as session:
        publisher = session.declare_publisher(key)
        for number, (time_s, depth) in enumerate(camera()):
            publisher.put(message(number, time_s, depth))
        session.put(key, END, congestion_control=zenoh.CongestionControl.BLOCK)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
