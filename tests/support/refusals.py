"""Checks of error messages for wrong input."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from gepf.common.errors import InputError


@contextmanager
def refused(says: str | None = None) -> Iterator[pytest.ExceptionInfo[InputError]]:
    """The body must raise an InputError of one line that matches `says`; gives the error."""
    with pytest.raises(InputError, match=says) as caught:
        yield caught
    assert "\n" not in str(caught.value)
