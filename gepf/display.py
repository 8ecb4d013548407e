"""Runs and estimates as HTML, for notebooks: skeletons and a table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from coordinator.pictures.overlay import bones

Array = NDArray[np.float64]

PICTURED = 6  # poses of a run
HEIGHT_PX = 150
MARGIN_M = 0.1


def page(picture: str, rows: Iterable[tuple[str, object]]) -> str:
    """A picture, and a table of names and values."""
    lines = (Markup("<tr><th>{}</th><td>{}</td></tr>").format(name, value) for name, value in rows)
    return f"{picture}<table>{Markup('').join(lines)}</table>"


def skeletons(names: tuple[str, ...], joints: Array, strength: Sequence[float], *, apart: bool) -> str:
    """Skeletons (N, J, 3) as the camera sees them from far away, as SVG; the first is drawn last.

    strength: opacity (N,), 0 to 1. apart: side by side, in the order of time, or at their places.
    """
    lines = bones(names)
    if not lines or not len(joints):
        return ""
    flat = joints[..., :2].copy()
    if apart:
        flat[..., 0] -= flat[..., 0].min(axis=1, keepdims=True)
        ends = np.cumsum(flat[..., 0].max(axis=1) + 2.0 * MARGIN_M)
        flat[..., 0] += np.concatenate([[0.0], ends[:-1]])[:, None]
    low, size = flat.min(axis=(0, 1)) - MARGIN_M, np.ptp(flat, axis=(0, 1)) + 2.0 * MARGIN_M
    drawn = []
    for skeleton, alpha in reversed(list(zip(flat, strength, strict=True))):
        path = "".join(
            f"M{skeleton[a, 0]:.3f},{skeleton[a, 1]:.3f}L{skeleton[b, 0]:.3f},{skeleton[b, 1]:.3f}"
            for a, b in lines
        )
        drawn.append(f'<path d="{path}" stroke-opacity="{alpha:.2f}"/>')
    box = f"{low[0]:.3f} {low[1]:.3f} {size[0]:.3f} {size[1]:.3f}"
    style = 'fill="none" stroke="#1f77b4" stroke-width="0.03" stroke-linecap="round"'
    return f'<svg viewBox="{box}" height="{HEIGHT_PX}" {style}>{"".join(drawn)}</svg>'
