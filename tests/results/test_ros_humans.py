"""Bodies of REP 155: the model of the package human_description, with our joint states, is the person."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from yourdfpy import URDF

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.kinematics import joint_positions
from gepf.coordinator.results.ros_humans import body_frames, body_id, joint_states
from tests.support.bodies import person
from tests.support.runs import swing

CHAIN = (
    # joint and its link, parent, axis: the recommended kinematic model, figure of REP 155 and human-tpl.xacro
    ("waist", "body", (0, 1, 0)),
    ("r_head", "torso", (1, 0, 0)),
    ("y_head", "r_head", (0, 0, 1)),
    ("p_head", "y_head", (0, -1, 0)),
    *(
        row
        for side, out in (("l", 1), ("r", -1))
        for row in (
            (f"{side}_y_shoulder", "torso", (0, 0, -out)),
            (f"{side}_p_shoulder", f"{side}_y_shoulder", (out, 0, 0)),
            (f"{side}_r_shoulder", f"{side}_p_shoulder", (0, 0, out)),
            (f"{side}_elbow", f"{side}_shoulder", (0, -1, 0)),
            (f"{side}_y_hip", "body", (0, 0, -1)),
            (f"{side}_p_hip", f"{side}_y_hip", (out, 0, 0)),
            (f"{side}_r_hip", f"{side}_p_hip", (0, -1, 0)),
            (f"{side}_knee", f"{side}_hip", (0, -1, 0)),
        )
    ),
)
LINKS = {f"{side}_r_{part}": f"{side}_{part}" for side in "lr" for part in ("shoulder", "hip")}
UNIT = {f"{side}_{part}": (0, 0, -1) for side in "lr" for part in ("elbow", "knee")}
ENDS = (("elbow", "wrist"), ("knee", "ankle"))
FIXED = (
    ("torso", "waist"),
    ("head", "p_head"),
    *((f"{side}_{end}", f"{side}_{part}") for side in "lr" for part, end in ENDS),
)
SEGMENTS = (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"))


def model_of_rep_155(folder: Path) -> URDF:
    """The kinematic model, with limbs of length 1 and everything else at one point."""
    joints = [(name, "revolute", parent, LINKS.get(name, name), axis) for name, parent, axis in CHAIN]
    joints += [(name, "fixed", parent, name, (1, 0, 0)) for name, parent in FIXED]
    links = {"body"} | {link for _, _, _, link, _ in joints}
    ends = dict.fromkeys((*UNIT, *(name for name, _ in FIXED if name[1] == "_")), (0, 0, -1))
    text = "".join(f'<link name="{link}"/>' for link in sorted(links))
    for name, kind, parent, link, axis in joints:
        at = " ".join(map(str, ends.get(name, (0, 0, 0))))
        text += (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{link}"/>'
            f'<origin xyz="{at}"/><axis xyz="{" ".join(map(str, axis))}"/>'
            '<limit lower="-7" upper="7" effort="1" velocity="1"/></joint>'
        )
    (folder / "human.urdf").write_text(f'<robot name="human">{text}</robot>')
    return URDF.load(str(folder / "human.urdf"), load_meshes=False)


def directions(places: dict[str, Array], side: str) -> Array:
    """Unit vectors (4, 3) along upper arm, forearm, thigh and shank."""
    along = [
        places[f"{side}_{end}"] - places[f"{side}_{start}"]
        for limb in SEGMENTS
        for start, end in pairwise(limb)
    ]
    return np.array([each / np.linalg.norm(each) for each in along])


def poses_of(body: BodyModel) -> Array:
    """Poses (F, D) all over the ranges of the joints, and that at rest."""
    return np.concatenate([np.zeros((1, len(body.dof_names))), *(swing(body, 8, seed) for seed in range(4))])


def test_the_kinematic_model_with_our_joint_states_has_the_limbs_of_the_person(tmp_path: Path) -> None:
    """Upper arms, forearms, thighs and shanks have its directions within 0.1 degrees, in any pose."""
    body, urdf = person(), model_of_rep_155(tmp_path)
    for pose in poses_of(body):
        frames = body_frames(body, pose)
        states = joint_states(frames)
        assert set(states) == set(urdf.actuated_joint_names)
        urdf.update_cfg(dict(states))
        placed = {link: urdf.get_transform(link, "body")[:3, 3] for link in urdf.link_map}
        places = dict(zip(body.joint_names, joint_positions(body, pose[None])[0], strict=True))
        turn = frames["body"][1]
        for short, side in (("l", "left"), ("r", "right")):
            found, true = turn.apply(directions(placed, short)), directions(places, side)
            off = np.degrees(np.arccos(np.clip(np.sum(found * true, axis=1), -1.0, 1.0)))
            assert off.max() < 0.1


def test_somebody_who_stands_has_the_signs_of_the_model() -> None:
    """Arms raised to the sides, elbows and knees bent: signs as in the ranges of human-tpl.xacro."""
    body = person()
    pose = np.zeros(len(body.dof_names))
    for side in "lr":
        pose[body.dof(f"{side}_shoulder_abduct")] = 1.0
        pose[body.dof(f"{side}_elbow_flexion")] = 1.2
        pose[body.dof(f"{side}_knee_flexion")] = 0.8
    states = joint_states(body_frames(body, pose))
    for side in "lr":
        assert 0.8 < states[f"{side}_p_shoulder"] < 1.4
        assert states[f"{side}_elbow"] == pytest.approx(1.2, abs=0.1)
        assert states[f"{side}_knee"] == pytest.approx(-0.8, abs=0.1)


def test_identifiers_are_parts_of_topics() -> None:
    """People of one run have different ones, without a slash."""
    assert [body_id(topic) for topic in ("/gepf", "/gepf/person1", "/gepf/person2")] == [
        "gepf",
        "gepf_person1",
        "gepf_person2",
    ]
