"""The tracker's stated uncertainty compared with its errors: python -m benchmarks.certainty.

The hard actions of UTD-MHAD at 19, 9.5 and 6.3 frames a second, where depth agrees with the reference. The
table shows how many joints lie within one and two deviations, and how many of the joints off by more than
15 cm are flagged, over the share of false alarms.

With --fit, the functions are fitted first and printed as CertaintyFit of coordinator/settings.py.
The data are subjects 1 and 2 (also tracked with --method gradient, and in images that end at the knees),
rendered people tracked with --method gradient, rendered people with fast arms who are seen from the front and
from behind, skinned people, alone and in rooms, and every second clothed person. To measure how often one
particle detects a lost limb: --demo 12 --set method=gradient.

Progress on stderr, a table on stdout, numbers in a JSON file. Exit code 1 if a recording crashed.
"""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec

from benchmarks.certainty.fitting import fit
from benchmarks.certainty.gather import (
    Gathered,
    find_clothed,
    find_hard,
    find_rendered,
    gather,
    render_gestures,
    render_people,
)
from benchmarks.certainty.scores import Score, score, score_table
from benchmarks.recordings import Recording
from benchmarks.running import (
    Crash,
    add_changes,
    add_data,
    add_processes,
    command_line,
    keep,
    measured,
    progress,
    run_forked,
    screen,
    settings_with,
)
from benchmarks.tracking import prepare
from gepf.common.errors import InputError
from gepf.coordinator.bodies.family import Bodies
from gepf.coordinator.settings import CertaintyFit

EVERY = [1, 2, 3]  # n-th frame
FIT_SUBJECTS = (1, 2)
KINDS = PEOPLE, GRADIENT, CUT, RENDERED, SKINNED, CLOTHED, GESTURES = (
    "people",
    "gradient",
    "cut",
    "rendered",
    "skinned",
    "clothed",
    "gestures",
)
FIRST_RENDERED, RENDERED_FOR_FIT = 20, range(100, 112)  # seeds that the demo does not use
GESTURES_FOR_FIT = range(10, 14)  # seeds that the benchmark of colour does not use


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the tables, write the numbers."""
    parser = command_line("certainty", __doc__)
    add = parser.add_argument
    add_data(parser)
    add("--fit", action="store_true", help="fit on subjects 1 and 2 and rendered people")
    add("--subjects", nargs="+", type=int, default=[3, 4], help="default: 3 4, not used for the fit")
    add("--demo", type=int, metavar="N", help="N rendered people of gepf demo instead of the subjects")
    add("--every", nargs="+", type=int, metavar="N", help="every n-th frame; default: 1 2 3, with --demo 1")
    add("--cut", type=float, metavar="SHARE", help="images end at this share of the way from knees to hips")
    add_changes(parser)
    add("--seeds", type=int, default=3, metavar="N", help="default: 3")
    add_processes(parser)
    chosen = parser.parse_args(arguments)
    if chosen.every is None:
        chosen.every = EVERY if chosen.demo is None else [1]
    return measured(measure, chosen)


def measure(choice: Namespace) -> int:
    """Exit code: 1 if a recording crashed. InputError for invalid options."""
    if choice.fit and choice.demo is not None:
        raise InputError("give either --fit or --demo; a fit is scored on recorded people")
    console = progress()
    console.print("loading kernels and bodies")
    bodies, crashes, scores, found = prepare(), list[str](), list[Score](), CertaintyFit()
    with TemporaryDirectory() as folder:
        if choice.fit:
            gathered = gather_to_fit(choice, Path(folder), bodies, crashes)
            if not gathered:
                raise InputError(f"nothing could be tracked: {'; '.join(crashes) or 'no recordings'}")
            found = fit(gathered, (PEOPLE, GRADIENT, CUT))
            screen().print(found)
            for kind in KINDS:
                scores.append(score(f"fitted: {kind}", [g for g in gathered if g.kind == kind], found))
        if choice.demo is None:
            name, recordings = f"subjects {choice.subjects}", find_hard(choice.data, choice.subjects)
        else:
            seeds = range(FIRST_RENDERED, FIRST_RENDERED + choice.demo)
            name, recordings = f"{choice.demo} people of gepf demo", render_people(Path(folder), seeds)
        scores.append(score(name, track_all(name, recordings, choice, bodies, crashes), found))
    for line in crashes:
        console.print(line)
    screen().print(score_table(scores))
    options = {name: str(value) for name, value in vars(choice).items()}
    keep({"options": options, "scores": scores}, choice.out)
    return 1 if crashes else 0


def gather_to_fit(choice: Namespace, folder: Path, bodies: Bodies, crashes: list[str]) -> list[Gathered]:
    """Recordings of each kind, to which certainty is fitted."""
    people, rendered = find_hard(choice.data, FIT_SUBJECTS), render_people(folder, RENDERED_FOR_FIT)
    skinned, clothed = find_rendered(choice.data), find_clothed(choice.data)[::2]
    gestures = render_gestures(folder, GESTURES_FOR_FIT)
    plain = Namespace(**{**vars(choice), "cut": None})
    gradient = Namespace(**{**vars(plain), "changes": [*choice.changes, "method=gradient"]})
    cut = Namespace(**{**vars(plain), "cut": 0.0})
    return [
        *track_all(PEOPLE, people, plain, bodies, crashes),
        *track_all(GRADIENT, people, gradient, bodies, crashes),
        *track_all(CUT, people, cut, bodies, crashes),
        *track_all(RENDERED, rendered, Namespace(**{**vars(gradient), "every": [1]}), bodies, crashes),
        *track_all(SKINNED, skinned, Namespace(**{**vars(plain), "every": EVERY[::2]}), bodies, crashes),
        *track_all(CLOTHED, clothed, Namespace(**{**vars(plain), "every": [1]}), bodies, crashes),
        *track_all(GESTURES, gestures, Namespace(**{**vars(plain), "every": [1]}), bodies, crashes),
    ]


def track_all(
    kind: str, recordings: Sequence[Recording], choice: Namespace, bodies: Bodies, crashes: list[str]
) -> list[Gathered]:
    """All recordings, frame rates and seeds, each in a process of its own."""
    settings = settings_with(choice.changes, None)
    jobs = [(r, n, seed) for seed in range(choice.seeds) for n in choice.every for r in recordings]

    def run(job: tuple[Recording, int, int]) -> Gathered | None:
        recording, n, seed = job
        return gather(kind, recording, n, msgspec.structs.replace(settings, seed=seed), bodies, choice.cut)

    found: dict[int, Gathered] = {}
    for job, result in run_forked(run, jobs, choice.processes):
        if isinstance(result, Crash):
            crashes.append(f"{job[0].name}: {result.error}")
        elif result is not None:
            found[jobs.index(job)] = result
    return [found[number] for number in sorted(found)]


if __name__ == "__main__":
    sys.exit(main())
