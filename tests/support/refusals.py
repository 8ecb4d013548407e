"""What the user's faults are answered with."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from common.errors import InputError


@contextmanager
def refused(says: str | None = None) -> Iterator[pytest.ExceptionInfo[InputError]]:
    """What is done here is refused in one line, which matches `says`; its text is known afterwards."""
    with pytest.raises(InputError, match=says) as caught:
        yield caught
    assert "\n" not in str(caught.value)
