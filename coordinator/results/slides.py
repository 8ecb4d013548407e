"""How far out the joints are that slide, as `angle` says it of those that turn."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.body import ROOT_DOFS, TRANSLATION, BodyModel
from coordinator.results.model_file import MODEL_FILE, read_tracked_body
from coordinator.results.spread import UNSEEN, root_mean_square
from coordinator.results.track import Track

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Slides:
    """Sliding joints (S) over F frames, metres."""

    names: tuple[str, ...]
    value: Array  # (F, S) NaN before the body was found
    deviation: Array  # (F, S) one standard deviation; NaN where nobody knows


def read_slides(run: Path, track: Track) -> Slides:
    """Of the body in a run's folder; none where that is missing."""
    if not (run / MODEL_FILE).exists():
        return Slides((), np.empty((len(track.frame), 0)), np.empty((len(track.frame), 0)))
    return slides_of(track, read_tracked_body(run).model)


def slides_of(track: Track, model: BodyModel) -> Slides:
    """What of a track slides, but for the root's place; off by as much as angles for the same spread."""
    sliding = np.flatnonzero(model.kinds == TRANSLATION)
    names = tuple(name for j in sliding if (name := model.dof_names[j]) not in ROOT_DOFS)
    at = [track.dof_names.index(name) for name in names]
    value = track.pose[:, at]
    away = track.hypothesis_pose[:, :, at] - value[:, None]
    deviation = UNSEEN * root_mean_square(away, track.hypothesis_weight)
    deviation[track.unknown] = np.nan
    return Slides(names, value, deviation)
