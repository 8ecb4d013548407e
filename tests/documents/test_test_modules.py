"""The tests themselves: what they share stands in tests/support, so that each can be read by itself."""

from __future__ import annotations

import re
from pathlib import Path

TESTS = Path(__file__).parents[1]
OF_A_TEST = re.compile(r"^\s*(from|import) tests\b.*\btest_\w+", re.MULTILINE)


def test_no_module_imports_a_test_module() -> None:
    """What two test modules share is in neither of them."""
    assert OF_A_TEST.search("    from tests.pool import test_pool")
    assert not [path for path in TESTS.rglob("*.py") if OF_A_TEST.search(path.read_text())]
