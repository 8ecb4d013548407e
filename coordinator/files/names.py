"""Names of the files beside a sequence, and of those in a run's folder that several rooms know."""

from __future__ import annotations

CAMERA_FILE = "camera_intrinsic.json"
TRUTH_FILE = "truth.npz"
START_FILE = "init.json"

LOG_FILE = "frames.log"
ANIMATION_FILE, SHEET_FILE, FILM_FILE = "overlay.gif", "sheet.png", "overlay.mp4"
HYPOTHESES_FILE, ERRORS_FILE = "hypotheses.png", "errors.png"
