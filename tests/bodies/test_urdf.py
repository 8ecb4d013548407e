"""Bodies from URDF files: their kinematics, their surface, and what is refused."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yourdfpy
from scipy.spatial import cKDTree

from gepf.common.body import REST_FROM_URDF, ROOT_DOFS, ROTATION, TRANSLATION
from gepf.common.kinematics import joint_positions, link_transforms
from gepf.coordinator.bodies.urdf import read_urdf
from tests.support.refusals import refused

EXAMPLES = Path(__file__).parents[2] / "examples"
ARM = EXAMPLES / "arm7.urdf"

CRANE = """
<robot name="crane">
  <link name="foot"><visual><geometry><box size="0.4 0.3 0.1"/></geometry></visual></link>
  <link name="mast"><visual><origin xyz="0 0 0.3"/><geometry><cylinder radius="0.05" length="0.6"/></geometry>
  </visual></link>
  <link name="sledge"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>
  <link name="hook"><visual><geometry><mesh filename="package://crane/hook.stl" scale="2 1 1"/></geometry>
  </visual></link>
  <link name="tip"/>
  <joint name="turn" type="continuous"><parent link="foot"/><child link="mast"/>
    <origin xyz="0 0 0.05" rpy="0 0 0.3"/><axis xyz="0 0 2"/></joint>
  <joint name="slide" type="prismatic"><parent link="mast"/><child link="sledge"/>
    <origin xyz="0.05 0 0.5" rpy="0.2 0 0"/><axis xyz="0.8 0 0.6"/>
    <limit lower="-0.1" upper="0.4" effort="1" velocity="1"/>
  </joint>
  <joint name="weld" type="fixed"><parent link="sledge"/><child link="hook"/>
    <origin xyz="0 0 -0.1" rpy="0 0.4 0"/>
  </joint>
  <joint name="end" type="fixed"><parent link="hook"/><child link="tip"/><origin xyz="0 0 -0.2"/></joint>
</robot>
"""


@pytest.fixture(scope="module")
def crane(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A crane with a prismatic joint and a mesh that is named by its package and scaled."""
    folder = tmp_path_factory.mktemp("robots") / "crane"
    (folder / "urdf").mkdir(parents=True)
    trimesh.creation.box((0.05, 0.05, 0.2)).export(folder / "hook.stl")
    path = folder / "urdf" / "crane.urdf"
    path.write_text(CRANE)
    return path


@pytest.mark.parametrize("name", ["arm", "crane"])
def test_links_go_where_the_library_puts_them(name: str, crane: Path) -> None:
    """Joint origins in any pose are those of yourdfpy's own forward kinematics."""
    path = ARM if name == "arm" else crane
    model = read_urdf(path)
    urdf = yourdfpy.URDF.load(str(path), load_meshes=False)
    poses = np.random.default_rng(3).uniform(-0.8, 0.8, (5, len(model.dof_names)))
    poses[:, :6] = 0.0
    for pose, joints in zip(poses, joint_positions(model, poses), strict=True):
        urdf.update_cfg({n: v for n, v in zip(model.dof_names, pose, strict=True) if n not in ROOT_DOFS})
        for joint, at in zip(urdf.robot.joints, joints[1:], strict=True):
            assert model.joint_names[1 + urdf.robot.joints.index(joint)] == joint.name
            np.testing.assert_allclose(at, REST_FROM_URDF @ urdf.get_transform(joint.child)[:3, 3], atol=1e-9)


def test_a_crane_has_its_joints_links_and_limits(crane: Path) -> None:
    """Kinds, limits, unit axes, and one link for what fixed joints hold together."""
    model = read_urdf(crane)
    assert model.dof_names == (*ROOT_DOFS, "turn", "slide")
    assert model.kinds[6:].tolist() == [ROTATION, TRANSLATION]
    assert model.limits[6:].tolist() == [[-np.inf, np.inf], [-0.1, 0.4]]
    assert model.link_names == ("foot", "mast", "sledge")
    assert model.joint_names == ("foot", "turn", "slide", "weld", "end")
    np.testing.assert_allclose(np.linalg.norm(model.axes, axis=1), 1.0)
    on_hook = model.vertices[model.skin_links[:, 0] == 2]
    assert np.ptp(on_hook[:, 1]) > 0.25  # sledge and hook, which hangs below


def test_a_robot_stands_and_faces_the_camera(crane: Path) -> None:
    """URDF's z is up and its x comes towards the camera; its base's frame is the root."""
    model = read_urdf(crane)
    assert model.joint_points[0].tolist() == [0.0, 0.0, 0.0]
    assert model.vertices[:, 1].min() < -0.5  # the mast, upward
    assert model.vertices[:, 1].max() == pytest.approx(0.05)  # the foot's underside
    assert np.ptp(model.vertices[model.skin_links[:, 0] == 0], axis=0) == pytest.approx([0.3, 0.1, 0.4])


def test_the_surface_is_sampled_evenly_and_stays_where_it_was() -> None:
    """Boxes and cylinders get some thousand vertices, on the shape, with no wide gaps."""
    model = read_urdf(ARM)
    assert 3000 < len(model.vertices) < 6500
    edges = np.linalg.norm(np.diff(model.vertices[model.triangles[:, [0, 1, 2, 0]]], axis=1), axis=-1)
    assert edges.max() < 0.05
    hand = model.skin_links[:, 0] == model.link_names.index("hand")
    corner = np.array([0.03, 0.095, 0.05])  # of the palm, in the hand's frame
    at = link_transforms(model, np.zeros((1, len(model.dof_names))))  # identity at rest
    assert np.allclose(at[0, :, :, :3], np.eye(3))
    origin = model.joint_points[model.joint_names.index("hand_roll")]
    nearest = cKDTree(model.vertices[hand]).query(origin + REST_FROM_URDF @ corner)[0]
    assert nearest < 1e-6


def test_a_thin_plate_keeps_both_sides(tmp_path: Path) -> None:
    """Vertices of opposite sides are not one, however thin the plate."""
    path = tmp_path / "plate.urdf"
    path.write_text(
        '<robot name="plate"><link name="plate"><visual><geometry><box size="0.5 0.5 0.002"/></geometry>'
        "</visual></link></robot>"
    )
    model = read_urdf(path)
    up, down = model.vertices[:, 1] < 0.0, model.vertices[:, 1] > 0.0
    assert min(up.sum(), down.sum()) > 1000


def robot(joint: str = "", link: str = "", extra: str = "") -> str:
    """A box with another one on a joint."""
    box = "<visual><geometry><box size='0.1 0.1 0.1'/></geometry></visual>"
    return (
        f"<robot name='r'><link name='a'>{box}</link><link name='b'>{link or box}</link>"
        "<joint name='j' type='revolute'><parent link='a'/><child link='b'/><axis xyz='0 0 1'/>"
        f"{joint}</joint>"
        f"{extra}</robot>"
    )


def test_a_joint_that_mimics_moves_on_its_own(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """The second finger of a gripper is tracked like any joint, which is reported."""
    path = tmp_path / "gripper.urdf"
    path.write_text(robot("<mimic joint='k'/>"))
    assert read_urdf(path).dof_names == (*ROOT_DOFS, "j")
    assert "'j' mimics 'k', but is tracked independently" in caplog.text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("not xml", "is not a URDF file"),
        (robot().replace("revolute", "planar"), "joint 'j' is planar"),
        ("<robot name='r'><link name='a'>", "its XML is damaged"),
        ("<mujoco/>", "its root is <mujoco>, not <robot>"),
        (robot().replace("child link='b'", "child link='c'"), "are not one tree"),
        (robot("<limit lower='${low}' upper='1'/>"), "contains xacro macros; run xacro"),
        (robot("<axis xyz='0 0 0'/>").replace("<axis xyz='0 0 1'/>", ""), "axis of joint 'j' is zero"),
        (robot("<limit lower='1' upper='-1' effort='1' velocity='1'/>"), "lower limit above"),
        (robot().replace("'j'", "'root_tx'"), "'root_tx' is used twice"),
        (robot(extra="<link name='c'/>"), "are not one tree"),
        (robot().replace("child link='b'", "child link='a'"), "are not one tree"),
        (robot(link="<visual><geometry><mesh filename='gone.stl'/></geometry></visual>"), "mesh gone.stl"),
        ("<robot name='r'><link name='a'/></robot>", "no surface"),
        ("<robot name='r'/>", "are not one tree"),
    ],
)
def test_what_cannot_be_tracked_is_refused_in_one_line(text: str, message: str, tmp_path: Path) -> None:
    """Each fault of a file is reported as the user's, with a correction."""
    path = tmp_path / "robot.urdf"
    path.write_text(text)
    with refused(message):
        read_urdf(path)


UNITS = [(0.01, 1.0), (0.001, 1.0), (0.0254, 1.0), (1.0, 0.01), (0.01, 2.0)]


@pytest.mark.parametrize("kind", ["visual", "collision"])
@pytest.mark.parametrize(("unit", "scale"), UNITS)
def test_a_collada_mesh_has_the_unit_that_it_states(
    tmp_path: Path, unit: float, scale: float, kind: str
) -> None:
    """Times the scale of the robot's file, as ROS draws it; also of collision shapes."""
    size = np.array([0.3, 0.2, 0.5])
    box = trimesh.creation.box(size / (unit * scale))
    content = bytes(box.export(file_type="dae")).decode()
    stated = f'<asset><unit name="unit" meter="{unit}"/>'
    content = re.sub("<unit[^>]*>(</unit>)?", "", content).replace("<asset>", stated)
    assert stated in content
    (tmp_path / "box.dae").write_text(content)
    mesh = f"<geometry><mesh filename='box.dae' scale='{scale} {scale} {scale}'/></geometry>"
    (tmp_path / "box.urdf").write_text(
        f"<robot name='r'><link name='a'><{kind}>{mesh}</{kind}></link></robot>"
    )
    extents = np.ptp(read_urdf(tmp_path / "box.urdf").vertices, axis=0)
    assert np.sort(extents) == pytest.approx(np.sort(size), rel=1e-3)


def test_a_body_of_an_implausible_size_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Meshes in millimetres without a scale, which a file like `.stl` cannot state."""
    trimesh.creation.box((300.0, 200.0, 500.0)).export(tmp_path / "box.stl")
    path = tmp_path / "large.urdf"
    path.write_text(robot(link="<visual><geometry><mesh filename='box.stl'/></geometry></visual>"))
    read_urdf(path)
    assert "the body is 500 m large at rest; check the scale of its meshes" in caplog.text


def test_collision_shapes_stand_in_where_nothing_is_seen(tmp_path: Path) -> None:
    """A file with collision geometry only can be tracked."""
    path = tmp_path / "robot.urdf"
    path.write_text(robot().replace("visual>", "collision>"))
    assert len(read_urdf(path).vertices) > 2000
