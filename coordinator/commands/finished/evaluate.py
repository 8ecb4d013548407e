"""`gepf evaluate`: runs against the truth of their sequences."""

from __future__ import annotations

import csv
import logging
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec

from common.errors import InputError
from coordinator.commands.finished.own_truth import own_truth_file, refuse_another_sequence
from coordinator.results.evaluation import Evaluation, check_truth_of, evaluate, read_truth
from coordinator.results.track import Track, read_track_with_angles

logger = logging.getLogger(__name__)


def run_evaluate(runs: Sequence[Path], truth: Path | None, *, as_csv: bool) -> None:
    """Print the errors of runs. Raises InputError for what cannot be compared.

    A table leaves out runs without a truth, and names them, unless there is no other.
    """
    if len(runs) > 1 and not as_csv:
        raise InputError("several runs are printed as a table; add --csv")
    tracks = {run: read_track_with_angles(run) for run in runs}
    truths = {run: truth or own_truth_file(run) for run in runs}
    without = [run for run in runs if truths[run] is None]
    if len(without) == len(runs):
        raise InputError(f"{say_without(without)}; give it with --truth")
    if without:
        logger.warning("left out: %s", say_without(without))
    found = [
        (run, evaluate_run(run, tracks[run], of_run)) for run in runs if (of_run := truths[run]) is not None
    ]
    if not any(knows_angles(each) for _, each in found):
        logger.warning("the truth holds joints alone, no pose: errors of angles are not known")
    if as_csv:
        write_table(found)
    else:
        sys.stdout.write(msgspec.json.format(msgspec.json.encode(found[0][1])).decode() + "\n")


def knows_angles(found: Evaluation) -> bool:
    """Whether a truth says of angles, or of what slides, by pose or by joints."""
    return bool(
        found.mean_angle_error_deg_by_dof
        or found.mean_angle_error_deg_by_angle
        or found.mean_slide_error_cm_by_dof
    )


def say_without(runs: Sequence[Path]) -> str:
    """That runs have no truth."""
    named = ", ".join(map(str, runs))
    if len(runs) == 1:
        return f"the sequence of {named} has no truth of this body, or is not where it was"
    return f"the sequences of {named} have no truth of these bodies, or are not where they were"


def evaluate_run(run: Path, track: Track, truth: Path) -> Evaluation:
    """Errors of one run against a truth, which must be that of its sequence."""
    check_truth_of(run, truth)
    refuse_another_sequence(run, truth)
    return evaluate(track, read_truth(truth))


def write_table(found: Sequence[tuple[Path, Evaluation]]) -> None:
    """One line for each run as it was given: its folder and all errors but those by name."""
    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow(["run", *flat(found[0][1])])
    for run, evaluation in found:
        writer.writerow([run, *("" if value is None else value for value in flat(evaluation).values())])


def flat(evaluation: Evaluation) -> dict[str, object]:
    """The numbers of an evaluation that are single."""
    values = msgspec.structs.asdict(evaluation)
    return {name: value for name, value in values.items() if not name.endswith(("_by_dof", "_by_angle"))}
