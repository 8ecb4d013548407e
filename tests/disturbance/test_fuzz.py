"""Hostile messages in short; `make fuzz` makes many more."""

from __future__ import annotations

from collections.abc import Callable

import msgpack  # type: ignore[import-untyped]
import pytest

from tests.disturbance.fuzz import HONEST, Report, fuzz_coordinator, fuzz_decoders, fuzz_worker
from tests.support.messages import Mutator


def test_many_mutations_stay_well_formed() -> None:
    """Not only broken bytes are tried, but also whole messages with other content."""
    mutator, whole = Mutator(0, HONEST), 0
    for k in range(500):
        try:
            msgpack.unpackb(mutator.mutate(HONEST[k % len(HONEST)]), strict_map_key=False)
            whole += 1
        except (ValueError, TypeError):
            pass
    assert whole > 50


@pytest.mark.parametrize(
    ("part", "count"), [(fuzz_decoders, 2000), (fuzz_worker, 100), (fuzz_coordinator, 50)]
)
def test_hostile_messages_are_refused_by_our_own_errors(
    part: Callable[[int, int], Report], count: int
) -> None:
    """Decoders, live worker and live coordinator: no other error, no silence, no growth, right bytes."""
    report = part(count, 1)
    report.check()
    assert sum(report.outcomes.values()) >= count
