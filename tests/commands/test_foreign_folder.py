"""Code of the user's working folder is never run, and an installed gepf takes no names from others."""

from __future__ import annotations

import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from tests.support.processes.programs import GEPF, WORKER
from tests.support.small_sequence import OPTIONS, write_small_sequence

ROOT = Path(__file__).parents[2]
TAKEN = ("common", "coordinator", "worker")
"""Names that a user's own code may well have."""


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """A working folder with a module and packages of such names, which leave a trace when they are run."""
    trace = f"import pathlib; pathlib.Path({str(tmp_path / 'trace')!r}).touch()\n"
    (tmp_path / "worker.py").write_text(trace)
    for name in ("common", "coordinator"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(trace)
    return tmp_path


def run_in(folder: Path, command: tuple[str, ...]) -> subprocess.CompletedProcess[str]:
    """Run a command in a folder, with gepf on the path behind it, as an installed gepf is."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300, check=False
    )


def test_a_run_leaves_the_code_of_its_working_folder_alone(foreign: Path) -> None:
    """A run with a local worker: neither fails because of it nor executes any of it."""
    write_small_sequence(foreign / "sequence", 3)
    program = (sys.executable, "-P", *GEPF[1:])
    done = run_in(foreign, (*program, "track", "sequence", "--out", "run", *OPTIONS, "--workers", "1"))
    assert done.returncode in (0, 3), done.stderr
    assert (foreign / "run" / "track.npz").exists()
    assert not (foreign / "trace").exists()


def test_a_script_beside_packages_of_these_names_uses_the_library(foreign: Path) -> None:
    """Its folder comes first on the path of a script."""
    (foreign / "script.py").write_text("import gepf; gepf.Tracker, gepf.open_source; print('imported')\n")
    done = run_in(foreign, (sys.executable, "script.py"))
    assert done.stdout == "imported\n", done.stderr
    assert not (foreign / "trace").exists()


def build(kind: str, checkout: Path, folder: Path) -> Path:
    """The wheel or sdist of a checkout, in a new folder."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", str(folder)]
    subprocess.run(command, cwd=checkout, check=True, capture_output=True, timeout=300)
    (built,) = folder.iterdir()
    return built


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of this checkout."""
    return build("wheel", ROOT, tmp_path_factory.mktemp("dist") / "wheel")


def test_the_wheel_installs_one_package(wheel: Path) -> None:
    """`gepf`, with everything in it that belongs to it, and nothing beside it."""
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.partition("/")[0] for name in names if ".dist-info/" not in name} == {"gepf"}
    for needed in (
        "__init__.py",
        "py.typed",
        "common/protocol/wire.py",
        "coordinator/bodies/human/person.npz",
        "coordinator/bodies/human/pixels.npz",
        "coordinator/bodies/human/poses.npz",
        "coordinator/report/page.html.j2",
        "worker/cli.py",
    ):
        assert f"gepf/{needed}" in names


def test_the_source_distribution_builds_the_same_wheel(wheel: Path, tmp_path: Path) -> None:
    """Although three folders of the package are links in a checkout: the same files with the same bytes."""
    with tarfile.open(build("sdist", ROOT, tmp_path / "sdist")) as archive:
        archive.extractall(tmp_path / "source", filter="data")
    (source,) = (tmp_path / "source").iterdir()
    again = build("wheel", source, tmp_path / "again")
    assert {each.filename: each.CRC for each in zipfile.ZipFile(again).infolist()} == {
        each.filename: each.CRC for each in zipfile.ZipFile(wheel).infolist()
    }


def test_an_installed_worker_starts(wheel: Path, foreign: Path) -> None:
    """From the wheel alone, in a folder with code of the same names."""
    installed = foreign / "site"
    zipfile.ZipFile(wheel).extractall(installed)
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    code = (
        "import gepf, sys; from gepf.worker.cli import main; from gepf.coordinator.cli import main;"
        f"assert gepf.__file__.startswith({str(installed)!r}), gepf.__file__"
    )
    for command in ([sys.executable, "-P", "-c", code], [sys.executable, "-P", *WORKER[1:], "--help"]):
        done = subprocess.run(
            command, cwd=foreign, env=environment, capture_output=True, text=True, timeout=300, check=False
        )
        assert done.returncode == 0, done.stderr
    assert not (foreign / "trace").exists()
