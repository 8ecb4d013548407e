"""`gepf.toml`: options of any command from a file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from typer.main import get_command

from common.errors import InputError
from coordinator.cli import app, main
from coordinator.cli.config_file import defaults_of

Written = Callable[[str], Path]


@pytest.fixture
def written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Written:
    """Write gepf.toml into the working folder."""
    monkeypatch.chdir(tmp_path)

    def write(text: str) -> Path:
        (tmp_path / "gepf.toml").write_text(text)
        return tmp_path

    return write


def test_every_option_of_every_command_can_be_configured() -> None:
    """Names as on the command line, in the types that the options have, nested as the commands are."""
    table = {
        "track": {"particles": 40, "worker-timeout": 3, "noise_depth": 0.1, "resume": True, "out": "run"},
        "view": {"browser": False},
        "info": {"json": True},
        "export": {"to": "bvh"},
        "model": {"dofs": {}},
    }
    assert defaults_of(get_command(app), table, "") == {
        "track": {"particles": 40, "worker_timeout": 3, "noise_depth": 0.1, "resume": True, "out": "run"},
        "view": {"browser": False},
        "info": {"as_json": True},
        "export": {"form": "bvh"},
        "model": {"dofs": {}},
    }


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ({"track": {"particels": 4}}, "[track]: there is no option 'particels'; did you mean particles?"),
        ({"track": {"sequence": "x"}}, "[track]: there is no option 'sequence'; "),
        ({"trak": {}}, "there is no command 'trak'; did you mean track?"),
        ({"track": 4}, "there is no command 'track'; "),
        ({"model": {"dofs": {"size": 4}}}, "[model]: [dofs]: there is no option 'size'; there are "),
    ],
)
def test_what_no_command_understands_is_refused(table: dict[str, object], says: str) -> None:
    """An unknown name; the line has the nearest name or all names."""
    with pytest.raises(InputError) as caught:
        defaults_of(get_command(app), table, "gepf.toml")
    assert str(caught.value).startswith("gepf.toml: " + says)


def test_the_working_folder_s_file_is_read_and_the_command_line_wins(
    written: Written, capsys: pytest.CaptureFixture[str]
) -> None:
    """A required option may come from the file; the command line overrides the file."""
    folder = written('[synth]\nframes = 2\nout = "from-file"\n')
    assert main(["synth", "arm"]) == 0
    assert len(list((folder / "from-file" / "depth").iterdir())) == 2
    assert main(["synth", "arm", "--frames", "1", "--out", "from-line"]) == 0
    assert len(list((folder / "from-line" / "depth").iterdir())) == 1
    assert capsys.readouterr().out == ""


def test_config_names_another_file(written: Written, capsys: pytest.CaptureFixture[str]) -> None:
    """It is read in place of gepf.toml; a fault in it is exit code 2 and one line."""
    folder = written("[nonsense]\n")
    (folder / "other.toml").write_text('[synth]\nframes = "two"\n')
    assert main(["--config", "other.toml", "synth", "arm", "--out", "x"]) == 2
    assert "Invalid value for '--frames': Input should be a valid integer" in capsys.readouterr().err
    assert main(["--config", "no.toml", "info", "nowhere"]) == 2
    assert "cannot read no.toml: No such file or directory; give another --config" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "says"),
    [("[track\n", "gepf.toml is not valid TOML: "), ("[trak]\n", "gepf.toml: there is no command")],
)
def test_a_damaged_file_is_one_line(
    written: Written, capsys: pytest.CaptureFixture[str], text: str, says: str
) -> None:
    """For any command."""
    written(text)
    assert main(["info", "nowhere"]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"gepf: {says}")
    assert err.count("\n") == 1
