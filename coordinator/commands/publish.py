"""`gepf publish`: a recorded sequence as a camera would show it, in real time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from common.errors import InputError
from common.frame import DepthFrame
from common.protocol.frames import encode_live, encode_live_end
from common.protocol.keys import check_stream
from common.transport.bus import Bus
from common.transport.channels import Publisher
from common.transport.opening import open_coordinator, open_worker
from coordinator.commands.console.interrupts import INTERRUPTS
from coordinator.commands.console.progress import Show
from coordinator.commands.options.arguments import PublishOptions, SecurityOptions
from coordinator.commands.options.choices import choose_pool, secure
from coordinator.commands.workers import end_as_interrupted
from coordinator.pool.options import Pool
from coordinator.sources import open_source
from coordinator.sources.camera import AS_RECORDED, CameraOptions, parse_camera_options
from coordinator.sources.source import select_frames

LOOK = 0.05  # seconds between looks for a listener
FASTEST = 1000.0  # frames per second


@dataclass(frozen=True, slots=True)
class Broadcast:
    """One `gepf publish`."""

    sequence: Path
    key: str
    reached: Pool  # by whom, as far as endpoints go
    rate: float | None = None  # frames per second; None for the sequence's own
    frames: str | None = None
    given: CameraOptions = AS_RECORDED


def run_publish(options: PublishOptions, security: SecurityOptions, show: Show) -> None:
    """Do a `gepf publish`. Raises InputError for options that make no sense, before anything is read."""
    secured = secure(security, options.listen, options.connect)
    end_as_interrupted()
    reached = choose_pool(None, options.listen, options.connect, secured)
    given = parse_camera_options(options.camera.intrinsics, options.camera.depth_scale)
    broadcast = Broadcast(options.sequence, options.key, reached, options.rate, options.frames, given)
    publish_sequence(broadcast, show)


def publish_sequence(broadcast: Broadcast, show: Show) -> None:
    """Publish the frames in real time, from when somebody listens.

    A damaged frame ends it: what was published before is followed by the end of the stream.
    """
    key = check_stream(broadcast.key, guarded=broadcast.reached.security is not None)
    rate = check_rate(broadcast.rate)
    source = open_source(broadcast.sequence, broadcast.given)
    numbers = select_frames(source.numbers, broadcast.frames)
    with open_session(broadcast.reached, key, show) as bus:
        publisher = bus.publish(key)
        wait_for_listener(publisher, lambda: show.say(f"waiting for someone to listen to {key}"))
        play(map(source.frame, numbers), rate, publisher)
    show.say(f"{len(numbers)} frames were published on {key}")


def check_rate(rate: float | None) -> float | None:
    """The rate, if frames can be published at it; InputError otherwise."""
    if rate is not None and not 0 < rate <= FASTEST:
        raise InputError(f"--rate {rate:g} is no frame rate; give up to {FASTEST:g} frames per second")
    return rate


def open_session(reached: Pool, key: str, show: Show) -> Bus:
    """A session at the endpoints, when somebody answers there; InputError if there is none.

    Who only connects is a client: a router passes nothing on from peer to peer, and trackers are peers.
    """
    if reached.listen is not None:
        return open_coordinator(reached.listen_endpoints, reached.connect_endpoints, reached.security)
    if reached.connect is None:
        raise InputError("nobody could receive this; add --connect or --listen with an endpoint")
    line = f"nobody answers at {reached.connect} yet; waiting for someone there to listen to {key}"
    return open_worker(reached.connect_endpoints, reached.security, once(lambda: show.say(line)))


def once(report: Callable[[], None]) -> Callable[[float], None]:
    """Reports the first silence alone, and lets an interrupt end the wait."""
    silences = count()

    def hear(_: float) -> None:
        if next(silences) == 0:
            report()
        INTERRUPTS.check()

    return hear


def wait_for_listener(publisher: Publisher, report: Callable[[], None]) -> None:
    """Return when somebody listens; `report` is called if nobody does yet."""
    if not publisher.followed:
        report()
    while not publisher.followed:
        time.sleep(LOOK)


def play(frames: Iterable[DepthFrame], rate: float | None, publisher: Publisher) -> None:
    """Publish each frame at its time, then the end; also when interrupted."""
    try:
        for frame in paced(frames, rate):
            publisher.put(encode_live(frame))
            INTERRUPTS.check()
    finally:
        publisher.put_surely(encode_live_end())


def paced(frames: Iterable[DepthFrame], rate: float | None) -> Iterator[DepthFrame]:
    """Each frame as long after the first as it was taken, or frame k at k / rate s; a late one at once."""
    began, first_s = time.monotonic(), None
    for k, frame in enumerate(frames):
        first_s = frame.time_s if first_s is None else first_s
        due = frame.time_s - first_s if rate is None else k / rate
        time.sleep(max(0.0, began + due - time.monotonic()))
        yield frame
