"""Workers do without scipy, which the base install does not bring."""

from __future__ import annotations

import ast
from pathlib import Path

from tests.support.processes.programs import CACHE, fresh_python

ROOT = Path(__file__).parents[2]
CODE = """
import importlib, pkgutil, sys
sys.modules["scipy"] = None  # so that its import fails
import gepf.common, gepf.worker
for package in (gepf.common, gepf.worker):
    for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        importlib.import_module(module.name)
print("imported")
"""


def test_all_of_a_worker_is_imported_without_scipy(tmp_path: Path) -> None:
    """In a process where scipy cannot be imported."""
    done = fresh_python(ROOT, CODE, **{CACHE: str(tmp_path)})
    assert done.stdout == "imported\n", done.stderr


def test_no_kernel_needs_the_linear_algebra_of_scipy() -> None:
    """In compiled code numba takes matrix products and np.linalg from scipy."""
    needing = []
    for file in [*(ROOT / "worker" / "kernel").rglob("*.py"), *(ROOT / "common").rglob("*.py")]:
        for function in ast.walk(ast.parse(file.read_text())):
            if isinstance(function, ast.FunctionDef) and "njit" in map(name_of, function.decorator_list):
                names = {node.attr for node in ast.walk(function) if isinstance(node, ast.Attribute)}
                products = any(isinstance(node, ast.MatMult) for node in ast.walk(function))
                if products or names & {"linalg", "dot", "vdot", "matmul"}:
                    needing.append(f"{file.name}: {function.name}")
    assert not needing


def name_of(decorator: ast.expr) -> str:
    """The last part of a decorator's name."""
    called = decorator.func if isinstance(decorator, ast.Call) else decorator
    return called.attr if isinstance(called, ast.Attribute) else ""
