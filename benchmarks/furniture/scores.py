"""What a tracker makes of people on furniture, by recording and by situation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import msgspec
import numpy as np
from rich.table import Table

from benchmarks.furniture.footage import Footage
from gepf.common.arrays import Array
from gepf.coordinator.bodies.human.measures import Measures
from gepf.coordinator.results.evaluation import THRESHOLDS, positions
from gepf.coordinator.settings import CertaintySettings
from gepf.coordinator.tracking.estimate import POSE_UNKNOWN
from gepf.coordinator.tracking.reporting import TrackedPerson

AFTER = 10  # frames after the first estimate, in which the person must be found

COLUMNS = (
    "recordings", "found", "at the end", "cm", "<10 cm", "tracked", "wrong", "visible",
    "cm", "<10 cm", "wrong", "stature", "girth",
)  # fmt: skip


class Score(msgspec.Struct, frozen=True):
    """One recording. Shares are from 0 to 1, lengths in metres; None if no pose was estimated.

    Before the first estimate no joint is near. A frame is wrong if a joint is more than 15 cm off.
    """

    situation: str
    name: str
    found: bool  # mean visible joint within 10 cm, ten frames after the first estimate
    found_at_the_end: bool  # the same in the last frame
    first: int | None  # frame with an estimate
    error: float | None
    near: float
    tracked: int  # frames
    wrong: int  # of these
    frames: int
    visible: float  # share of joints
    visible_error: float | None
    visible_near: float
    visible_wrong: int  # tracked frames with a visible joint that is wrong
    stature_off: float | None  # relative
    girth_off: float | None  # relative
    status: dict[str, int]
    why: dict[str, int]  # reasons for doubt, and in how many frames


def score(
    situation: str, name: str, footage: Footage, found: Sequence[TrackedPerson], measures: Measures
) -> Score:
    """Compare estimates with the truth."""
    estimates = [one.estimate for one in found]
    columns = positions(found[-1].state.start.model.joint_names, footage.names)
    joints = np.array([one.joint_positions[columns] for one in estimates])
    off = np.linalg.norm(joints - footage.joints, axis=-1)
    known = np.isfinite(off).all(axis=1) & np.array([e.status not in POSE_UNKNOWN for e in estimates])
    first = int(np.argmax(known)) if known.any() else None
    seen = np.where(footage.visible, off, np.nan)
    tracked = np.array([one.status == "tracked" for one in estimates])
    wrong_m = CertaintySettings().wrong_m
    size = found[-1].state.size if first is not None else None
    return Score(
        situation,
        name,
        first is not None and is_found(seen, known, min(first + AFTER, len(off) - 1)),
        is_found(seen, known, len(off) - 1),
        first,
        mean(off),
        float(np.mean(off < THRESHOLDS.near_m)),
        int(tracked.sum()),
        int((tracked & np.any(off > wrong_m, axis=1)).sum()),
        len(off),
        float(footage.visible.mean()),
        mean(seen),
        float(np.mean(off[footage.visible] < THRESHOLDS.near_m)),
        int((tracked & np.any(seen > wrong_m, axis=1)).sum()),
        None if size is None else float(size[0] / measures.stature - 1.0),
        None if size is None else float(size[1] / measures.girth - 1.0),
        dict(Counter(one.status for one in estimates)),
        dict(Counter(one.why for one in estimates if one.why).most_common(5)),
    )


def is_found(off: Array, known: Array, frame: int) -> bool:
    """Whether the mean of the visible joints (F, J) is near in a frame with a known pose."""
    return bool(known[frame] and np.nanmean(off[frame]) < THRESHOLDS.near_m)


def mean(off: Array) -> float | None:
    """The mean of what is known."""
    return float(np.nanmean(off)) if np.isfinite(off).any() else None


def score_table(scores: Sequence[Score]) -> Table:
    """A row for each situation, and one for all; shares in percent, lengths in centimetres."""
    table = Table(title="People on furniture; the second half of the columns: visible joints")
    for column in ("situation", *COLUMNS):
        table.add_column(column, justify="left" if column == "situation" else "right")
    for name in dict.fromkeys(one.situation for one in scores):
        table.add_row(name, *row([one for one in scores if one.situation == name]))
    table.add_row("all", *row(scores))
    return table


def row(scores: Sequence[Score]) -> list[str]:
    """The numbers of COLUMNS."""
    tracked, frames = sum(one.tracked for one in scores), sum(one.frames for one in scores)
    wrong, visible_wrong = sum(one.wrong for one in scores), sum(one.visible_wrong for one in scores)
    shares: list[float] = [
        float(np.mean([one.found for one in scores])),
        float(np.mean([one.found_at_the_end for one in scores])),
        average([one.error for one in scores]),
        float(np.mean([one.near for one in scores])),
        tracked / frames,
        wrong / tracked if tracked else np.nan,
        float(np.mean([one.visible for one in scores])),
        average([one.visible_error for one in scores]),
        float(np.mean([one.visible_near for one in scores])),
        visible_wrong / tracked if tracked else np.nan,
        median([one.stature_off for one in scores]),
        median([one.girth_off for one in scores]),
    ]
    return [str(len(scores)), *(f"{100.0 * share:.1f}" for share in shares)]


def average(values: Sequence[float | None]) -> float:
    """The mean of recordings with an estimate; NaN without any."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else float("nan")


def median(values: Sequence[float | None]) -> float:
    """The median of absolute values, of recordings with an estimate; NaN without any."""
    known = [abs(value) for value in values if value is not None]
    return float(np.median(known)) if known else float("nan")
