"""A finished run: angles and joints by name, exports, plots, report."""

from __future__ import annotations

import io
from collections.abc import Iterable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import ROOT_DOFS
from gepf.common.packages import needs
from gepf.coordinator.bodies.human.isb import isb_angles, isb_names
from gepf.coordinator.exports import export_run
from gepf.coordinator.exports.recorded import RecordedRun, read_run
from gepf.coordinator.results.angles import sliding_joints
from gepf.coordinator.results.csv_file import write_csv
from gepf.coordinator.results.summary import read_summary
from gepf.coordinator.results.track import where_missing
from gepf.named import index_of, refuse_degrees, table

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class Run:
    """The results of `gepf track` or `Tracker.save` in a folder.

    Attributes:
        folder: The folder.
        track: All arrays of `track.npz`, radians and metres.
        frame, time_s, status: Number, seconds and status of each frame (F,).
        placed: Frames (F,) with a pose; in those before the first detection, values are NaN.
        joint_names: Names for `joint`.
        angle_names: Names for `angle`: anatomical angles of a person, joints of a robot.
        isb_angle_names: Shoulder angles by the ISB; also names for `angle`.
        dof_names: MPEG-4 names of the degrees of freedom of the pose; also names for `angle`.
    """

    def __init__(self, recorded: RecordedRun) -> None:
        self.folder, self._smoothed_hz = recorded.folder, recorded.smoothed_hz
        self._continuous = recorded.track  # frames before the first detection have its pose
        self.track = track = where_missing(recorded.track, ~recorded.placed, lambda _: np.nan)
        self.frame, self.time_s, self.status = track.frame, track.time_s, track.status
        self.placed = recorded.placed
        self.joint_names, self.dof_names = track.joint_names, track.dof_names
        self.angle_names = track.angle_names
        self.isb_angle_names = isb_names(self.angle_names)

    @cached_property
    def summary(self) -> dict[str, Any]:
        """All settings, versions and counts, as in `summary.json`."""
        return read_summary(self.folder)

    def __len__(self) -> int:
        return len(self.frame)

    def angle(self, name: str, *, degrees: bool = False) -> Array:
        """An angle (F,) by its plain, ISB or MPEG-4 name; radians unless `degrees`. NaN before detection.

        Values of prismatic joints are in metres. InputError for an unknown name lists the valid ones; also
        for a prismatic joint in degrees.
        """
        track = self._continuous
        if name in track.dof_names:
            slides = name in self._sliding
            if slides and degrees:
                raise refuse_degrees(name)
            column = track.pose[:, track.dof_names.index(name)]
            values = column if slides else np.unwrap(column)
        elif name in self.isb_angle_names:
            shoulders = isb_angles(self.angle_names, track.angle)
            values = shoulders[:, self.isb_angle_names.index(name)]
        else:
            known = tuple(dict.fromkeys((*self.angle_names, *self.isb_angle_names, *track.dof_names)))
            values = track.angle[:, index_of(name, known, "angle")]
        values = np.where(self.placed, values, np.nan)
        return np.degrees(values) if degrees else values

    @cached_property
    def _sliding(self) -> frozenset[str]:
        return frozenset(ROOT_DOFS[:3]) | set(sliding_joints(self.folder))

    def angle_deviation(self, name: str, *, degrees: bool = False) -> Array:
        """Standard deviations (F,) of the error of an angle of `angle_names`, radians; NaN if it is lost."""
        values = column(self.track.angle_deviation, name, self.angle_names, "angle")
        return np.degrees(values) if degrees else values

    def joint(self, name: str) -> Array:
        """Positions (F, 3) of a joint, camera frame, metres; InputError lists the valid names."""
        return column(self.track.joint_positions, name, self.joint_names, "joint")

    def joint_deviation(self, name: str) -> Array:
        """Standard deviations (F,) of the error of a joint, metres; NaN if it is lost."""
        return column(self.track.joint_deviation, name, self.joint_names, "joint")

    def joint_off_probability(self, name: str) -> Array:
        """Probabilities (F,) that the error of a joint is above 15 cm; NaN if it is lost."""
        return column(self.track.joint_off_probability, name, self.joint_names, "joint")

    def joint_seen(self, name: str) -> Array:
        """Visible share (F,) of the surface around a joint, 0 to 1; NaN if it is lost."""
        return column(self.track.joint_seen, name, self.joint_names, "joint")

    def smooth(self, cutoff_hz: float = 6.0) -> Run:
        """The run, low-pass filtered without delay; its folder is not changed."""
        return Run(read_run(self.folder, cutoff_hz))

    def _repr_html_(self) -> str:
        """The main facts, for notebooks."""
        from gepf.coordinator.report.page import describe_run

        return table(describe_run(self.track, self.summary)[:4])  # frames, status, body, method

    def to_dataframe(self) -> pd.DataFrame:
        """The columns of `poses.csv`, one row per frame; InputError if pandas is not installed."""
        with needs("tables", "to_dataframe"):
            import pandas as pd
        text = io.BytesIO()
        write_csv(self.track, text)
        text.seek(0)
        return pd.read_csv(text)

    def export(
        self, path: str | Path, form: str | None = None, *, frame: int | None = None, force: bool = False
    ) -> Path:
        """Write the run in the format `form`, by default that of the suffix of the file.

        A mesh or point cloud shows the body in frame number `frame`, by default in the first tracked frame.
        InputError for unknown formats, and for an existing file without `force`.
        """
        path = Path(path)
        form = form or path.suffix.removeprefix(".")
        export_run(self.folder, form, path, frame=frame, smooth_hz=self._smoothed_hz, force=force)
        return path

    def report(self, path: str | Path | None = None) -> Path:
        """Write the HTML report of the run to `path`, by default into its folder, and return the path."""
        from gepf.coordinator.report.page import write_report

        page = Path(path) if path else self.folder / "report.html"
        write_report(self.folder, page)
        return page

    def plot(self, names: Iterable[str] | None = None) -> Figure:
        """A figure of angles (`names`, or all) in degrees over seconds, each with its deviation."""
        from gepf.coordinator.pictures.plots import angle_curves, plot_curves

        chosen = self.angle_names if names is None else tuple(names)
        for name in chosen:
            index_of(name, self.angle_names, "angle")
        return plot_curves(self.track, angle_curves(self.track, chosen))


def column(values: Array, name: str, names: tuple[str, ...], kind: str) -> Array:
    """The values (F, ...) of the joint or angle `name`, which must be one of `names`, in all frames."""
    return values[:, index_of(name, names, kind)].copy()


def load(folder: str | Path) -> Run:
    """Load the run in a folder of `gepf track --out`; InputError if it is missing or damaged."""
    return Run(read_run(Path(folder)))
