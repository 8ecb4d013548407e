"""All that was measured, as tables for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich.console import Console
from rich.table import Table

from benchmarks.real_people.report import People, Report, Skinned
from benchmarks.scores import Accuracy, Marks, Score
from benchmarks.utd import ACTIONS

PEOPLE = ("raw", "offset_removed")
SKINNED = ("raw", "offset_removed", "visible", "hidden")


def show(result: Report, console: Console) -> None:
    """Print the tables, and in the end what went wrong."""
    if result.people:
        console.print(people_table(result.people))
        console.print(joint_table("UTD-MHAD by joint", result.people.by_joint, PEOPLE))
    if result.skinned:
        console.print(skinned_table(result.skinned))
        joints = result.skinned.by_joint
        console.print(joint_table("Skinned by joint", joints, SKINNED))
    for name, error in result.crashes.items():
        console.print(f"crashed: {name}: {error}", style="red", markup=False, highlight=False)


def people_table(people: People) -> Table:
    """A line for each action, and one for all."""
    table = score_table("UTD-MHAD against the SDK's joints", "action", PEOPLE)
    for action, scored in people.by_action.items():
        table.add_row(f"{action} {ACTIONS[action - 1]}", *score_cells(scored, PEOPLE))
    table.add_section()
    table.add_row("all", *score_cells(people.overall, PEOPLE))
    mean = people.overall.mean_of_sequences_percent
    table.caption = f"where every sequence counts the same, offset removed: {number(mean)} % within 10 cm"
    return table


def skinned_table(skinned: Skinned) -> Table:
    """A line for each sequence, and one for all."""
    table = score_table("Skinned people against the exact truth", "sequence", SKINNED)
    for one in skinned.sequences:
        lost = "" if one.lost_from_frame is None else f"from {one.lost_from_frame}"
        table.add_row(one.sequence, *mark_cells(one.joints, SKINNED), "", lost, "", number(one.ms_per_frame))
    table.add_section()
    table.add_row("all", *score_cells(skinned.overall, SKINNED))
    return table


def joint_table(title: str, joints: Mapping[str, Marks], kinds: Sequence[str]) -> Table:
    """A line for each joint."""
    table = start_table(title, "joint", kinds)
    for name, marks in joints.items():
        table.add_row(name, *mark_cells(marks, kinds))
    return table


def score_table(title: str, of: str, kinds: Sequence[str]) -> Table:
    """An empty table of scores."""
    table = start_table(title, of, kinds)
    table.add_column("worst", justify="right")
    table.add_column("lost", style="red")
    table.add_column("crashed", style="red")
    table.add_column("ms/frame", justify="right")
    return table


def start_table(title: str, of: str, kinds: Sequence[str]) -> Table:
    """An empty table with two columns for each kind of accuracy."""
    table = Table(title=title)
    table.add_column(of)
    for kind in kinds:
        table.add_column(f"{kind.replace('_', ' ')}\n<10 cm", justify="right")
        table.add_column("\ncm", justify="right")
    return table


def score_cells(scored: Score, kinds: Sequence[str]) -> list[str]:
    """Cells of a score."""
    worst = "" if scored.worst is None else f"{scored.worst} {number(scored.worst_percent)} %"
    lost, crashed = " ".join(scored.lost), " ".join(scored.crashed)
    return [*mark_cells(scored.joints, kinds), worst, lost, crashed, number(scored.ms_per_frame)]


def mark_cells(marks: Marks, kinds: Sequence[str]) -> list[str]:
    """Two cells for each kind of accuracy."""
    found: list[Accuracy | None] = [getattr(marks, kind) for kind in kinds]
    return [cell for one in found for cell in accuracy_cells(one)]


def accuracy_cells(found: Accuracy | None) -> tuple[str, str]:
    """Per cent and centimetres."""
    return ("-", "-") if found is None else (number(found.within_10cm_percent), number(found.mean_error_cm))


def number(value: float | None) -> str:
    """With one decimal."""
    return "-" if value is None else f"{value:.1f}"
