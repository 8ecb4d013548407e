"""`gepf evaluate`: errors of runs against the truth of their sequences."""

from __future__ import annotations

import csv
import logging
import sys
from pathlib import Path

import msgspec

from gepf.common.camera import NOT_MOVED
from gepf.common.errors import InputError
from gepf.coordinator.commands.finished import camera_in, find_sequence, own_truth
from gepf.coordinator.commands.options import EvaluateOptions
from gepf.coordinator.results.configuration import digest_view
from gepf.coordinator.results.evaluation import Evaluation, evaluate, read_truth
from gepf.coordinator.results.killed import finish_killed
from gepf.coordinator.results.summary import read_summary
from gepf.coordinator.results.track import TRACK_FILE, read_track
from gepf.coordinator.sources import open_source
from gepf.coordinator.sources.picture_folders import is_tum

logger = logging.getLogger(__name__)


def run_evaluate(options: EvaluateOptions) -> None:
    """Print the errors of runs. Raises InputError if they cannot be compared.

    The table has all errors except those by angle or degree of freedom. Runs without truth are left out with
    a warning; InputError if no run has truth.
    """
    runs, truth = options.runs, options.truth
    if len(runs) > 1 and not options.csv:
        raise InputError("several runs are printed as a table; add --csv")
    for run in runs:
        finish_killed(run)
    tracks = {run: read_track(run) for run in runs}
    sources = {run: find_sequence(run) for run in tracks}
    truths = {run: truth or own_truth(run, sources[run]) for run in tracks}
    found = dict[Path, Evaluation]()
    for run, of_run in truths.items():
        if of_run is not None:
            check_truth(run, of_run)
            source, placed = sources[run], NOT_MOVED
            if source is not None and source.truth is not None and source.truth.samefile(of_run):
                placed = source.T_rig_camera
            found[run] = evaluate(tracks[run], read_truth(of_run, placed))
        elif any(truths.values()):
            logger.warning("%s is left out: its sequence has no truth for this body, or was moved", run)
    if not found:
        raise InputError(f"the sequence of {runs[0]} has no truth for this body, or was moved; give --truth")
    if not options.csv:
        sys.stdout.write(msgspec.json.format(msgspec.json.encode(found[runs[0]])).decode() + "\n")
        return
    columns = [name for name in Evaluation.__struct_fields__ if not name.endswith(("_by_dof", "_by_angle"))]
    rows = [[run, *(getattr(each, name) for name in columns)] for run, each in found.items()]
    csv.writer(sys.stdout, lineterminator="\n").writerows([["run", *columns], *rows])


def check_truth(run: Path, truth: Path) -> None:
    """InputError if the truth is the run itself, or in the folder of another recording."""
    if truth.exists() and truth.samefile(run / TRACK_FILE):
        raise InputError(f"{truth} is the track of the run itself; give the truth.npz of its sequence")
    summary, folder = read_summary(run), truth.resolve().parent
    if "first_frame" not in summary:
        return
    try:
        source = open_source(folder, camera_in(summary))
    except InputError:
        if (folder / "depth").is_dir() or is_tum(folder):
            raise
        return  # it is not in the folder of a recording
    first = int(summary["frame_range"].partition(":")[0])
    if first not in source.numbers or digest_view(source.view(first)) != summary["first_frame"]:
        raise InputError(
            f"{truth} is for {folder.name}, but {run} tracked {summary.get('sequence')}; "
            "give the truth of that sequence"
        )
