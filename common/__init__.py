"""What coordinator and worker must agree on: the body, the camera, the settings, the wire."""

from __future__ import annotations

from pathlib import Path

from common.kernel_cache import keep_kernels_by_source

keep_kernels_by_source(Path(__file__).resolve().parents[1])
