"""Notebooks: the example is executed, and runs and estimates show themselves."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import nbclient
import nbformat
import numpy as np
import pytest

import gepf
from tests.support.small_sequence import write_small_sequence

EXAMPLE = Path(__file__).parents[2] / "examples" / "notebook.ipynb"


def test_the_example_runs_and_shows_its_results(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run and an estimate, a table of numbers, and a figure."""
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")  # it calls gepf
    notebook = nbformat.read(EXAMPLE, 4)  # type: ignore[no-untyped-call]
    nbclient.NotebookClient(notebook, timeout=500).execute()
    shown = [o["data"] for cell in notebook.cells for o in cell.get("outputs", []) if "data" in o]
    pages = [data["text/html"] for data in shown if "text/html" in data]
    assert any("20 in 0.8 s" in page for page in pages)
    assert "right_elbow_flexion" in pages[-1]
    assert " -0" not in pages[-1]
    assert any("right_wrist_z" in page for page in pages)
    assert sum("image/png" in data for data in shown) == 1


def test_one_line_tracks_a_recording(tmp_path: Path) -> None:
    """Into the given folder, which is new; the run shows itself. A damaged frame leaves those before it."""
    write_small_sequence(tmp_path / "arm", 3)
    run = gepf.track(tmp_path / "arm", tmp_path / "run", quiet=True, workers=None)
    assert np.array_equal(gepf.load(tmp_path / "run").track.pose, run.track.pose)
    start = gepf.open_source(tmp_path / "arm").init
    assert start is not None
    with pytest.raises(gepf.InputError, match="already exists and is not empty"):
        gepf.track(tmp_path / "arm", tmp_path / "run", quiet=True)
    assert "3 in" in run._repr_html_()
    (tmp_path / "arm" / "depth" / "000002.png").write_text("x")
    with pytest.raises(gepf.InputError, match="damaged"):
        gepf.track(tmp_path / "arm", tmp_path / "cut", quiet=True, workers=None)
    assert np.array_equal(gepf.load(tmp_path / "cut").track.pose, run.track.pose[:2])
