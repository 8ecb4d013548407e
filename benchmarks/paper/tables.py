"""All that was measured, as tables for people."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from benchmarks.paper.bound import Bound
from benchmarks.paper.report import Bounds, Report
from benchmarks.paper.scores import RowScore

TITLES = {
    "clean": "The arm without noise",
    "heavy": "The arm, 15 cm of noise in depth and 1 cm across",
    "letter": "The same, preset paper without joint limits and in metres: neither is in the paper",
    "moderate": "The arm, 5 cm of noise in depth and 5 mm across",
    "curves": "Error against evaluations: 15 cm and 1 cm, few points, few frames",
    "turn": "A person who turns",
    "ablation": "Each setting of preset default alone put back to that of preset paper",
}


def show(result: Report, console: Console) -> None:
    """Print the tables, and in the end what went wrong."""
    for part in dict.fromkeys(row.part for row in result.rows):
        rows = [row for row in result.rows if row.part == part]
        console.print(error_table(part, rows))
        if part == "clean":
            console.print(angle_table(rows))
        if part == "turn":
            console.print(limb_table(rows))
    if result.bounds is not None:
        console.print(bound_table(result.bounds))
    for name, error in result.crashes.items():
        console.print(f"crashed: {name}: {error}", style="red", markup=False, highlight=False)


def error_table(part: str, rows: Sequence[RowScore]) -> Table:
    """A line for each row."""
    table = Table(title=TITLES.get(part, part), caption=f"errors from frame {rows[0].from_frame} on")
    columns = (
        "row",
        "seeds",
        "frames",
        "reported deg",
        "best deg",
        "within 10 deg",
        "lost",
        "evaluations",
        "ms/frame",
    )
    for k, column in enumerate(columns):
        table.add_column(column, justify="right" if k else "left")
    for row in rows:
        table.add_row(
            row.name,
            str(len(row.runs)),
            str(row.frames),
            f"{row.reported_deg:.2f}",
            f"{row.best_deg:.2f}",
            f"{row.within_10_deg_percent:.0f} %",
            f"{row.lost} of {len(row.runs)}",
            str(row.evaluations),
            f"{row.ms_per_frame:.0f}",
        )
    return table


def angle_table(rows: Sequence[RowScore]) -> Table:
    """The reported pose's error of each angle."""
    table = Table(title="Reported pose by angle, degrees")
    table.add_column("row")
    for angle in rows[0].reported_deg_by_angle:
        table.add_column(angle, justify="right")
    for row in rows:
        table.add_row(row.name, *(f"{error:.2f}" for error in row.reported_deg_by_angle.values()))
    return table


def limb_table(rows: Sequence[RowScore]) -> Table:
    """Joint errors of what is seen and of what is not."""
    table = Table(title="Mean joint error of the reported pose, centimetres")
    for column in ("row", "all", "visible", "hidden", "lost a limb"):
        table.add_column(column, justify="left" if column == "row" else "right")
    for row in rows:
        if row.joints is not None:
            limbs = (row.joints.all_cm, row.joints.visible_cm, row.joints.hidden_cm)
            lost = f"{row.limb_lost} of {len(row.runs)}"
            table.add_row(row.name, *(f"{error:.1f}" for error in limbs), lost)
    return table


def bound_table(bounds: Bounds) -> Table:
    """What the data allow."""
    table = Table(title="Least mean absolute error that the noisy frames allow, degrees")
    table.add_column("known")
    for angle in (*bounds.filtered.by_angle_deg, "mean"):
        table.add_column(angle, justify="right")
    for bound in bounds.single_frame:
        pixels = "all pixels" if bound.points is None else f"{bound.points} points"
        table.add_row(f"one frame, {pixels}", *cells(bound))
    table.add_row(f"all frames so far, {bounds.filtered.points} points", *cells(bounds.filtered))
    table.add_row(f"all frames, {bounds.smoothed.points} points", *cells(bounds.smoothed))
    return table


def cells(bound: Bound) -> list[str]:
    """One for each angle, and the mean."""
    return [f"{error:.2f}" for error in (*bound.by_angle_deg.values(), bound.mean_deg)]
