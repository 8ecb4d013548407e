"""What README and docs print can be typed: every command is known, and those of the README run as printed."""

from __future__ import annotations

import itertools
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import typer
from typer.main import get_command

from coordinator.cli import app
from worker.cli import work

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
DOCUMENTS = [README, *sorted((ROOT / "docs").glob("*.md"))]
worker = typer.Typer()
worker.command()(work)
PROGRAMS = {"gepf": get_command(app), "gepf-worker": get_command(worker)}
PLACEHOLDERS = {"MS": "1", "SECONDS": "1", "FPS": "1"}
PATIENCE = 900  # seconds for a command on a busy machine, kernels compiled included

FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"`([^`\n]+)`")


def fenced(document: Path) -> list[str]:
    """Command lines of the blocks of code that are in no other language, without comments."""
    blocks = [text for language, text in FENCED.findall(document.read_text()) if not language]
    lines = "".join(blocks).replace("\\\n", " ").splitlines()
    return [shlex.join(words) for line in lines if (words := shlex.split(line, comments=True))]


def inline(document: Path) -> list[str]:
    """Code within the text."""
    return CODE.findall(FENCED.sub("", document.read_text()))


def printed(program: str) -> list[str]:
    """Every command line of a program in all documents."""
    shown = [text for document in DOCUMENTS for text in (*fenced(document), *inline(document))]
    return sorted({text for text in shown if text.split()[0] == program and "COMMAND" not in text})


def understand(line: str) -> None:
    """Parse a command line as its program does; what is said of a command need not name all that it needs."""
    program, *words = (PLACEHOLDERS.get(word.strip("[]"), word.strip("[]")) for word in shlex.split(line))
    command = PROGRAMS[program]
    while words and hasattr(command, "commands") and not words[0].startswith("-"):
        command = command.commands[words.pop(0)]
    if words and (not words[0].startswith("-") or not hasattr(command, "commands")):
        try:
            command.make_context(program, words).close()
        except typer.TyperException as error:
            assert "Missing parameter" in str(error)  # noqa: PT017 all else is a fault of the document
    else:
        known = {
            option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)
        }
        assert set(words[:1]) <= known


@pytest.mark.parametrize("line", [*printed("gepf"), *printed("gepf-worker")])
def test_every_printed_command_is_understood(line: str) -> None:
    """Commands, options and what they need, in README and docs."""
    understand(line)


@pytest.mark.parametrize("option", sorted({text for text in inline(README) if text.startswith("--")}))
def test_every_printed_option_is_one(option: str) -> None:
    """Options that the README names by themselves are of the commands that it names them for."""
    words = [PLACEHOLDERS.get(word, word) for word in shlex.split(option)]
    for program, start in (("gepf", "track SEQ --out DIR"), ("gepf-worker", "--connect tcp/a:1")):
        whole = f"{program} {start} {shlex.join(words)}"
        try:
            understand(whole if len(words) > 1 else f"{whole} 1" if needs_value(words[0]) else whole)
        except Exception:  # noqa: BLE001 a worker's own option is one, too
            continue
        return
    pytest.fail(f"{option} is no option of gepf track")


def needs_value(option: str) -> bool:
    """Whether an option of gepf track is followed by a value."""
    parameters = PROGRAMS["gepf"].commands["track"].params  # type: ignore[attr-defined]
    (found,) = [p for p in parameters if option in (*p.opts, *p.secondary_opts)]
    return not getattr(found, "is_flag", False)


def test_every_printed_make_target_is_there() -> None:
    """`make demo` and all others, without doing them."""
    shown = [text for document in DOCUMENTS for text in (*fenced(document), *inline(document))]
    targets = {text.split()[-1] for text in shown if re.match(r"(\w+=\S+ )*make ", text)}
    assert {"demo", "test"} <= targets
    for target in sorted(targets):
        done = subprocess.run(["make", "-n", target], cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr


def test_every_link_leads_somewhere() -> None:
    """Files and pictures that documents link to are there."""
    links = [
        (document, target)
        for document in DOCUMENTS
        for target in re.findall(r"\]\((?!http)([^)#]+)", document.read_text())
    ]
    assert len(links) > 10
    assert [f"{document.name}: {to}" for document, to in links if not (document.parent / to).exists()] == []


def test_every_dependency_is_explained() -> None:
    """CONTRIBUTING has a line for each package that pyproject.toml names."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    asked = [*project["dependencies"], *itertools.chain(*project["optional-dependencies"].values())]
    text = (ROOT / "CONTRIBUTING.md").read_text()
    names = {re.split(r"[^\w-]", requirement)[0] for requirement in asked}
    assert not [name for name in sorted(names) if name not in text]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where a user types: a recording of three frames, its truth, and a robot."""
    folder = tmp_path_factory.mktemp("user")
    type_in(folder, "gepf synth arm --frames 3 --out recording")
    shutil.copy(folder / "recording" / "truth.npz", folder / "truth.npz")
    shutil.copy(ROOT / "examples" / "arm7.urdf", folder / "robot.urdf")
    shutil.copytree(ROOT / "examples", folder / "examples")
    return folder


def environment() -> dict[str, str]:
    """With gepf on the path, as an activated environment has it, and a browser that shows nothing."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    return {**os.environ, "PATH": path, "BROWSER": "true"}


def type_in(folder: Path, line: str) -> None:
    """Run a command line in a shell."""
    done = subprocess.run(
        line,
        shell=True,
        cwd=folder,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"


@pytest.mark.slow
def test_the_readme_runs_as_printed(folder: Path) -> None:
    """One command after the other in one folder; only names of hosts and ports are filled in."""
    left = [line for line in fenced(README) if not line.startswith("make ")]
    port = str(free_port())
    left = [line.replace("COORDINATOR", "127.0.0.1").replace("7447", port) for line in left]
    assert len(left) > 10
    for line in sorted(left, key=lambda line: line.startswith("gepf view")):
        if line.startswith("gepf-worker "):
            continue  # runs beside the coordinator that is printed with it
        if "--listen" in line:
            (beside,) = [other for other in left if other.startswith("gepf-worker ")]
            with running(folder, beside):
                type_in(folder, line)
        elif line.startswith("gepf view"):
            with running(folder, line):
                wait_for(9090)
        else:
            type_in(folder, line)
    made = {path.name for path in folder.iterdir()}
    assert {"run", "shared", "walk.bvh", "person.json", "robot.png", "sequence", "roaming"} <= made


@contextmanager
def running(folder: Path, line: str) -> Iterator[None]:
    """A command that ends by Ctrl-C."""
    with subprocess.Popen(
        shlex.split(line), cwd=folder, env=environment(), stderr=subprocess.DEVNULL
    ) as process:
        yield
        assert process.poll() is None, f"{line} ended by itself"
        process.send_signal(signal.SIGINT)


def wait_for(port: int) -> None:
    """Until something answers at a port of this host."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        with socket.socket() as link:
            if link.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.2)
    pytest.fail(f"nothing answers at port {port}")


def free_port() -> int:
    """One that nobody uses."""
    with socket.socket() as link:
        link.bind(("127.0.0.1", 0))
        port: int = link.getsockname()[1]
        return port
