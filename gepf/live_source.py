"""Live input for users of the library."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from gepf.common.closing import Closing
from gepf.common.errors import InputError
from gepf.common.frame import Frame
from gepf.common.protocol.keys import check_stream
from gepf.common.transport.bus import Bus
from gepf.common.transport.opening import open_coordinator
from gepf.common.transport.session import holder_name
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.security.access import TlsFiles, choose_security
from gepf.coordinator.sources.live import LiveFrames, from_first_seen
from gepf.coordinator.sources.live_stream import LiveCamera, colour_key
from gepf.coordinator.sources.rig import live_cameras
from gepf.refiners import said_in_python

log = logging.getLogger("gepf")


class LiveSource(LiveFrames, Closing):
    """Iterates over the newest depth images that are published on a key.

    An iteration receives images until the publisher ends the stream, is silent for too long, or `close` is
    called. It can be left early, and another iteration can follow. `counts` has the number of received
    images, of those skipped for a newer one, and of those rejected because they did not fit the stream.
    `stream` changes before the first image of a new stream; tracking must start again with that image. Use
    `live` to create a source.

    Use it as a context manager if an iteration may stay unfinished outside a `for` loop, as with `next`.
    """

    def __init__(
        self, cameras: Sequence[LiveCamera], reached: Pool, idle: float | None, *, color: bool
    ) -> None:
        super().__init__(cameras, log.info, idle=idle)
        self._reached, self._color = reached, color
        self._session: Bus | None = None  # of the present iteration

    def __iter__(self) -> Iterator[Frame]:
        reached = self._reached
        with said_in_python():
            opened = open_coordinator(reached.listen_endpoints, reached.connect_endpoints, reached.security)
        with opened as bus:
            self._session = bus
            for place, camera in enumerate(self.cameras):
                if self._color:
                    bus.subscribe(colour_key(camera.key), partial(self._hear_colour, place))
                bus.subscribe(camera.key, partial(self._hear, place))
                log.info("listening on %s", camera.key)
            yield from from_first_seen(super().__iter__(), log.info)

    def _hear(self, place: int, _: str, payload: bytes) -> None:
        self.receive(payload, place=place)

    def _hear_colour(self, place: int, _: str, payload: bytes) -> None:
        self.receive_colour(payload, place=place)

    def close(self) -> None:
        """Stop receiving, and end the iteration after the waiting image, if any; callable from any thread."""
        self.end()
        if self._session is not None:
            self._session.close()


def live(
    key: str | Path,
    listen: str | None = None,
    connect: str | None = None,
    *,
    idle_timeout: float | None = None,
    color: bool = True,
    tls: TlsFiles | None = None,
    insecure: bool = False,
) -> LiveSource:
    """Depth images that are published on a Zenoh key, for `follow` of a tracker.

    Args:
        key: Names between slashes, such as camera/depth; with `tls` under gepf/live/ and the name in the
            certificate, such as gepf/live/coordinator/depth. Or the file of a rig whose cameras are live.
        listen: Endpoint at which the publisher may connect, such as tcp/127.0.0.1:7447.
        connect: Endpoint of a router or publisher, which may start later.
        idle_timeout: Seconds without an image after which the stream ends; None to wait for ever.
        color: Whether frames get their colour images from KEY/color; these must arrive before the frames.
        tls: The authority's certificate, the coordinator's, and its key, for endpoints such as tls/HOST:7447.
        insecure: Allow unencrypted links to other hosts; anyone in the network could publish or read images.

    Raises InputError for an invalid key, endpoint or certificate; the iteration raises it for a port that is
    in use, and if the other side refuses the connection.
    """
    if listen is None and connect is None:
        raise InputError("a publisher needs an endpoint; give listen=ENDPOINT or connect=ENDPOINT")
    if idle_timeout is not None and not idle_timeout > 0.0:
        raise InputError(f"idle_timeout={idle_timeout:g} would end at once; give seconds above 0, or None")
    with said_in_python():
        security = choose_security(listen, connect, tls or TlsFiles(), insecure=insecure)
    reached = Pool(0, listen, connect, security)
    path = Path(key)
    cameras = live_cameras(path) if path.suffix == ".json" else [LiveCamera(str(key))]
    for camera in cameras:
        check_stream(camera.key, holder_name(security))
    if not cameras:
        raise InputError(f"{key} is not a rig with live cameras (zenoh:KEY); use open_source for recordings")
    return LiveSource(cameras, reached, idle_timeout, color=color)
