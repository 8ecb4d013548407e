"""People of any measures as one moved surface: on the surface that is meshed for them, joints exactly."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import trimesh

from coordinator.bodies.choice import choose_bodies, load_body
from coordinator.bodies.human.measures import Measures
from coordinator.bodies.human.shape_space import shape_space
from coordinator.bodies.human.template import human_of
from coordinator.bodies.tracked import coarsen
from tests.support.refusals import refused

PEOPLE = (
    Measures.of(),
    Measures.of(1.6, 1.2),
    Measures.of(1.9, 0.85),
    Measures.of(1.75, thigh=0.48),
    Measures.of(1.75, trunk=0.53, shoulder_width=0.31, hip_width=0.16, forearm=0.22, upper_arm=0.33),
)


@pytest.mark.parametrize("measures", PEOPLE, ids=str)
def test_the_moved_surface_is_the_meshed_one(measures: Measures) -> None:
    """Its vertices lie 1.5 mm from the mesh in the mean, 99 of 100 within 8 mm; joints and axes are exact."""
    moved, meshed = shape_space().person(measures), human_of(measures)
    surface = trimesh.Trimesh(meshed.vertices, meshed.triangles, process=False)
    apart = trimesh.proximity.closest_point(surface, moved.vertices)[1]  # type: ignore[no-untyped-call]
    assert apart.mean() < 0.0015
    assert np.percentile(apart, 99) < 0.008
    np.testing.assert_allclose(moved.joint_points, meshed.joint_points, atol=1e-12)
    np.testing.assert_allclose(moved.points, meshed.points, atol=1e-12)
    np.testing.assert_array_equal(moved.limits, meshed.limits)


def test_a_coarse_surface_is_near_the_fine_one() -> None:
    """A third of the vertices, with every fine one within half a cell of the coarse surface."""
    fine = shape_space().usual
    coarse = coarsen(fine, 0.06)
    surface = trimesh.Trimesh(coarse.vertices, coarse.triangles, process=False)
    apart = trimesh.proximity.closest_point(surface, fine.vertices)[1]  # type: ignore[no-untyped-call]
    assert 3 * len(coarse.vertices) < len(fine.vertices)
    assert apart.max() < 0.03


def test_a_person_of_a_file_has_its_measures(tmp_path: Path) -> None:
    """An earlier file gives the same person; measures that the file omits follow from stature."""
    path = tmp_path / "person.json"
    path.write_text(json.dumps(asdict(PEOPLE[-1])))
    assert load_body(str(path)).hash == shape_space().person(PEOPLE[-1]).hash
    bodies = choose_bodies(None, "default", str(path))
    assert bodies.measures == (1.75, 1.0)
    path.write_text(json.dumps({"stature": 1.9, "girth": 0.85}))
    assert load_body(str(path)).hash == shape_space().person(PEOPLE[2]).hash


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ({"stature": 1.8, "shoulder_below": 0.02}, "unknown measure 'shoulder_below'; leave it out"),
        ({"stature": 180.0}, "is implausible; give metres"),
        ({"thigh": "long"}, 'thigh is "long"; give a finite number'),
        ([1.8], "contains no names with numbers; write {measure: metres}"),
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
