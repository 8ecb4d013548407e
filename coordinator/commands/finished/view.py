"""Where a run's recording goes: into a file, or to a viewer in a browser."""

from __future__ import annotations

import signal
from pathlib import Path
from urllib.parse import quote

import rerun as rr

from common.errors import GepfError, InputError
from coordinator.commands.console.progress import Show
from coordinator.commands.finished.tracked_sequence import find_sequence
from coordinator.commands.options.arguments import ViewOptions
from coordinator.results.track import Track, filled, read_track, read_tracked_body
from coordinator.sources import Source
from coordinator.viewing import layout, log_run

APPLICATION = "gepf"


def run_view(options: ViewOptions, show: Show) -> None:
    """Do a `gepf view`: into a file if one is named, else in a browser."""
    if options.save is not None:
        save_run(options.run, options.sequence, options.save, show)
    else:
        serve_run(options.run, options.sequence, options.port, show, browser=options.browser)


def save_run(run: Path, sequence: Path | None, file: Path, show: Show) -> None:
    """Write the recording as a file that any rerun viewer opens."""
    track, recording = filled(read_track(run)), rr.RecordingStream(APPLICATION)
    source = find_sequence(run, sequence)
    if not file.parent.is_dir():
        raise InputError(f"no such folder: {file.parent}; give a file in a folder that there is with --save")
    recording.save(file, default_blueprint=layout(track))
    write(recording, run, track, source, show)


def serve_run(run: Path, sequence: Path | None, port: int, show: Show, *, browser: bool) -> None:
    """Show the recording in a browser until interrupted."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(
            number, signal.SIG_DFL
        )  # nothing is kept, and the viewer's own code swallows interrupts
    track, recording = filled(read_track(run)), rr.RecordingStream(APPLICATION)
    source = find_sequence(run, sequence)
    try:
        address = recording.serve_grpc(grpc_port=port + 1, default_blueprint=layout(track))
        rr.serve_web_viewer(web_port=port, open_browser=browser, connect_to=address)
    except (OSError, RuntimeError, ValueError) as error:
        raise GepfError(f"the viewer did not start ({error}); another --port may be free") from error
    write(recording, run, track, source, show)
    show.say(f"see http://localhost:{port}?url={quote(address, safe='')}")
    show.say("Ctrl-C ends")
    signal.pause()


def write(recording: rr.RecordingStream, run: Path, track: Track, source: Source | None, show: Show) -> None:
    """Write all frames and wait until they are out."""
    model = read_tracked_body(run).model
    with show.steps("preparing frames") as advance:
        log_run(recording, track, model, source, advance)
        recording.flush()
