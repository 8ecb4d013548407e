"""A URDF file as text: what is wrong with it in words that a reader of the file can use."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

from common.errors import InputError

XACRO = "http://www.ros.org/wiki/xacro"


def check_text(path: Path) -> None:
    """InputError for what is no XML, no robot, still to be expanded, or names links that are not there."""
    try:
        root = ET.parse(path).getroot()
    except ET.ParseError as error:
        raise InputError(f"{path} is no URDF: its XML is damaged ({error}); copy it again") from None
    except (LookupError, ValueError):
        return  # an encoding that the reader of URDF knows, or names
    if root.tag != "robot":
        raise InputError(f"{path} is no URDF: it is a <{root.tag}>, not a <robot>; give a robot's file")
    if any(XACRO in str(part.tag) or "${" in "".join(part.attrib.values()) for part in root.iter()):
        raise InputError(f"{path} holds xacro's macros; run xacro {path.name} > robot.urdf, and give that")
    links = {link.get("name") for link in root.iterfind("link")}
    for joint in root.iterfind("joint"):
        for side in ("parent", "child"):
            end = joint.find(side)
            if end is None or end.get("link") not in links:
                named = "no link" if end is None else f"the link '{end.get('link')}', which is not there"
                raise InputError(f"{path}: joint '{joint.get('name')}' has as {side} {named}; mend it")
