"""How well the tracker's word holds: what is flagged, and how many joints lie within their deviation."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from benchmarks.certainty.fitting import distances, judge
from benchmarks.certainty.gather import Gathered
from coordinator.tracking.certainty.assessment import Functions
from coordinator.tracking.certainty.certainty import FLAGGED, OFF, SUSPECTED

Array = NDArray[np.float64]

FALSE_ALARMS = (0.01, 0.02, 0.05, 0.1, 0.2)
SHOWN = 0.5  # share of its surface from which on a joint is seen


class Calibration(msgspec.Struct, frozen=True):
    """Per cent of joints within one and within two deviations."""

    joints: int
    within_one: float
    within_two: float


class Score(msgspec.Struct, frozen=True):
    """One set of recordings."""

    name: str
    joints: int
    off_percent: float  # more than 15 cm
    flagged_percent: float  # of these, at the tracker's own limit
    false_percent: float  # flagged, of the others
    roc: list[tuple[float, float]]  # per cent of false alarms, and of joints off that are flagged then
    suspected_frames_percent: float  # frames not plainly tracked, of those with a joint off
    doubted_frames_percent: float  # and of the others
    flagged_frames_percent: float  # one of the joints that are off is flagged, of frames with such
    off_frames: int
    seen: Calibration
    hidden: Calibration


def score(name: str, gathered: Sequence[Gathered], functions: Functions) -> Score:
    """Hold what the functions say against how far joints are off, where the reference holds."""
    verdicts, off = [judge(one, functions) for one in gathered], distances(gathered)
    holds = [one.holds for one in gathered]
    log_odds, log_deviation = np.concatenate([v[h] for v, h in zip(verdicts, holds, strict=True)]).T
    away = np.concatenate([d[h] for d, h in zip(off, holds, strict=True)])
    shown = np.concatenate([one.evidence[..., 0][one.holds] for one in gathered]) >= SHOWN
    wrong, in_deviations = away > OFF, away / np.exp(log_deviation)
    flagged = log_odds > logit(FLAGGED)
    suspected = np.concatenate(
        [
            (v[..., 0] > logit(SUSPECTED)).any(axis=1) | (one.status != "tracked")
            for v, one in zip(verdicts, gathered, strict=True)
        ]
    )
    away_of = [(d > OFF) & h for d, h in zip(off, holds, strict=True)]
    some_off = np.concatenate([one.any(axis=1) for one in away_of])
    caught = np.concatenate(
        [(a & (v[..., 0] > logit(FLAGGED))).any(axis=1) for a, v in zip(away_of, verdicts, strict=True)]
    )
    return Score(
        name=name,
        joints=len(away),
        off_percent=percent(wrong),
        flagged_percent=percent(flagged[wrong]),
        false_percent=percent(flagged[~wrong]),
        roc=[
            (100.0 * share, percent(log_odds[wrong] > limit_for(log_odds[~wrong], share)))
            for share in FALSE_ALARMS
        ],
        suspected_frames_percent=percent(suspected[some_off]),
        doubted_frames_percent=percent(suspected[~some_off]),
        flagged_frames_percent=percent(caught[some_off]),
        off_frames=int(some_off.sum()),
        seen=calibration(in_deviations[shown]),
        hidden=calibration(in_deviations[~shown]),
    )


def logit(probability: float) -> float:
    """Its log odds."""
    return float(np.log(probability / (1.0 - probability)))


def limit_for(log_odds: Array, share: float) -> float:
    """The log odds above which this share lies."""
    return float(np.quantile(log_odds, 1.0 - share)) if len(log_odds) else np.inf


def percent(values: NDArray[np.bool_]) -> float:
    """Of the values that are true; NaN of none."""
    return round(100.0 * float(values.mean()), 1) if len(values) else np.nan


def calibration(in_deviations: Array) -> Calibration:
    """Of distances in deviations."""
    return Calibration(len(in_deviations), percent(in_deviations < 1.0), percent(in_deviations < 2.0))


def score_table(scores: Sequence[Score]) -> Table:
    """A line for each set."""
    table = Table(title="how sure the tracker is, and whether that holds")
    for heading in (
        "", "joints", "off", "flagged", "of others", "flagged at 1, 2, 5, 10, 20 %",
        "frames with\njoints off", "flagged", "in doubt", "of others",
        "seen: within 1, 2", "hidden: joints", "within 1, 2",
    ):  # fmt: skip
        table.add_column(heading, justify="left" if not heading else "right")
    for one in scores:
        table.add_row(
            one.name,
            str(one.joints),
            f"{one.off_percent} %",
            f"{one.flagged_percent} %",
            f"{one.false_percent} %",
            " ".join(f"{caught:.0f}" for _, caught in one.roc),
            str(one.off_frames),
            f"{one.flagged_frames_percent} %",
            f"{one.suspected_frames_percent} %",
            f"{one.doubted_frames_percent} %",
            f"{one.seen.within_one}, {one.seen.within_two}",
            str(one.hidden.joints),
            f"{one.hidden.within_one}, {one.hidden.within_two}",
        )
    return table
