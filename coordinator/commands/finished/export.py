"""`gepf export`: a run for other programs."""

from __future__ import annotations

from coordinator.commands.console.progress import Show
from coordinator.commands.options.arguments import ExportOptions
from coordinator.exports import export_run


def run_export(options: ExportOptions, show: Show) -> None:
    """Write the file and say what is in it. Raises InputError for what cannot be written."""
    run = export_run(options.run, options.form, options.out, smooth_hz=options.smooth, force=options.force)
    frames, lost = len(run.track.frame), int(run.lost.sum())
    gone = f", {lost} of them lost" if lost else ""
    smooth = f", low pass {options.smooth:g} Hz" if options.smooth else ""
    size = options.out.stat().st_size
    show.say(f"{options.out}: {frames} frames{gone}{smooth}, {size / 1000:.0f} kB as {options.form}")
