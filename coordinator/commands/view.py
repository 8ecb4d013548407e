"""`gepf view`: shows a run in a browser, or writes it to a file."""

from __future__ import annotations

import logging
import signal
from urllib.parse import quote

import rerun as rr

from common.errors import GepfError, InputError
from coordinator.commands.finished import find_sequence
from coordinator.commands.options import ViewOptions
from coordinator.commands.progress import Show
from coordinator.results.track import filled, read_track, read_tracked_body
from coordinator.viewing import layout, log_run

logger = logging.getLogger(__name__)


def run_view(options: ViewOptions, show: Show) -> None:
    """Write a file for the rerun viewer if one is given, else serve a browser."""
    track, recording = filled(read_track(options.run)), rr.RecordingStream("gepf")
    source, blueprint = find_sequence(options.run, options.sequence), layout(track)
    if source is None:
        logger.warning("the sequence of this run is not where it was; --sequence SEQ shows its depth as well")
    if options.save is not None:
        if not options.save.parent.is_dir():
            raise InputError(
                f"no such folder: {options.save.parent}; give a file in one that exists with --save"
            )
        recording.save(options.save, default_blueprint=blueprint)
    else:
        # nothing is stored, and the viewer suppresses interrupts
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        try:
            address = recording.serve_grpc(grpc_port=options.port + 1, default_blueprint=blueprint)
            rr.serve_web_viewer(web_port=options.port, open_browser=options.browser, connect_to=address)
        except (OSError, RuntimeError, ValueError) as error:
            raise GepfError(f"the viewer did not start ({error}); another --port may be free") from error
    model = read_tracked_body(options.run).model
    with show.steps("preparing frames") as advance:
        log_run(recording, track, model, source, advance)
        recording.flush()
    if options.save is None:
        show.say(f"see http://localhost:{options.port}?url={quote(address, safe='')}")
        show.say("Ctrl-C ends")
        signal.pause()
