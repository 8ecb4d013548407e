"""`gepf synth`: a rendered sequence with truth."""

from __future__ import annotations

from coordinator.commands.console.progress import Show
from coordinator.commands.options.arguments import SynthOptions
from coordinator.synthesis.sequence import synthesise


def run_synth(options: SynthOptions, show: Show) -> None:
    """Render the sequence. Raises InputError for options that make no sense and a folder in use."""
    with show.steps("rendering") as advance:
        synthesise(
            options.scene,
            options.out,
            options.frames,
            options.noise_depth,
            options.noise_lateral,
            options.seed,
            advance,
            model=options.model,
            kinect=options.kinect,
            room=options.room,
        )
