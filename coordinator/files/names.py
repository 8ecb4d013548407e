"""Names of the files beside a sequence."""

from __future__ import annotations

CAMERA_FILE = "camera_intrinsic.json"
TRUTH_FILE = "truth.npz"
START_FILE = "init.json"
