"""Wrong input: exit code 2, one line with the fault and its correction, and no partial files."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gepf.common.camera import Intrinsics
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.cli import main
from tests.support.recordings import write_open3d
from tests.support.runs import swing, write_run
from tests.support.stand_ins import no_workers

CAMERA = Intrinsics(8, 6, 10.0, 10.0, 4.0, 3.0)
Damage = Callable[[Path], object]


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
            "init.json: unknown degree of freedom 'elbow'; gepf model dofs lists all; check --model",
        ),
        (with_file("init.json", '{"root_tz": NaN}'), "init.json: JSON is malformed"),
        (with_file("init.json", '{"root_tz": 1e300}'), "init.json: root_tz is 1e+300, beyond +-100000"),
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
        (["--particles", "0"], "Invalid value for '--particles': '0' should be greater than or equal to 1"),
        (["--noise-depth", "0"], "Invalid value for '--noise-depth': '0' should be greater"),
        (["--far", "nan"], "--far nan is not valid"),
        (["--depth-scale", "1e6"], "--depth-scale 1e+06 is not between 0.0001 and 100000"),
        (["--method", "gradient", "--particles", "5"], "leave --particles out"),
        (["--seed", "-1"], "Invalid value for '--seed': '-1' should be"),
        (["--workers", "-1"], "Invalid value for '--workers': '-1' should be greater than or equal to 0"),
        (["--workers", "2000"], "Invalid value for '--workers': '2000' should be less than or equal to 1024"),
        (["--workers", "0"], "--workers 0 needs other workers; add --listen ENDPOINT or --connect"),
        (["--listen", "7447"], "--listen '7447' is not an endpoint; give one such as tcp/127.0.0.1:7447"),
        (["--listen", "tcp/[::1]:99999"], "is not an endpoint; give one such as tcp/127.0.0.1:7447"),
        (["--frames", "2:9"], "--frames 2:9 is out of range"),
        (["--frames", "3"], "--frames '3' is not of the form A:B; this sequence has frames 0:4"),
        (["--init", "nowhere.json"], "no such file: nowhere.json; give --init a file, or auto"),
        (["--people", "0"], "Invalid value for '--people'"),
        (["--people", "2", "--init", "pose.json"], "--init is the pose of one person"),
        (["--people", "2", "--model", "examples/arm7.urdf"], "--people estimates the size of each person"),
        (["--near", "3", "--far", "2"], "--near 3 is not below --far 2"),
        (["--roi", "1,2,3"], "--roi 1,2,3 is not understood; give 4 whole numbers"),
        (["--roi", "9,2,3,8"], "--roi 9,2,3,8 contains no pixel"),
        (["--person", "tallest"], "--person tallest is unknown; give X,Y in pixels or one of nearest"),
        (["--person", "4,"], "--person 4, is not understood; give 2 whole numbers"),
        (["--person", "8,2"], "--person 8,2 is outside the 8x6 images; give a pixel"),
        (["--publish-json"], "add --publish KEY"),
        (["--publish", "camera/depth"], "a subscriber needs an endpoint; add --listen"),
        (["--publish", "a/*", "--listen", "tcp/127.0.0.1:1"], "key 'a/*' cannot be used"),
        (["--record", "z"], "--record is for live input"),
        (["--color", "z", "--no-color"], "--color and --no-color exclude each other"),
        (["--color", "nowhere"], "no such folder of colour frames: nowhere; give another --color"),
        (["--joint-states", "ros2:/joints"], "for depth from ROS 2"),
        (["--listen", "tcp/0.0.0.0:7447"], "--insecure"),
    ],
)
def test_an_option_that_makes_no_sense_is_refused(
    sequence: Path, tmp_path: Path, refused: Callable[..., str], options: list[str], says: str
) -> None:
    """The line names the option's valid choices or how to give it."""
    assert says in refused("track", sequence, "--out", tmp_path / "out", *options)


LIVE = "track zenoh:camera/depth --out {}/out"
TO_ONE = "--connect tcp/127.0.0.1:1"


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("track {}/empty --out {}/out", "holds no depth sequence"),
        ("track {}/thesis.tex --out {}/out", "or write depth/000000.png"),
        (f"track {'x' * 5000} --out {{}}/out", "cannot read"),
        ("track {}/wall --out {}/thesis.tex", "cannot write to"),
        ("track {}/wall --out {}/thesis.tex/out", "cannot write to"),
        ("track {}/wall --out /proc/out", "cannot write to"),
        (f"track {{}}/wall --out {{}}/{'x' * 5000}", "cannot write to"),
        (LIVE, "a publisher needs an endpoint; add --listen ENDPOINT or --connect"),
        (f"{LIVE} {TO_ONE} --frames 1:2", "--frames"),
        (f"{LIVE} {TO_ONE} --depth-scale 1000", "--depth-scale is for recorded sequences"),
        (f"track zenoh:a*b --out {{}}/out {TO_ONE}", "such as camera/depth"),
        ("track ros2:/camera/depth --out {}/out", "unencrypted; leave --tls-* out, and add --connect"),
        ("view zenoh:camera/depth", "a publisher needs an endpoint; add --connect ENDPOINT or --listen"),
        ("view run --results camera/depth", "--results is only for viewing live input"),
        (f"view ros2:/gepf {TO_ONE}", "use RViz"),
        (f"publish x --key a/* {TO_ONE}", "such as camera/depth"),
        (f"publish x --key camera/depth {TO_ONE} --rate 0", "--rate 0"),
        ("publish {}/wall --key camera/depth", "a subscriber needs an endpoint"),
        ("router --listen tcp/0.0.0.0:7447", "--insecure"),
        ("report {}/nowhere", "no such folder"),
        ("evaluate {}/run --truth {}/truth.npz", "no such folder"),
        ("export run --out x", "Missing option '--to' FORMAT: bvh, c3d, csv"),
        ("export run --to avi --out x", "choose from bvh, c3d, csv"),
        ("synth leg --out {}/seq", "unknown scene 'leg'; choose from arm"),
        ("demo --out {}", "was not made by gepf demo; choose another --out"),
        ("demo --scene dog", "unknown scene 'dog'; choose from person, arm"),
        ("trak", "No such command 'trak'. Did you mean 'track'?"),
        ("nonsense", "No such command 'nonsense'; there are demo, track, info"),
        ("track --out {}/out", "there is nothing to track; give a recording"),
        ("track seq", "the results of a recording need a folder; add --out DIR with a new folder"),
    ],
)
@pytest.mark.usefixtures("sequence")
def test_all_commands_refuse_in_the_same_way(
    tmp_path: Path, refused: Callable[..., str], line: str, says: str
) -> None:
    """Unknown runs, scenes, formats and commands, missing arguments; the line has the choices.

    Input and output that cannot be had, and options that do not go with live input.
    """
    (tmp_path / "thesis.tex").touch()
    (tmp_path / "empty").mkdir()
    assert says in refused(*line.replace("{}", str(tmp_path)).split())


def test_what_is_no_truth_is_refused_in_our_words(tmp_path: Path, refused: Callable[..., str]) -> None:
    """The run's own track; `tests.results.test_evaluation` tests damaged files."""
    body = human()
    write_run(tmp_path / "run", body, swing(body, 3))
    assert "summary.json" in refused("report", tmp_path / "run")
    (tmp_path / "run" / "summary.json").write_text("{}")
    own = tmp_path / "run" / "track.npz"
    assert "is the track of the run itself; give the truth.npz of its sequence" in refused(
        "evaluate", tmp_path / "run", "--truth", own
    )
    page = tmp_path / "no" / "such" / "page.html"
    assert "cannot write" in refused("report", tmp_path / "run", "--out", page)
    assert "no such folder" in refused("view", tmp_path / "run", "--save", page)


def test_bodies_list_their_degrees_of_freedom(capsys: pytest.CaptureFixture[str]) -> None:
    """All degrees of freedom on stdout, one a line."""
    assert main(["model", "dofs"]) == 0
    assert sorted(capsys.readouterr().out.split()) == sorted(human().dof_names)


def test_the_process_itself_ends_with_two_and_one_line(tmp_path: Path) -> None:
    """In a shell: no traceback, no box, nothing on stdout."""
    code = "import sys; from gepf.coordinator.cli import main; sys.exit(main())"
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
