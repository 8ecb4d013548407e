"""What is used without its packages names the extra that installs them, in one line."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import gepf
from tests.support.processes.programs import GEPF

EXAMPLES = Path(__file__).parents[2] / "examples"

COMMANDS = {
    "track nothing --out run": ("scipy", "coordinator"),
    "info nothing": ("PIL", "coordinator"),
    f"model dofs {EXAMPLES / 'bracket.urdf'}": ("yourdfpy", "robots"),
    "synth arm --frames 1 --out sequence": ("pyrender", "synth"),
    "demo --out shown": ("pyrender", "synth"),
    "view nothing": ("rerun", "view"),
}


def run_without(package: str, arguments: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run Python with `arguments` in a folder, where a package cannot be imported."""
    code = f"import runpy, sys; sys.modules[{package!r}] = None; sys.argv = sys.argv[1:]; "
    code += (
        "exec(sys.argv[1])"
        if arguments[0] == "-c"
        else "runpy.run_module(sys.argv[0], run_name='__main__', alter_sys=True)"
    )
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)


@pytest.mark.parametrize("line", COMMANDS)
def test_a_command_names_the_extra(line: str, tmp_path: Path) -> None:
    """Wrong input, one line with the package and the command that installs it, and no half of a result."""
    package, extra = COMMANDS[line]
    module = GEPF[GEPF.index("-m") + 1]
    done = run_without(package, [module, *line.split()], tmp_path)
    last = done.stderr.strip().splitlines()[-1]
    assert done.returncode == 2, done.stderr
    assert last.startswith("gepf: ")
    assert f"needs the package {package}, " in last
    assert last.endswith(f"pip install 'gepf[{extra}]'")
    assert not (tmp_path / "run").exists()
    assert not (tmp_path / "sequence").exists()


@pytest.mark.parametrize(("name", "package"), [("Tracker", "scipy"), ("open_source", "PIL")])
def test_the_library_names_the_extra(name: str, package: str, tmp_path: Path) -> None:
    """`from gepf import NAME`, in the environment of a worker: an ImportError, and one of gepf's."""
    lines = ("import gepf", "try:", f"    from gepf import {name}", "except ImportError as error:")
    code = "\n".join([*lines, "    print(isinstance(error, gepf.InputError), error)"])
    done = run_without(package, ["-c", code], tmp_path)
    remedy = "which is not installed; pip install 'gepf[coordinator]'"
    assert done.stdout == f"True gepf.{name} needs the package {package}, {remedy}\n", done.stderr


def test_a_robot_in_the_library_names_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tracker of a URDF file."""
    for module in ("gepf.coordinator.bodies.urdf", "gepf.coordinator.bodies.robot_surface"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    monkeypatch.setitem(sys.modules, "yourdfpy", None)
    with pytest.raises(gepf.InputError, match=r"pip install 'gepf\[robots\]'"):
        gepf.Tracker(str(EXAMPLES / "bracket.urdf"))
