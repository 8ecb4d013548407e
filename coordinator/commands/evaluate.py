"""`gepf evaluate`: runs against the truth of their sequences."""

from __future__ import annotations

import csv
import logging
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec

from common.errors import InputError
from coordinator.results.configuration import PATH, PEOPLE, digest_frame
from coordinator.results.evaluation import Evaluation, check_truth_of, evaluate, read_truth
from coordinator.results.summary import read_summary
from coordinator.results.track import read_track_with_angles
from coordinator.sources import find_format, open_source

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
    found = list[tuple[Path, Evaluation]]()
    for run in runs:
        if (of_run := truths[run]) is not None:
            check_truth_of(run, of_run)
            refuse_another_sequence(run, of_run)
            found.append((run, evaluate(tracks[run], read_truth(of_run))))
    known = (
        each.mean_angle_error_deg_by_dof
        or each.mean_angle_error_deg_by_angle
        or each.mean_slide_error_cm_by_dof
        for _, each in found
    )
    if not any(known):
        logger.warning("the truth holds joints alone, no pose: errors of angles are not known")
    if as_csv:
        write_table(found)
    else:
        sys.stdout.write(msgspec.json.format(msgspec.json.encode(found[0][1])).decode() + "\n")


def say_without(runs: Sequence[Path]) -> str:
    """That runs have no truth."""
    named = ", ".join(map(str, runs))
    if len(runs) == 1:
        return f"the sequence of {named} has no truth of this body, or is not where it was"
    return f"the sequences of {named} have no truth of these bodies, or are not where they were"


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


def own_truth_file(run: Path) -> Path | None:
    """Where the truth of a run's sequence is; None where sequence or truth are gone.

    And None for one of several people: a sequence's truth does not say whose it is.
    """
    summary = read_summary(run)
    path = summary.get(PATH)
    if PEOPLE in summary or path is None or not Path(path).exists():
        return None
    return open_source(Path(path)).truth


def refuse_another_sequence(run: Path, truth: Path) -> None:
    """InputError where a truth lies beside a sequence that is not the one that was tracked.

    Sequences are told apart by the first frame that was tracked, so that one that was moved is still known.
    """
    summary = read_summary(run)
    recorded, frames = summary.get("first_frame"), summary.get("frame_range")
    folder = truth.resolve().parent
    if recorded is None or frames is None:
        return
    try:
        find_format(folder)
    except InputError:
        return  # it is not in a recording's folder, and may be of any
    source = open_source(folder)
    first = int(str(frames).partition(":")[0])
    if first not in source.numbers or digest_frame(source.frame(first)) != recorded:
        raise InputError(
            f"{truth} is the truth of {folder.name}, but {run} tracked {summary.get('sequence')}; "
            "give the truth of its own sequence"
        )
