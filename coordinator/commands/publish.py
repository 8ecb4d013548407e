"""`gepf publish`: publishes a recorded sequence in real time, like a camera."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from itertools import count

from common.errors import InputError
from common.frame import DepthFrame
from common.protocol.frames import encode_live, encode_live_end
from common.protocol.keys import check_stream
from common.transport.bus import Bus
from common.transport.channels import Publisher
from common.transport.opening import open_coordinator, open_worker
from coordinator.commands.console import INTERRUPTS
from coordinator.commands.options import CameraOptions, PublishOptions, SecurityOptions
from coordinator.commands.progress import Show
from coordinator.pool.options import Pool
from coordinator.sources import open_source
from coordinator.sources.camera import parse_camera_options
from coordinator.sources.source import select_frames


def run_publish(
    options: PublishOptions, camera: CameraOptions, security: SecurityOptions, show: Show
) -> None:
    """Publish the frames in real time, as soon as there is a listener.

    InputError for invalid options, before anything is read. A damaged frame ends the stream.
    """
    secured = security.choose(options.listen, options.connect)
    reached = Pool(0, options.listen, options.connect, secured)
    key = check_stream(options.key, guarded=secured is not None)
    source = open_source(options.sequence, parse_camera_options(camera.intrinsics, camera.depth_scale))
    numbers = select_frames(source.numbers, options.frames)
    with open_session(reached, "subscriber", key, show) as bus:
        publisher = bus.publish(key)
        if not publisher.has_subscriber:
            show.say(f"waiting for a subscriber of {key}")
        while not publisher.has_subscriber:
            time.sleep(0.1)
        play(map(source.frame, numbers), options.rate, publisher)
    show.say(f"{len(numbers)} frames were published on {key}")


def open_session(reached: Pool, partner: str, key: str, show: Show) -> Bus:
    """A session at the endpoints, as soon as there is an answer; InputError without endpoints.

    `partner` is who is on the other side of the key. A program that only connects is a client: a router does
    not forward messages between peers, and trackers are peers.
    """
    if reached.listen is not None:
        return open_coordinator(reached.listen_endpoints, reached.connect_endpoints, reached.security)
    if reached.connect is None:
        raise InputError(f"no {partner} could connect; add --connect or --listen with an endpoint")
    line = f"no answer at {reached.connect} yet; waiting for a {partner} of {key}"
    silences = count()

    def hear(_: float) -> None:
        if next(silences) == 0:
            show.say(line)
        INTERRUPTS.check()

    return open_worker(reached.connect_endpoints, reached.security, hear)


def play(frames: Iterable[DepthFrame], rate: float | None, publisher: Publisher) -> None:
    """Publish each frame at its time, then the end of the stream, also after an interrupt."""
    try:
        for frame in paced(frames, rate):
            publisher.put(encode_live(frame))
            INTERRUPTS.check()
    finally:
        publisher.put_blocking(encode_live_end())


def paced(frames: Iterable[DepthFrame], rate: float | None) -> Iterator[DepthFrame]:
    """Yield each frame at its recorded time after the first, or frame k at k / rate s; late ones at once."""
    began, first_s = time.monotonic(), None
    for k, frame in enumerate(frames):
        first_s = frame.time_s if first_s is None else first_s
        due = frame.time_s - first_s if rate is None else k / rate
        time.sleep(max(0.0, began + due - time.monotonic()))
        yield frame
