"""People of any size as one moved surface: children's proportions, adults to scale, files of measures."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import trimesh

from gepf.common.body import with_fixed_shape
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.coordinator.bodies.choice import choose_bodies, load_body
from gepf.coordinator.bodies.human.measures import Measures
from gepf.coordinator.bodies.human.shape_space import Size, shape_space
from gepf.coordinator.bodies.human.template import human, human_of
from gepf.coordinator.bodies.tracked import coarsen
from tests.support.refusals import refused

LENGTHS = {"trunk": 0.53, "shoulder_width": 0.31, "hip_width": 0.16, "forearm": 0.22, "upper_arm": 0.33}
PERSON = Measures.of(1.75, **LENGTHS)


def height_shares(stature: float) -> tuple[float, float]:
    """Heights of the head, from the chin up, and of the hips above the soles, as shares of stature."""
    body = human(stature)
    hip, y = body.joint_points[body.joint_names.index("left_hip"), 1], body.vertices[:, 1]
    of_skull = body.skin_links[:, 0] == body.link_names.index("skull")
    face = y[of_skull & (body.vertices[:, 2] < -0.03 * stature)]
    return float(face.max() - y.min()) / stature, float(y.max() - hip) / stature


@pytest.mark.parametrize("stature", [0.8, 1.0, 1.2, 1.4, 1.7, 2.1])
def test_a_person_is_as_tall_as_asked(stature: float) -> None:
    """From sole to crown, child or adult."""
    assert np.ptp(human(stature).vertices[:, 1]) == pytest.approx(stature, rel=0.005)


def test_children_have_larger_heads_and_shorter_legs() -> None:
    """The head is a fifth of a child of two, and an eighth to a seventh of an adult."""
    heads, legs = zip(*(height_shares(stature) for stature in (0.85, 1.1, 1.35, 1.7)), strict=True)
    assert heads[0] > 0.18
    assert 0.12 < heads[-1] < 0.145
    assert np.all(np.diff(heads) < 0.0)
    assert np.all(np.diff(legs[:3]) > 0.0)
    assert legs[0] < legs[-1] - 0.02


def test_age_sets_the_proportions_of_a_child(tmp_path: Path) -> None:
    """Of two children of 1.2 m the younger has the shorter legs; both are said to be children."""
    legs = []
    for age in (4, 9):
        path = tmp_path / "person.json"
        path.write_text(json.dumps({"stature": 1.2, "age": age}))
        body = load_body(str(path))
        assert np.ptp(body.vertices[:, 1]) == pytest.approx(1.2, rel=0.005)
        legs.append(body.vertices[:, 1].max())
        known = choose_bodies(None, "default", str(path)).size
        assert known is not None
        size = Size(*known)
        assert shape_space().age(size.stature, size.maturity) == pytest.approx(age)
        assert f"child of about {age} years" in Measures.of(1.2, age=age).in_words()
    assert legs[0] < legs[1] - 0.01


def test_adults_differ_by_scale() -> None:
    """Of one girth, short and tall adults have one shape."""
    short, tall = human(1.5, 1.1), human(2.1, 1.1)
    np.testing.assert_allclose(tall.vertices, short.vertices * 2.1 / 1.5, atol=1e-9)
    np.testing.assert_allclose(tall.joint_points, short.joint_points * 2.1 / 1.5, atol=1e-9)


def test_a_coarse_surface_is_near_the_fine_one() -> None:
    """Fewer than half of the vertices, and 99 of 100 fine ones within half a cell of the coarse surface."""
    fine = human()
    coarse = coarsen(fine, 0.06)
    surface = trimesh.Trimesh(coarse.vertices, coarse.triangles, process=False)
    apart = trimesh.proximity.closest_point(surface, fine.vertices)[1]  # type: ignore[no-untyped-call]
    assert 2 * len(coarse.vertices) < len(fine.vertices)
    assert np.percentile(apart, 99) < 0.03


def test_a_person_of_a_file_has_its_measures(tmp_path: Path) -> None:
    """An earlier file gives the same person; measures that the file omits follow from stature."""
    path = tmp_path / "person.json"
    path.write_text(json.dumps(asdict(PERSON)))
    assert load_body(str(path)).hash == human_of(PERSON).hash
    bodies = choose_bodies(None, "default", str(path))
    assert bodies.size == Size(1.75, 1.0)
    path.write_text(json.dumps({"stature": 1.9, "girth": 0.85, "stature_deviation": 0.03}))
    assert load_body(str(path)).hash == human(1.9, 0.85).hash


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ({"stature": 1.8, "shoulder_below": 0.02}, "unknown measure 'shoulder_below'; leave it out"),
        ({"stature": 180.0}, "is implausible; give metres"),
        ({"stature": 1.8, "girth": 0.0}, "give a factor"),
        ({"stature": 1.8, "thigh": 4.0}, "give metres, about"),
        ({"age": 6}, "has no stature; add it, in metres"),
        ({"stature": 1.8, "height": 1.8}, "choose from stature, girth, age, upper_arm"),
        ({"thigh": "long"}, "Expected `float`, got `str`"),
        ([1.8], "Expected `object`, got `array`; write {measure: metres}"),
    ],
)
def test_a_file_that_is_no_persons_is_refused_in_one_line(tmp_path: Path, content: object, says: str) -> None:
    """An entry that is not a measure (any more), or is implausible; the line names the file."""
    path = tmp_path / "person.json"
    path.write_text(json.dumps(content))
    with refused() as raised:
        choose_bodies(None, "default", str(path))
    assert says in str(raised.value)
    assert str(path) in str(raised.value)


@pytest.mark.parametrize(
    "size",
    [Size(1.75, 1.0), Size(1.93, 1.2), Size(1.5, 0.9), Size(1.31, 1.1), Size(0.8, 1.0), Size(1.3, 1.0, 0.5)],
)
def test_shape_coefficients_make_everybody(size: Size) -> None:
    """Surface and joints of a person of any size, in any pose, follow from the coefficients of that size."""
    space, rng = shape_space(), np.random.default_rng(0)
    person, anybody = space.person(*size), space.anybody
    pose = rng.normal(scale=0.3, size=len(person.dof_names))
    same = np.concatenate([space.coefficients(size), pose])
    fixed = with_fixed_shape(anybody, same[: anybody.shape_count])
    for place in (pose_vertices, joint_positions):
        np.testing.assert_allclose(place(anybody, same[None]), place(person, pose[None]), atol=1e-9)
        np.testing.assert_allclose(place(fixed, pose[None]), place(person, pose[None]), atol=1e-9)
    assert space.size_of(space.coefficients(size)) == pytest.approx(size, abs=1e-9)
