"""Several recordings, and what their runs are called."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from common.errors import InputError

LIST_SUFFIX = ".txt"
MOST_SEEDS = 10_000


@dataclass(frozen=True, slots=True)
class Entry:
    """One run of several: what is tracked, the folder's name within `--out`, the seed."""

    sequence: Path
    name: str
    seed: int


def is_several(sequences: Sequence[Path], seeds: str | None) -> bool:
    """Whether more than one run is asked for, each of which gets a folder within `--out`."""
    return len(sequences) > 1 or seeds is not None or is_list(sequences[0])


def is_list(path: Path) -> bool:
    """Whether a path is a file that lists recordings."""
    return path.suffix == LIST_SUFFIX and not path.is_dir()


def choose_entries(sequences: Sequence[Path], seed: int, seeds: str | None) -> list[Entry]:
    """A run for each recording and seed. InputError for a list that cannot be read, and for equal names."""
    paths = [path for given in sequences for path in (read_list(given) if is_list(given) else [given])]
    whole = [path.resolve() for path in paths]
    names = [each.name if each.is_dir() else each.stem for each in whole]
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise InputError(f"two recordings are called '{twice[0]}'; track them into folders of their own")
    chosen = parse_seeds(seeds) if seeds is not None else range(seed, seed + 1)
    return [
        Entry(path, name if seeds is None else f"{name}-seed{number}", number)
        for path, name in zip(paths, names, strict=True)
        for number in chosen
    ]


def read_list(file: Path) -> Sequence[Path]:
    """The recordings of a list: one a line, as seen from the file's folder; # begins a comment."""
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read {file}: {error}; give a text file with a recording a line") from None
    found = [file.parent / text for line in lines if (text := line.split("#", 1)[0].strip())]
    if not found:
        raise InputError(f"{file} lists nothing; write one recording a line")
    return found


def parse_seeds(text: str) -> range:
    """Seeds A to before B of `A:B`."""
    first, colon, end = text.partition(":")
    if not (colon and first.strip().isdecimal() and end.strip().isdecimal()):
        raise InputError(f"--seeds '{text}' is not of the form A:B; 0:5 stands for 0, 1, 2, 3 and 4")
    seeds = range(int(first), int(end))
    if not 0 < len(seeds) <= MOST_SEEDS:
        raise InputError(f"--seeds {text} holds {len(seeds)} seeds; give 1 to {MOST_SEEDS}")
    return seeds
