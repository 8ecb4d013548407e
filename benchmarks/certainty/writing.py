"""The fitted functions as a file of the coordinator's."""

from __future__ import annotations

from pathlib import Path

from coordinator.tracking.certainty.assessment import Functions
from coordinator.tracking.certainty.evidence import CLUES

FILE = Path("coordinator") / "tracking" / "certainty" / "fitted.py"

HEAD = '''"""What each clue is worth, as `python -m benchmarks.certainty --fit` found it and wrote it here.

Fitted to preset default: eight hard actions of UTD-MHAD's subjects 1 and 2, where the depth does not
contradict the reference, and rendered people with exact truth (skinned, three_cameras, rooms), at 30, 15 and
10 frames a second: the odds half-way between those of before and those of the fit, the deviation's weights as
they were.
"""

from __future__ import annotations

'''


def write_functions(functions: Functions, file: Path) -> None:
    """Write the constants that the tracker goes by."""
    columns = (functions.low, functions.high, functions.probability[1], functions.deviation[1])
    rows = [
        f'    "{clue}": ({", ".join(f"{value:.4g}" for value in values)}),\n'
        for clue, *values in zip(CLUES, *columns, strict=True)
    ]
    file.write_text(
        f"{HEAD}PROBABILITY = {functions.probability[0]:.4g}  # intercept of the log odds of being off\n"
        f"DEVIATION = {functions.deviation[0]:.4g}  # and of the logarithm of its deviation in metres\n"
        f"UNSEEN = {functions.unseen:.2f}  # added to it where less than half of a joint is shown\n\n"
        "FITTED: dict[str, tuple[float, float, float, float]] = {\n"
        f"{''.join(rows)}}}\n"
        '"""Of each clue the least and the most, and its weight in the one and in the other."""\n'
    )
