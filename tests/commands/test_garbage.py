"""What a run has loaded is not looked through again and again."""

from __future__ import annotations

import gc

from coordinator.commands.garbage import LOADING, leave_loaded_alone


def test_what_is_there_after_the_first_steps_stays_out_of_collections() -> None:
    """What is made by them too; what comes later does not; and a run goes on as it was."""
    made, frozen = list[list[object]](), list[bool]()
    for step in leave_loaded_alone(range(LOADING + 2)):
        gc.collect()
        frozen.append(all(each is not thing for each in gc.get_objects() for thing in made[-1:]))
        made.append([step])
    assert [each[0] for each in made] == list(range(LOADING + 2))
    assert frozen == [True] * LOADING + [False] * 2
    assert gc.get_freeze_count() == 0
