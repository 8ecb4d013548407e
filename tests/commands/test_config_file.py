"""`gepf.toml`: options of any command from a file."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.main import get_command

from gepf.coordinator.cli import app, main
from gepf.coordinator.cli.application import defaults_of


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


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


def test_the_working_folder_s_file_is_read_and_the_command_line_wins(folder: Path) -> None:
    """A required option may come from the file; the command line overrides the file."""
    (folder / "gepf.toml").write_text('[synth]\nframes = 2\nout = "from-file"\n')
    assert main(["synth", "arm"]) == 0
    assert len(list((folder / "from-file" / "depth").iterdir())) == 2
    assert main(["synth", "arm", "--frames", "1", "--out", "from-line"]) == 0
    assert len(list((folder / "from-line" / "depth").iterdir())) == 1


def test_config_names_another_file(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It is read in place of gepf.toml; a fault in it is exit code 2 and one line."""
    (folder / "gepf.toml").write_text("[nonsense]\n")
    (folder / "other.toml").write_text('[synth]\nframes = "two"\n')
    assert main(["--config", "other.toml", "synth", "arm", "--out", "x"]) == 2
    assert "Invalid value for '--frames': 'two' should be a valid integer: " in capsys.readouterr().err
    assert main(["--config", "no.toml", "info", "nowhere"]) == 2
    assert "cannot read no.toml: No such file or directory; give another --config" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[track\n", " is not valid TOML: "),
        ("[track]\nparticels = 4", ": [track]: there is no option 'particels'; did you mean particles?"),
        ("[report]\nrun = 'x'", ": [report]: there is no option 'run'; there are out, quiet"),
        ("[trak]", ": there is no command 'trak'; did you mean track?"),
        ("track = 4", ": there is no command 'track'; "),
        ("[model.dofs]\nsize = 4", ": [model]: [dofs]: there is no option 'size'; there are none"),
    ],
)
def test_what_no_command_understands_is_one_line(
    folder: Path, capsys: pytest.CaptureFixture[str], text: str, says: str
) -> None:
    """For any command; a line on an unknown name has the nearest name or all names."""
    (folder / "gepf.toml").write_text(text)
    assert main(["info", "nowhere"]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"gepf: gepf.toml{says}")
    assert err.count("\n") == 1


def test_a_folder_does_not_switch_encryption_off(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`insecure` in the working folder's file is refused in one line; one that --config names may set it."""
    (folder / "gepf.toml").write_text("[publish]\ninsecure = true\n")
    publish = ["publish", "nowhere", "--key", "k", "--connect", "tcp/10.0.0.5:7447"]
    assert main(publish) == 2
    err = capsys.readouterr().err
    assert err.startswith(
        "gepf: gepf.toml: [publish]: insecure is for the command line (--insecure), or for a"
    )
    assert err.count("\n") == 1
    (folder / "gepf.toml").rename(folder / "ours.toml")
    assert main(["--config", "ours.toml", *publish]) == 2
    assert "no such file or folder: nowhere" in capsys.readouterr().err
    (folder / "gepf.toml").write_text("[publish]\ninsecure = false\n")
    assert main(publish) == 2
    assert "is not encrypted" in capsys.readouterr().err
