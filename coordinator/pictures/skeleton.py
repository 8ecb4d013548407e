"""Which named joints a line joins."""

from __future__ import annotations

TRUNK = (("pelvis", "neck"), ("neck", "head"))
HALF = (
    ("neck", "{}_shoulder"),
    ("{}_shoulder", "{}_elbow"),
    ("{}_elbow", "{}_wrist"),
    ("pelvis", "{}_hip"),
    ("{}_hip", "{}_knee"),
    ("{}_knee", "{}_ankle"),
)
LINES = (*TRUNK, *((a.format(side), b.format(side)) for side in ("right", "left") for a, b in HALF))


def bones(joint_names: tuple[str, ...]) -> list[tuple[int, int]]:
    """Pairs of joint indices to join by a line; joints that no line of a person's names stay dots."""
    at = {name: j for j, name in enumerate(joint_names)}
    return [(at[a], at[b]) for a, b in LINES if a in at and b in at]
