"""Documents are true: links and names exist, and printed commands work."""

from __future__ import annotations

import ast
import importlib.util
import itertools
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.main import get_command

from gepf.coordinator.cli import app
from gepf.worker.cli import work
from tests.support.processes.certificates import free_port
from tests.support.processes.programs import wait_until

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
DOCUMENTS = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").glob("*.md"))]
USED = [document for document in DOCUMENTS if document.name != "CHANGELOG.md"]  # which is of the past, too
ARCHITECTURE = ROOT / "docs" / "architecture.md"
worker = typer.Typer()
worker.command()(work)
PROGRAMS = {"gepf": get_command(app), "gepf-worker": get_command(worker)}
PLACEHOLDERS = {"MS": "1", "SECONDS": "1", "FPS": "1"}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
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
    shown = [text for document in USED for text in (*fenced(document), *inline(document))]
    return sorted({text for text in shown if text.split()[0] == program and "COMMAND" not in text})


def understand(line: str) -> None:
    """Parse a command line as its program does; arguments may be missing."""
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


def options_of(command: Any) -> Iterator[str]:
    """The options of a command and of those in it."""
    yield from itertools.chain.from_iterable(each.opts + each.secondary_opts for each in command.params)
    for inner in getattr(command, "commands", {}).values():
        yield from options_of(inner)


def test_every_printed_option_is_one() -> None:
    """Options that the README names by themselves are those of our programs."""
    known = {option for program in PROGRAMS.values() for option in options_of(program)}
    assert {text.split()[0] for text in inline(README) if text.startswith("--")} <= known


def test_every_printed_make_target_and_benchmark_is_there() -> None:
    """`make demo`, `python -m benchmarks.people` and all others, without doing them."""
    shown = " ".join(text for document in USED for text in (*fenced(document), *inline(document)))
    targets = set(re.findall(r"\bmake ([a-z][a-z-]*)", shown))
    assert {"demo", "test"} <= targets
    done = subprocess.run(["make", "-n", *targets], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    modules = set(re.findall(r"python -m (benchmarks[\w.]+)", " ".join(d.read_text() for d in USED)))
    assert "benchmarks.people" in modules
    assert not [name for name in modules if importlib.util.find_spec(name) is None]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda document: document.name)
def test_every_link_leads_somewhere(document: Path) -> None:
    """Files and pictures are there, and headings in them."""
    for target, anchor in re.findall(r"\]\((?!http)([^)#]*)#?([^)]*)\)", document.read_text()):
        file = (document.parent / target) if target else document
        assert file.exists(), target
        if anchor:
            titles = re.findall(r"^#+ (.+)$", file.read_text(), re.MULTILINE)
            anchors = [re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles]
            assert anchor in anchors, f"{target}#{anchor}"


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda document: document.name)
def test_lists_and_tables_are_whole(document: Path) -> None:
    """A table row is one line, and no item of a list is inside another one, as after a wrong wrap."""
    lines = FENCED.sub("", document.read_text()).splitlines()
    assert not [line for line in lines if line.startswith("|") != line.endswith("|")]
    assert not [line for line in lines if re.search(r"[.!?] (-|\d\.) [A-Z]", line)]


def named() -> list[tuple[str, str]]:
    """Files of the code that documents name, each with the functions that stand after it, or with none."""
    names = r"(?:,? ?(?:and )?\s?`[A-Za-z_]\w*(?:\.\w+)?`)*"
    found = set()
    for document in USED:
        for path, after in re.findall(rf"`(\w[\w/]*/\w+\.py)`({names})", document.read_text()):
            found |= {(path, name) for name in ("", *re.findall(r"`([\w.]+)`", after))}
    return sorted(found)


@pytest.mark.parametrize(("path", "name"), named())
def test_every_named_file_and_function_is_there(path: str, name: str) -> None:
    """Functions, classes and methods (with their class) are defined in the file that they stand after."""
    nodes = ast.parse((ROOT / path).read_text()).body
    for part in name.split(".") if name else ():
        found = [n for n in nodes if isinstance(n, ast.FunctionDef | ast.ClassDef) and n.name == part]
        assert found, f"{path} has no {name}"
        nodes = found[0].body


def test_the_tree_has_every_package_and_no_other() -> None:
    """docs/architecture.md lists exactly the existing packages."""
    (tree,) = re.findall(r"```text\n(.*?)```", ARCHITECTURE.read_text(), re.DOTALL)
    listed, parent = set(), ""
    for line in tree.splitlines():
        name = line.split()[0].rstrip("/")
        parent = parent if line.startswith(" ") else name
        listed.add(f"{parent}/{name}" if line.startswith(" ") else name)
    packages = ("common", "coordinator", "gepf", "worker")
    inner = [init.parent for name in packages for init in (ROOT / name).glob("*/__init__.py")]
    inner = [folder for folder in inner if not folder.is_symlink()]
    actual = {*packages, *(str(folder.relative_to(ROOT)) for folder in inner)}
    assert {name for name in listed if name.partition("/")[0] in packages} == actual
    assert all((ROOT / name).is_dir() for name in listed)


def test_every_dependency_is_explained() -> None:
    """CONTRIBUTING has a line for each package that pyproject.toml names."""
    asked = [*PROJECT["dependencies"], *itertools.chain(*PROJECT["optional-dependencies"].values())]
    text = (ROOT / "CONTRIBUTING.md").read_text()
    names = {re.split(r"[^\w-]", requirement)[0] for requirement in asked} - {"gepf"}  # whose extras they are
    assert not [name for name in sorted(names) if name not in text]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where a user types: a recording of three frames with its truth."""
    folder = tmp_path_factory.mktemp("user")
    type_in(folder, "gepf synth arm --frames 3 --out recording")
    shutil.copy(folder / "recording" / "truth.npz", folder / "truth.npz")
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
    port = str(free_port())
    left = [line for line in fenced(README) if not line.startswith("make ")]
    left = [line.replace("COORDINATOR", "127.0.0.1").replace("7447", port) for line in left]
    assert len(left) > 8
    while left:
        line = left.pop(0)
        if "--listen" in line:  # the next line is printed to run beside it
            with running(folder, left.pop(0), ends="zenoh:" in line):
                type_in(folder, line)
        elif line.startswith("gepf view"):
            with running(folder, line):
                wait_until(lambda: answers(9090), PATIENCE)
        else:
            type_in(folder, line)
    assert {"run", "shared", "live", "walk.bvh"} <= {path.name for path in folder.iterdir()}


@contextmanager
def running(folder: Path, line: str, *, ends: bool = False) -> Iterator[None]:
    """A command that ends by Ctrl-C, or by itself."""
    with subprocess.Popen(
        shlex.split(line), cwd=folder, env=environment(), stderr=subprocess.DEVNULL
    ) as process:
        yield
        if not ends:
            assert process.poll() is None, f"{line} ended by itself"
            process.send_signal(signal.SIGINT)


def answers(port: int) -> bool:
    """Whether something answers at a port of this host."""
    with socket.socket() as link:
        return link.connect_ex(("127.0.0.1", port)) == 0


MODULES = {"eclipse-zenoh": "zenoh"}  # package -> what is imported, where that differs


def imported(file: Path) -> Iterator[str]:
    """The packages that a module imports, wherever it does so."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            yield node.module.partition(".")[0]


def test_the_base_install_is_what_a_worker_imports() -> None:
    """Exactly the packages that a worker needs."""
    declared = {re.split(r"[^\w-]", requirement)[0] for requirement in PROJECT["dependencies"]}
    files = [file for room in ("common", "worker") for file in (ROOT / room).rglob("*.py")]
    foreign = {name for file in files for name in imported(file)} - set(sys.stdlib_module_names)
    assert foreign - {"gepf"} == {MODULES.get(name, name) for name in declared}
