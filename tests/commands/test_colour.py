"""`gepf track` of recordings with colour: what is used, what is said, and that depth alone stays the same."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import gepf
from gepf.common.frame import SubjectFrame
from gepf.coordinator.cli import main
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from gepf.coordinator.results.track import read_track
from tests.support.coloured import write_coloured
from tests.support.people import STANDING
from tests.support.stand_ins import Direct

pytest.importorskip("ai_edge_litert", reason="the extra color is not installed")

OPTIONS = ("--points", "500", "--particles", "4", "--no-pictures")
BYTES = "track.npz"
Run = Callable[..., tuple[bytes, str]]


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A person in colour, with the start pose."""
    folder = write_coloured(tmp_path / "walk")
    (folder / "init.json").write_text(json.dumps(STANDING))
    return folder


@pytest.fixture
def run(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> Run:
    """Track a recording in this process: the bytes of the track, and what was said."""

    def track(*options: str, of: Path = recording, by: object = None) -> tuple[bytes, str]:
        out = tmp_path / "run"
        shutil.rmtree(out, ignore_errors=True)
        connect = Direct().connect if by is None else by
        assert main(["track", str(of), "--out", str(out), *OPTIONS, *options], connect) == 0  # type: ignore[arg-type]
        said = "\n".join([capsys.readouterr().err, *caplog.messages])
        caplog.clear()
        return (out / BYTES).read_bytes(), said

    return track


def test_colour_beside_depth_is_used(run: Run, recording: Path, tmp_path: Path) -> None:
    """As that of `--color DIR`; `--no-color` has the bytes of a recording without colour. That is said."""
    coloured, said = run()
    assert "with depth and colour" in said
    assert (read_track(tmp_path / "run").keypoint is not None) == ("with depth and colour" in said)
    alone, said = run("--no-color")
    assert "with depth alone" in said
    assert coloured != alone
    (recording / "color").rename(recording / "pictures")
    assert run()[0] == alone
    assert run("--color", str(recording / "pictures"))[0] == coloured
    assert gepf.track(recording, color=False, quiet=True).track.keypoint is None
    assert gepf.track(recording, color=recording / "pictures", quiet=True).track.keypoint is not None


def shifted(folder: Path) -> None:
    """Colour of half of the depth's width."""
    for file in folder.iterdir():
        with Image.open(file) as image:
            image.crop((80, 0, 240, 240)).save(file)


def test_colour_that_cannot_be_used_is_said(
    run: Run, recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In one line: another shape than depth, missing images, or a missing package. Results are depth's."""
    alone, _ = run("--no-color")
    with monkeypatch.context() as without:
        without.setitem(sys.modules, "ai_edge_litert", None)
        found, said = run()
        (line,) = (each for each in said.splitlines() if "pip install" in each)
        assert found == alone
        assert line.startswith("colour, which corrects many limbs and swapped sides, is not used")
        assert line.endswith("pip install 'gepf[color]'; or give --no-color")
        assert "pip install" not in run("--no-color")[1]
    (recording / "color" / "000001.png").unlink()
    assert "some frames have no colour image; they are tracked by depth alone" in run()[1]
    shifted(recording / "color")
    found, said = run()
    assert found == alone
    assert (
        "colour is not used: none of the examined colour images has the shape of the depth images; " in said
    )


class Killed(Direct):
    """Is interrupted at the third frame."""

    def publish(self, subject: SubjectFrame) -> None:
        """As if the user had pressed Ctrl-C."""
        if subject.number == 2:
            raise KeyboardInterrupt


def test_the_bytes_do_not_depend_on_workers_and_interruptions(
    run: Run, recording: Path, tmp_path: Path
) -> None:
    """In this process, with two lanes of a worker, and resumed. A resumed run needs the same colour."""
    alone, _ = run()
    assert run("--workers", "2", by=ZenohRefiner)[0] == alone
    track = partial(main, ["track", str(recording), "--out", str(tmp_path / "cut"), *OPTIONS])
    assert track(Killed().connect) == 130
    again = ["track", str(recording), "--out", str(tmp_path / "cut"), *OPTIONS, "--resume"]
    assert main([*again, "--no-color"], Direct().connect) == 2
    assert main(again, Direct().connect) == 0
    assert (tmp_path / "cut" / BYTES).read_bytes() == alone
    assert np.isfinite(read_track(tmp_path / "cut").pose).all()
