"""Scores of the stated certainty: joints that are flagged, and joints within their deviation."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from rich.table import Table

from benchmarks.certainty.fitting import joints_of
from benchmarks.certainty.gather import Gathered
from gepf.common.arrays import Array, Mask
from gepf.coordinator.settings import CertaintyFit, CertaintySettings
from gepf.coordinator.tracking.certainty import judge

FALSE_ALARMS = (0.01, 0.02, 0.05, 0.1, 0.2)
SHOWN = 0.5  # share of its surface; a joint with more is visible


class Calibration(msgspec.Struct, frozen=True):
    """Percentage of joints within one and within two deviations."""

    joints: int
    within_one: float
    within_two: float


class Score(msgspec.Struct, frozen=True):
    """Scores of one set of recordings."""

    name: str
    joints: int
    off_percent: float  # more than 15 cm
    flagged_percent: float  # of these, flagged at the tracker's own limit
    false_percent: float  # of the others, flagged
    roc: list[tuple[float, float]]  # percentage of false alarms, and of joints off that are flagged
    suspected_frames_percent: float  # of frames with a joint off, those that are not `tracked`
    doubted_frames_percent: float  # of all other frames, the same
    flagged_frames_percent: float  # of frames with a joint off, those in which one such joint is flagged
    off_frames: int
    seen: Calibration
    hidden: Calibration


def score(name: str, gathered: Sequence[Gathered], fit: CertaintyFit) -> Score:
    """Compare the certainty of a fit with the errors of joints, where the reference is valid."""
    features, away, _ = joints_of(gathered)
    limits = CertaintySettings(fit=fit)
    certainty = judge(features, limits)
    probability, in_deviations = certainty.off_probability, away / certainty.deviation
    wrong, seen = away > limits.wrong_m, features.seen >= SHOWN
    flagged = probability > limits.flagged_probability
    ends = np.cumsum([np.count_nonzero(one.holds, axis=1).sum() for one in gathered])[:-1]
    some_off, caught, suspected = [], [], []
    for one, off in zip(gathered, np.split(wrong, ends), strict=True):
        said = judge(one.features, limits).off_probability
        is_off = np.zeros(one.holds.shape, dtype=bool)
        is_off[one.holds] = off
        some_off.append(is_off.any(axis=1))
        caught.append((is_off & (said > limits.flagged_probability)).any(axis=1))
        suspected.append((said > limits.ambiguous_probability).any(axis=1) | (one.status != "tracked"))
    frames, doubted = np.concatenate(some_off), np.concatenate(suspected)
    return Score(
        name=name,
        joints=len(away),
        off_percent=percent(wrong),
        flagged_percent=percent(flagged[wrong]),
        false_percent=percent(flagged[~wrong]),
        roc=[
            (100.0 * share, percent(probability[wrong] > limit_for(probability[~wrong], share)))
            for share in FALSE_ALARMS
        ],
        suspected_frames_percent=percent(doubted[frames]),
        doubted_frames_percent=percent(doubted[~frames]),
        flagged_frames_percent=percent(np.concatenate(caught)[frames]),
        off_frames=int(frames.sum()),
        seen=calibration(in_deviations[seen]),
        hidden=calibration(in_deviations[~seen]),
    )


def limit_for(probability: Array, share: float) -> float:
    """The probability that this share exceeds."""
    return float(np.quantile(probability, 1.0 - share)) if len(probability) else np.inf


def percent(values: Mask) -> float:
    """Percentage of values that are true; NaN if there are none."""
    return round(100.0 * float(values.mean()), 1) if len(values) else np.nan


def calibration(in_deviations: Array) -> Calibration:
    """Calibration of distances that are given in deviations."""
    return Calibration(len(in_deviations), percent(in_deviations < 1.0), percent(in_deviations < 2.0))


def score_table(scores: Sequence[Score]) -> Table:
    """The table: a line for each set."""
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
