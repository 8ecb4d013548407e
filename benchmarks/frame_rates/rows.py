"""What is compared: methods and numbers of particles, each a row of the table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import msgspec

from benchmarks.choices import settings_with
from common.errors import InputError
from common.settings import Settings

HARD_ACTIONS = (5, 12, 14, 15, 17, 21, 25, 26)
"""Fast motion, and limbs that hide each other."""

STILL = "never moves"
PAPERS_STEP = ("explore=false", "pace_iterations=0")


@dataclass(frozen=True, slots=True)
class Row:
    """A way to track. Without settings to change it is the tracker that never moves."""

    name: str
    changes: tuple[str, ...] | None = ()  # in place of those of `gepf track`, `key=value`
    particles: int | None = None

    def settings(self, seed: int, more: Sequence[str] = ()) -> Settings:
        """What is tracked with; `more` changes come last."""
        if self.changes is None:
            raise ValueError("a tracker that never moves has no settings")
        settings = settings_with((*self.changes, *more), self.particles)
        return msgspec.structs.replace(settings, seed=seed)

    @property
    def draws(self) -> bool:
        """Whether a seed changes anything."""
        return self.changes is not None and self.name != "gradient"


ROWS = (
    Row(STILL, None),
    Row("gradient", ("method=gradient",)),
    *(Row(f"{count} particle{'s'[: count != 1]}", (), count) for count in (1, 20, 100)),
    *(
        Row(f"paper's step, {count} iterations", (*PAPERS_STEP, f"icp_iterations={count}"), 20)
        for count in (3, 6)
    ),
)


def choose_rows(only: Sequence[str] | None) -> list[Row]:
    """The rows of these names, or all; InputError for an unknown one."""
    known = {row.name: row for row in ROWS}
    for name in only or ():
        if name not in known:
            raise InputError(f"no row '{name}'; choose from {', '.join(known)}")
    return list(ROWS) if only is None else [known[name] for name in only]
