"""Python in a fresh process, with another copy of the packages."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from common.kernel_cache import VARIABLE


def fresh_python(root: Path, code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Code run with the packages in a folder, which keep compiled kernels where they do by themselves."""
    clean = {name: value for name, value in os.environ.items() if name != VARIABLE}
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=root,
        env={**clean, "PYTHONPATH": str(root), **environment},
        capture_output=True,
        text=True,
        check=False,
    )
