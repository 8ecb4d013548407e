"""`gepf publish`: publishes the frames of a camera, or a recorded sequence in real time, like a camera."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from io import BytesIO
from itertools import count

from PIL import Image

from gepf.common.errors import InputError
from gepf.common.frame import View
from gepf.common.protocol.frames import LIVE_END, encode_colour, encode_live
from gepf.common.protocol.keys import check_stream
from gepf.common.transport.bus import Bus
from gepf.common.transport.opening import open_coordinator, open_worker
from gepf.common.transport.session import holder_name
from gepf.coordinator.commands.console import INTERRUPTS
from gepf.coordinator.commands.options import CameraOptions, PublishOptions, SecurityOptions
from gepf.coordinator.commands.progress import Show
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.sources import open_source
from gepf.coordinator.sources.devices.device import AttachedCamera, Shot, vendor_of
from gepf.coordinator.sources.live_stream import colour_key
from gepf.coordinator.sources.source import select_frames

Put = Callable[[bytes], None]


def run_publish(
    options: PublishOptions, camera: CameraOptions, security: SecurityOptions, show: Show
) -> None:
    """Publish the frames in real time, as soon as there is a listener.

    InputError for invalid options, before anything is read. A damaged frame ends the stream.
    """
    secured = security.choose(options.listen, options.connect)
    reached = Pool(0, options.listen, options.connect, secured)
    key = check_stream(options.key, holder_name(secured))
    attached = None
    if vendor_of(options.sequence):
        given = options.rate, options.frames, camera.intrinsics, camera.depth_scale
        if any(given):
            raise InputError(
                "--rate, --frames, --intrinsics and --depth-scale are for recorded sequences; leave them out"
            )
        attached = AttachedCamera(options.sequence, show.say, colour=options.color)
    elif options.color:
        raise InputError("--color is for cameras; leave it out with a recorded sequence")
    else:
        source = open_source(options.sequence, camera.choose())
        if len(source.views) > 1:
            raise InputError(f"{options.sequence} has several cameras; publish each with its own --key")
        numbers = select_frames(source.numbers, options.frames)
    with reach_partner(reached, "subscriber", key, show) as bus:
        publisher = bus.publish(key)
        if not publisher.has_subscriber:
            show.say(f"waiting for a subscriber of {key}")
        while not publisher.has_subscriber:
            time.sleep(0.1)

        def put(payload: bytes) -> None:
            publisher.put(payload)
            INTERRUPTS.check()

        if attached is None:
            images = ((view, None) for view in paced(map(source.view, numbers), options.rate))
            published = play(images, put, publisher.put_blocking)
        else:
            published = play(attached, put, publisher.put_blocking, bus.publish(colour_key(key)).put)
    dropped = f"; the camera dropped {attached.dropped}" if attached and attached.dropped else ""
    show.say(f"{published} frames were published on {key}{dropped}")


def reach_partner(reached: Pool, partner: str, key: str, show: Show) -> Bus:
    """A session at the endpoints, as soon as there is an answer; InputError without endpoints.

    `partner` is who is on the other side of the key. A program that only connects is a client: a router does
    not forward messages between peers, and trackers are peers.
    """
    if reached.listen is not None:
        return open_coordinator(reached.listen_endpoints, reached.connect_endpoints, reached.security)
    if reached.connect is None:
        raise InputError(f"a {partner} needs an endpoint; add --connect ENDPOINT or --listen ENDPOINT")
    line = f"no answer at {reached.connect} yet; waiting for a {partner} of {key}"
    silences = count()

    def hear() -> None:
        if next(silences) == 0:
            show.say(line)
        INTERRUPTS.check()

    return open_worker(reached.connect_endpoints, reached.security, hear)


def play(images: Iterable[Shot], put: Put, put_last: Put, put_colour: Put | None = None) -> int:
    """Publish each image as it comes, and the end of the stream in any case; returns their number."""
    number = 0
    try:
        for view, colour in images:
            if colour is not None and put_colour is not None:
                jpeg = BytesIO()
                Image.fromarray(colour).save(jpeg, "JPEG", quality=90)
                put_colour(encode_colour(view.number, jpeg.getvalue()))
            put(encode_live(view))
            number += 1
    finally:
        put_last(LIVE_END)
    return number


def paced(views: Iterable[View], rate: float | None) -> Iterator[View]:
    """Yield each image at its recorded time after the first, or image k at k / rate s; late ones at once."""
    began, first_s = time.monotonic(), None
    for k, view in enumerate(views):
        first_s = view.time_s if first_s is None else first_s
        due = view.time_s - first_s if rate is None else k / rate
        time.sleep(max(0.0, began + due - time.monotonic()))
        yield view
