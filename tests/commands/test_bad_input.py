"""Wrong input: exit code 2, one line with the fault and its correction, and no partial files."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from common.camera import Intrinsics
from coordinator.bodies.human.template import human
from coordinator.cli import main
from tests.support.recordings import write_open3d
from tests.support.runs import swing, write_run
from tests.support.stand_ins import no_workers

CAMERA = Intrinsics(8, 6, 10.0, 10.0, 4.0, 3.0)
Damage = Callable[[Path], object]


@pytest.fixture(autouse=True)
def _no_traces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("GEPF_DEBUG", raising=False)


@pytest.fixture
def sequence(tmp_path: Path) -> Path:
    """Four whole frames and a start."""
    folder = write_open3d(tmp_path / "wall", np.full((4, 6, 8), 2000, np.uint16), CAMERA)
    (folder / "init.json").write_text('{"root_tz": 2.0}')
    return folder


@pytest.fixture
def refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Run a command line that must be refused, and return its error line."""

    def run(*arguments: object) -> str:
        before = contents(tmp_path)
        assert main([str(each) for each in arguments], no_workers) == 2
        out, err = capsys.readouterr()
        assert out == ""
        *before_it, fault = err.splitlines()
        assert fault.startswith("gepf: ")
        assert all(line.endswith("; loading") for line in before_it)  # as is said where that takes long
        assert contents(tmp_path) == before
        return fault

    return run


def contents(folder: Path) -> dict[Path, bytes]:
    """All that a folder holds, at any depth."""
    return {path: path.read_bytes() if path.is_file() else b"" for path in folder.rglob("*")}


def with_file(name: str, content: str) -> Damage:
    """Write a file into the sequence."""
    return lambda folder: (folder / name).write_text(content)


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (with_file("depth/000000.png", "x"), "000000.png is damaged"),
        (
            with_file("init.json", '{"elbow": 1}'),
            "init.json: unknown degree of freedom 'elbow'; gepf model dofs lists all; is --model right?",
        ),
        (with_file("init.json", '{"root_tz": NaN}'), "init.json: JSON is malformed"),
        (with_file("truth.npz", "truth"), "truth.npz is damaged"),
    ],
)
def test_a_damaged_folder_is_refused(
    sequence: Path, tmp_path: Path, refused: Callable[..., str], damage: Damage, says: str
) -> None:
    """Faults of a recording's files or first frame are found before anything is written.

    `tests.sources` tests other faults, `tests.results.test_resume` those of later frames.
    """
    damage(sequence)
    assert says in refused("track", sequence, "--out", tmp_path / "out")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--method", "magic"], "unknown method 'magic'; choose from gepf, gradient, condensation, annealed"),
        (["--model", "horse"], "unknown model 'horse'; give human, a URDF file"),
        (["--dof", "root_tx,tail"], "unknown degree of freedom 'tail'; gepf model dofs lists all"),
        (["--dof", ","], "--dof , is not understood; give names"),
        (["--particles", "0"], "Invalid value for '--particles': Input should be greater than or equal to 1"),
        (["--noise-depth", "0"], "--noise-depth 0 is not above 0"),
        (["--far", "nan"], "--far nan is not above 0"),
        (["--method", "gradient", "--particles", "5"], "leave --particles out"),
        (["--seed", "-1"], "Invalid value for '--seed': Input should be"),
        (["--workers", "-1"], "Invalid value for '--workers': Input should be greater than or equal to 0"),
        (["--workers", "0"], "with --workers 0 no worker could join; add --listen or --connect"),
        (["--listen", "7447"], "--listen '7447' is not an endpoint; give one such as tcp/127.0.0.1:7447"),
        (["--frames", "2:9"], "--frames 2:9 is out of range"),
        (["--frames", "3"], "--frames '3' is not of the form A:B; this sequence has frames 0:4"),
        (["--init", "nowhere.json"], "no such file: nowhere.json; give --init a file, or auto"),
    ],
)
def test_an_option_that_makes_no_sense_is_refused(
    sequence: Path, tmp_path: Path, refused: Callable[..., str], options: list[str], says: str
) -> None:
    """The line names the option's valid choices or how to give it."""
    assert says in refused("track", sequence, "--out", tmp_path / "out", *options)


def test_a_path_without_a_sequence_is_refused(tmp_path: Path, refused: Callable[..., str]) -> None:
    """An empty folder, a file of another kind, and a path that is too long."""
    (tmp_path / "empty").mkdir()
    (tmp_path / "text").write_text("text")
    for path, says in (
        (tmp_path / "empty", "holds no depth sequence"),
        (tmp_path / "text", "or write depth/000000.png"),
        ("x" * 5000, "cannot read"),
    ):
        assert says in refused("track", path, "--out", tmp_path / "out")


def test_an_output_folder_that_cannot_be_had_is_refused(
    sequence: Path, tmp_path: Path, refused: Callable[..., str]
) -> None:
    """A file, below a file, where nobody can write, and a path that is too long."""
    (tmp_path / "file").touch()
    for out in (tmp_path / "file", tmp_path / "file" / "out", "/proc/out", tmp_path / ("x" * 5000)):
        assert "cannot write to" in refused("track", sequence, "--out", out)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("evaluate {}/run --truth {}/truth.npz", "no such folder"),
        ("export run --out x", "Missing option '--to' FORMAT: csv, mot, c3d, trc, bvh"),
        ("export run --to avi --out x", "choose from bvh, c3d, csv"),
        ("synth leg --out {}/seq", "unknown scene 'leg'; choose from arm"),
        ("demo --out {}", "files that are not from a demo; choose another --out"),
        ("demo --scene dog", "unknown scene 'dog'; choose from person, arm"),
        ("trak", "No such command 'trak'. Did you mean 'track'?"),
        ("nonsense", "No such command 'nonsense'; there are demo, track, info"),
        ("track --out {}/out", "Missing argument"),
        ("track seq", "Missing option '--out' DIR: New folder for the results."),
    ],
)
def test_all_commands_refuse_in_the_same_way(
    tmp_path: Path, refused: Callable[..., str], line: str, says: str
) -> None:
    """Unknown runs, scenes, formats and commands, missing arguments; the line has the choices."""
    (tmp_path / "thesis.tex").touch()
    assert says in refused(*line.replace("{}", str(tmp_path)).split())


def test_what_is_no_truth_is_refused_in_our_words(tmp_path: Path, refused: Callable[..., str]) -> None:
    """The run's own track; `tests.results.test_evaluation` tests damaged files."""
    body = human()
    write_run(tmp_path / "run", body, swing(body, 3))
    (tmp_path / "run" / "summary.json").write_text("{}")
    own = tmp_path / "run" / "track.npz"
    assert "is the run's own track; give the truth of its sequence" in refused(
        "evaluate", tmp_path / "run", "--truth", own
    )


def test_bodies_list_their_degrees_of_freedom(capsys: pytest.CaptureFixture[str]) -> None:
    """All degrees of freedom on stdout, one a line."""
    assert main(["model", "dofs"]) == 0
    assert sorted(capsys.readouterr().out.split()) == sorted(human().dof_names)


def test_the_process_itself_ends_with_two_and_one_line(tmp_path: Path) -> None:
    """In a shell: no traceback, no box, nothing on stdout."""
    code = "import sys; from coordinator.cli import main; sys.exit(main())"
    for arguments, says in (
        (["track", str(tmp_path / "nowhere"), "--out", str(tmp_path / "out")], "no such file or folder"),
        (["track", "--points", "x"], "--points"),
    ):
        command = [sys.executable, "-c", code, *arguments]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout) == (2, "")
        (fault,) = [line for line in done.stderr.splitlines() if line.startswith("gepf: ")]
        assert says in fault
        assert done.stderr.splitlines()[-1] == fault  # before it at most what was about to be done
    assert list(tmp_path.iterdir()) == []
