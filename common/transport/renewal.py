"""The encrypted endpoints of a program, which keep working when its certificate is renewed.

Zenoh reads the certificate for listening when it opens the endpoint, and the one for connecting at each
attempt. A link is closed when the certificate of its other side expires. So programs that connect need do
nothing; those that listen must open their endpoints again, with the renewed certificate.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from gepf.common.closing import Closing
from gepf.common.errors import BusError, InputError
from gepf.common.transport.bus import Bus
from gepf.common.transport.credentials import Credentials, holder_of

LOOK_S = 2.0  # between looks at the files

log = logging.getLogger(__name__)


class Front(Closing):
    """A router at the encrypted endpoints of this process. Sessions behind it do not notice a renewal.

    `reopen` opens the router; it is called again when the files of the credentials have other contents.
    """

    def __init__(self, reopen: Callable[[], Bus], credentials: Credentials) -> None:
        self._reopen, self._credentials = reopen, credentials
        self._used: tuple[bytes, ...] = ()  # contents of the files
        self._used = self._read()
        self._bus: Bus | None = reopen()
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Close the endpoints."""
        self._closed.set()
        self._thread.join()
        self._shut()

    def _watch(self) -> None:
        last = self._used
        while not self._closed.wait(LOOK_S):
            before, last = last, self._read()
            if last == before and (last != self._used or self._bus is None):  # all files are written
                self._use(last)

    def _use(self, contents: tuple[bytes, ...]) -> None:
        """Open the endpoints with the present files; keep the old certificate if the new one is invalid."""
        changed, self._used = contents != self._used, contents
        try:
            holder = holder_of(self._credentials)
            self._shut()
            self._bus = self._reopen()
        except (InputError, BusError) as error:
            if changed:
                log.warning("the renewed certificate is not in use: %s", error)
        else:
            log.warning("the certificate of '%s' was renewed; it is in use", holder)

    def _read(self) -> tuple[bytes, ...]:
        """The contents of the files; those last used if one of the files cannot be read."""
        files = self._credentials.ca, self._credentials.cert, self._credentials.key
        try:
            return tuple(file.read_bytes() for file in files)
        except OSError:  # it is being replaced
            return self._used

    def _shut(self) -> None:
        if self._bus is not None:
            self._bus.close()
            self._bus = None
