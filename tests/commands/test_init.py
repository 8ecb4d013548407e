"""`gepf init`: a start file from joint values, whose base is found and whose pose is refined."""

from __future__ import annotations

import json
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from coordinator.cli import main
from coordinator.results.evaluation import read_truth
from coordinator.results.track import read_track
from tests.support.stand_ins import Direct

ARM = str(Path(__file__).parents[2] / "examples" / "arm7.urdf")


def connect(*_: object) -> nullcontext[Direct]:
    """Refine in this process."""
    return nullcontext(Direct())


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three frames of a robot arm."""
    folder = tmp_path_factory.mktemp("robot") / "sequence"
    assert main(["synth", "roam", "--model", ARM, "--frames", "3", "--out", str(folder), "-q"]) == 0
    return folder


def controllers_values(sequence: Path, off_deg: float) -> list[str]:
    """--set for each joint of the first frame, a few degrees off; nothing of the base."""
    truth = read_truth(sequence / "truth.npz")
    named = dict(zip(truth.dof_names, np.degrees(truth.pose[0]).tolist(), strict=True))
    joints = [(name, value) for name, value in named.items() if not name.startswith("root_")]
    return [word for name, value in joints for word in ("--set", f"{name}={value + off_deg}")]


def test_a_robot_is_placed_and_refined_from_its_joint_values_alone(sequence: Path, tmp_path: Path) -> None:
    """Where it stands is found; the file and a picture of both poses are written; tracking starts from it."""
    out = tmp_path / "start.json"
    options = [ARM, str(sequence), "--out", str(out), *controllers_values(sequence, 4.0), "-q"]
    assert main(["init", *options], connect) == 0
    truth = read_truth(sequence / "truth.npz")
    true = dict(zip(truth.dof_names, truth.pose[0].tolist(), strict=True))
    found = json.loads(out.read_text())
    assert abs(found["root_tz"] - true["root_tz"]) < 0.02
    off = [abs(found.get(name, 0.0) - value) for name, value in true.items() if "root" not in name]
    assert np.degrees(np.median(off)) < 2.0
    with Image.open(tmp_path / "start.png") as picture:
        assert picture.width > 2 * 640
    run = [
        "track",
        str(sequence),
        "--model",
        ARM,
        "--dof",
        "joints",
        "--init",
        str(out),
        "-q",
        "--no-pictures",
    ]
    assert main([*run, "--out", str(tmp_path / "run")], connect) == 0
    assert read_track(tmp_path / "run").status.tolist() == ["tracked"] * 3


def test_values_may_be_kept_as_they_are_given(sequence: Path, tmp_path: Path) -> None:
    """A file's radians and metres, --set's degrees over them, no descent."""
    out = tmp_path / "start.json"
    given = [ARM, str(sequence), "--init", str(sequence / "init.json"), "--set", "elbow=-50", "--no-refine"]
    assert main(["init", *given, "--out", str(out), "-q"], connect) == 0
    true, found = json.loads((sequence / "init.json").read_text()), json.loads(out.read_text())
    assert found.pop("elbow") == pytest.approx(np.radians(-50.0), abs=1e-5)
    assert found == {name: pytest.approx(v, abs=1e-5) for name, v in true.items() if name != "elbow"}


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--set", "elbows=3"), "unknown degree of freedom 'elbows'; choose from root_tx, "),
        (
            ("--set", "elbow=bent"),
            "--set elbow=bent is not of the form NAME=NUMBER; write elbow=30, in degrees",
        ),
        (("--set", "root_tz"), "write root_tz=30, in metres"),
        (("--dof", "elbows"), "unknown degree of freedom 'elbows'"),
        (("--frames", "7:9"), "7:9"),
    ],
)
def test_what_makes_no_sense_is_one_line(
    sequence: Path, tmp_path: Path, words: tuple[str, str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2, the choices named, nothing written."""
    assert main(["init", ARM, str(sequence), "--out", str(tmp_path / "s.json"), *words], connect) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("gepf: ")]
    assert says in line
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_there_is_kept(
    sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without --force neither the start nor the picture is replaced."""
    for name in ("s.json", "s.png"):
        (tmp_path / name).write_text("mine")
        assert main(["init", ARM, str(sequence), "--out", str(tmp_path / "s.json")], connect) == 2
        assert "replace it with --force" in capsys.readouterr().err
        assert (tmp_path / name).read_text() == "mine"
        (tmp_path / name).unlink()


def test_a_human_takes_mpeg4_names(
    sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A misspelt one is answered with those near it."""
    options = ["human", str(sequence), "--set", "r_elbow=3", "--out", str(tmp_path / "s.json")]
    assert main(["init", *options], connect) == 2
    assert "did you mean r_elbow_flexion" in capsys.readouterr().err
