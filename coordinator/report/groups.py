"""Which angles stand together: parts of the body, right beside left."""

from __future__ import annotations

SIDES = ("right_", "left_")
ARM = ("clavicular", "shoulder", "elbow", "forearm", "wrist", "pinky", "ring", "middle", "index", "thumb")


def group_angles(names: tuple[str, ...]) -> list[tuple[str, list[str]]]:
    """Angles by the part of the body: pelvis and trunk, arms, legs; of a robot, base and joints."""
    groups: dict[str, list[str]] = {"pelvis and trunk": [], "arms": [], "legs": [], "base and joints": []}
    person = are_a_persons(names)
    for name in sorted(names, key=lambda name: (names.index(pair_of(name, names)), name.startswith("left_"))):
        if not person:
            groups["base and joints"].append(name)
        elif name.startswith(SIDES):
            groups["arms" if any(part in name for part in ARM) else "legs"].append(name)
        else:
            groups["pelvis and trunk"].append(name)
    return [(group, members) for group, members in groups.items() if members]


def are_a_persons(names: tuple[str, ...]) -> bool:
    """Whether these angles are a person's, not a robot's or an object's."""
    return any(name.startswith(("pelvis_", "trunk_", *SIDES)) for name in names)


def pair_of(name: str, names: tuple[str, ...]) -> str:
    """The right one of a pair of sides, the name itself where there is none: pairs stand by this."""
    right = name.replace("left_", "right_", 1)
    return right if right in names else name
