"""Rooms around real people, as the composer beside the checkout makes them."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.sequences import Recording, find_people
from common.errors import InputError

SUBJECTS = (1, 3)
EVERYBODY = ("plain", "cluttered")  # rooms that every recording is put into
SOME = {
    "table": (
        "a2_s1", "a5_s3", "a8_s1", "a11_s3", "a13_s1", "a15_s3", "a18_s1", "a20_s3", "a23_s1", "a26_s3",
    ),
    "visitor": (
        "a1_s3", "a4_s1", "a7_s3", "a9_s1", "a12_s3", "a14_s1", "a17_s3", "a19_s1", "a22_s3", "a27_s1",
    ),
    "wall": ("a3_s1", "a6_s3", "a10_s1", "a16_s3", "a24_s1"),
}  # fmt: skip
"""Rooms that some are put into."""
KINDS = (*EVERYBODY, *SOME)

Compose = Callable[[Path, str, int, Path, str], None]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Job:
    """A recording, and the rooms that it is put into."""

    recording: Recording
    kinds: tuple[str, ...]


def choose_jobs(data: Path, only: Sequence[str] | None, kinds: Sequence[str] | None) -> list[Job]:
    """Recordings with their rooms; InputError for what is not there."""
    if unknown := [kind for kind in kinds or () if kind not in KINDS]:
        raise InputError(f"no room '{unknown[0]}'; choose from {', '.join(KINDS)}")
    people = [r for r in find_people(data / "utd_mhad") if r.name.endswith(tuple(f"_s{n}" for n in SUBJECTS))]
    if not people:
        raise InputError(f"{data}/utd_mhad holds nobody; give the folder of data and tools with --shared")
    meant = [r for r in people if only is None or {r.name, r.name.partition("_")[0]} & set(only)]
    if not meant:
        raise InputError(f"nobody is called {', '.join(only or ())}; name one such as {people[0].name}")
    jobs = [Job(r, tuple(k for k in rooms_of(r.name) if not kinds or k in kinds)) for r in meant]
    return [job for job in jobs if job.kinds]


def rooms_of(name: str) -> list[str]:
    """The rooms that a recording is put into."""
    return [*EVERYBODY, *(kind for kind, names in SOME.items() if name in names)]


def load_composer(tools: Path) -> Compose:
    """The composer's function; InputError where it is not."""
    path = tools / "rooms" / "compose.py"
    spec = importlib.util.spec_from_file_location("compose", path) if path.is_file() else None
    if spec is None or spec.loader is None:
        raise InputError(f"{path} is not there; give the folder of data and tools with --shared")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    compose: Compose = module.compose
    return compose


def read_masks(room: Path) -> Mask:
    """The person's own pixels (F, H, W) in each frame of a room."""
    with np.load(room / "mask.npz") as content:
        masks: Mask = content["mask"]
    return masks
