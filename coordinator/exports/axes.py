"""The axes of other programs, from those of a level camera."""

from __future__ import annotations

import numpy as np

CAMERA_TO_Y_UP = np.diag([1.0, -1.0, -1.0])
"""Half a turn about x: y up, and a person who faces the camera looks along +z, their left at +x."""

CAMERA_TO_OPENSIM = np.array([[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]])
"""OpenSim's axes: x to the front of a person who faces the camera, y up, z to their right."""
