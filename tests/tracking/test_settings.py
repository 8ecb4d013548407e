"""Settings are checked, documented with their origin, and decide."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
import pytest

from gepf.common.errors import InputError
from gepf.coordinator.filters.methods import apply_method
from gepf.coordinator.scene.scene import Scene
from gepf.coordinator.settings import PRESETS, SceneSettings, Settings, preset
from tests.support.rooms import CABINET, Room
from tests.support.settings_table import PAGE, settings_of, with_tables


def changed(settings: Any, name: str, value: object) -> Any:
    """The settings with one value, by its dotted name, replaced."""
    first, _, rest = name.partition(".")
    inner = changed(getattr(settings, first), rest, value) if rest else value
    return msgspec.structs.replace(settings, **{first: inner})


def test_the_page_lists_all_settings() -> None:
    """As their structs have them: `python -m tests.support.settings_table` writes it."""
    page = PAGE.read_text()
    assert with_tables(page) == page


def test_every_number_has_an_origin() -> None:
    """A setting says what it means, or where it was measured."""
    unexplained = [
        setting.name
        for setting in settings_of(preset("default"))
        if isinstance(setting.value, int | float) and not setting.origin
    ]
    assert unexplained == []


@pytest.mark.parametrize("name", PRESETS)
def test_presets_are_valid_and_survive_storage(name: str) -> None:
    """As JSON, as `summary.json` has them, they are the same settings."""
    stored = msgspec.json.encode(apply_method(PRESETS[name]))
    assert msgspec.json.decode(stored, type=Settings) == apply_method(PRESETS[name])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("scene.planes.min_floor_width_m", -0.2),
        ("scene.settled_s", 0.0),
        ("gating.max_misfit_m", math.nan),
        ("track.patience_s", math.inf),
        ("certainty.flagged_probability", 1.5),
        ("filter.exploration.draws", 2.5),
    ],
)
def test_a_value_out_of_range_is_named(name: str, value: object) -> None:
    """Before anything is tracked with it."""
    with pytest.raises(InputError, match=name):
        apply_method(changed(preset("default"), name, value))


def test_the_scene_obeys_its_settings() -> None:
    """A cabinet that appears is background after as many frames as they say, in each scene by its own."""
    quick = changed(SceneSettings(), "settled_s", 0.1)
    scenes, empty, furnished = (Scene(quick), Scene(SceneSettings())), Room(), Room((CABINET,))
    left = []
    for scene in scenes:
        for number in range(8):
            view = scene.observe((furnished if number > 1 else empty).see(None, number).view)
            scene.learn(view)
        last = furnished.see(None, 8).view
        appeared = np.abs(last.metres() - empty.see(None, 8).view.metres()) > 0.1
        left.append(int(np.count_nonzero((scene.observe(last).background < last.metres() + 0.1)[appeared])))
    assert left[0] == np.count_nonzero(appeared)
    assert left[1] == 0
