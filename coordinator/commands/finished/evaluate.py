"""`gepf evaluate`: runs against the truth of their sequences."""

from __future__ import annotations

import csv
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec

from common.errors import InputError
from coordinator.commands.finished.own_truth import own_truth_file, refuse_another_sequence
from coordinator.results.evaluation import Evaluation, evaluate
from coordinator.results.track import read_track
from coordinator.results.truth import check_truth_of, read_truth


def run_evaluate(runs: Sequence[Path], truth: Path | None, *, as_csv: bool) -> None:
    """Print the errors of runs. Raises InputError for what cannot be compared."""
    if len(runs) > 1 and not as_csv:
        raise InputError("several runs are printed as a table; add --csv")
    found = [evaluate_run(run, truth) for run in runs]
    if as_csv:
        write_table(runs, found)
    else:
        sys.stdout.write(msgspec.json.format(msgspec.json.encode(found[0])).decode() + "\n")


def evaluate_run(run: Path, given: Path | None) -> Evaluation:
    """Errors of one run against the truth that is given, else against its sequence's own."""
    track = read_track(run)
    truth = given or own_truth_file(run)
    if truth is None:
        raise InputError(
            f"the sequence of {run} has no truth of this body, or is not where it was; give it with --truth"
        )
    check_truth_of(run, truth)
    refuse_another_sequence(run, truth)
    return evaluate(track, read_truth(truth))


def write_table(runs: Sequence[Path], found: Sequence[Evaluation]) -> None:
    """One line a run: its folder and all errors but those by degree of freedom."""
    rows = [flat(evaluation) for evaluation in found]
    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow(["run", *rows[0]])
    for run, row in zip(runs, rows, strict=True):
        writer.writerow([run, *("" if value is None else value for value in row.values())])


def flat(evaluation: Evaluation) -> dict[str, object]:
    """The numbers of an evaluation that are single."""
    values = msgspec.structs.asdict(evaluation)
    return {name: value for name, value in values.items() if not name.endswith("_by_dof")}
