"""The truth that came with a run's own sequence, and whether a truth is another sequence's."""

from __future__ import annotations

from pathlib import Path

from common.errors import InputError
from coordinator.results.configuration import PATH, digest_frame
from coordinator.results.evaluation import Truth, read_truth
from coordinator.results.summary import PEOPLE, read_summary
from coordinator.sources import find_format, open_source

FIRST_FRAME, FRAMES = "first_frame", "frame_range"


def own_truth(run: Path) -> Truth | None:
    """The truth beside the sequence that was tracked; None where there is none."""
    file = own_truth_file(run)
    return None if file is None else read_truth(file)


def is_sequence(folder: Path) -> bool:
    """Whether a folder is a recording itself."""
    try:
        find_format(folder)
    except InputError:
        return False
    return True


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
    recorded, frames = summary.get(FIRST_FRAME), summary.get(FRAMES)
    folder = truth.resolve().parent
    if recorded is None or frames is None:
        return
    if not is_sequence(folder):
        return  # it lies elsewhere, and nobody knows whose it is
    source = open_source(folder)
    first = int(str(frames).partition(":")[0])
    if first not in source.numbers or digest_frame(source.frame(first)) != recorded:
        raise InputError(
            f"{truth} is the truth of {folder.name}, but {run} tracked {summary.get('sequence')}; "
            "give the truth of its own sequence"
        )
