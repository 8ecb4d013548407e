"""How the tests run: examples are the same every time, and the first call of a kernel may compile it."""

from __future__ import annotations

from hypothesis import settings

settings.register_profile("gepf", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("gepf")
