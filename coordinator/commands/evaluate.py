"""`gepf evaluate`: a run against the truth of its sequence."""

from __future__ import annotations

import sys
from pathlib import Path

import msgspec

from coordinator.results.evaluation import evaluate
from coordinator.results.track import read_track
from coordinator.results.truth import check_truth_of, read_truth


def run_evaluate(run: Path, truth: Path) -> None:
    """Print the errors of a run as one JSON object. Raises InputError for what cannot be compared."""
    check_truth_of(run, truth)
    errors = evaluate(read_track(run), read_truth(truth))
    sys.stdout.write(msgspec.json.format(msgspec.json.encode(errors)).decode() + "\n")
