"""The recordings to measure with, and the joints that each is compared with."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from common.errors import InputError

SKINNED = ("dance", "turn", "dance_clean")
_DEPTH = re.compile(r"(a(\d+)_s(\d+))_t1_depth\.mat")


@dataclass(frozen=True, slots=True)
class Recording:
    """A depth sequence, and the file with its joints."""

    name: str
    depth: Path
    joints: Path
    action: int | None = None  # of UTD-MHAD; None where the joints are the exact truth


def find_recordings(data: Path) -> list[Recording]:
    """People by action and subject, then the skinned; InputError where there are none."""
    found = [*find_people(data / "utd_mhad"), *find_skinned(data / "skinned")]
    if not found:
        raise InputError(f"{data} holds no utd_mhad/depth and no skinned; give the data's folder with --data")
    return found


def find_people(folder: Path) -> list[Recording]:
    """All sequences of UTD-MHAD that are there."""
    matches = [match for path in folder.glob("depth/*.mat") if (match := _DEPTH.fullmatch(path.name))]
    matches.sort(key=lambda match: (int(match[2]), int(match[3])))
    return [
        Recording(
            name=match[1],
            depth=folder / "depth" / match[0],
            joints=folder / "skeleton" / f"{match[1]}_t1_skeleton.mat",
            action=int(match[2]),
        )
        for match in matches
    ]


def find_skinned(folder: Path) -> list[Recording]:
    """The synthetic people that are there."""
    return [
        Recording(name, folder / name, folder / name / "truth.npz")
        for name in SKINNED
        if (folder / name).is_dir()
    ]


def choose(recordings: Sequence[Recording], only: Sequence[str] | None) -> list[Recording]:
    """Those named, such as `a14_s2`, `dance`, or `a14` for a whole action; InputError for an unknown one."""
    if only is None:
        return list(recordings)
    for name in only:
        if not any(is_meant(recording, name) for recording in recordings):
            raise InputError(f"no sequence '{name}'; name one such as {', '.join(names(recordings))}")
    return [recording for recording in recordings if any(is_meant(recording, name) for name in only)]


def is_meant(recording: Recording, name: str) -> bool:
    """Whether a name is the recording's own or that of its action."""
    return name in (recording.name, recording.name.partition("_s")[0])


def names(recordings: Sequence[Recording]) -> list[str]:
    """A few examples, of both kinds if there are both."""
    return sorted({recordings[0].name, recordings[len(recordings) // 2].name, recordings[-1].name})
