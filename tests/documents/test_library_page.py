"""`docs/library.md` names what the library has."""

from __future__ import annotations

import gepf
from tests.documents.signatures import PAGE, embedded


def test_the_signatures_are_those_of_the_code() -> None:
    """Generated anew, they are what stands there; `python -m tests.documents.signatures` writes them."""
    page = PAGE.read_text(encoding="utf-8")
    assert embedded(page) == page
    assert all(f"class {name}" in page or f"\n{name}(" in page for name in gepf.__all__)
