"""The command `gepf` as `python -m gepf.coordinator.cli`."""

from __future__ import annotations

import sys

from gepf.coordinator.cli import main

if __name__ == "__main__":
    sys.exit(main())
