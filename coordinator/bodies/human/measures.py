"""Measures of a person: stature, girth and segment lengths. Missing lengths follow from stature."""

from __future__ import annotations

from dataclasses import dataclass, fields

from common.errors import InputError
from coordinator.bodies.human.shape_space import shape_space

REFERENCE_STATURE = 1.75  # metres, of a person of unknown stature


@dataclass(frozen=True)
class Measures:
    """Lengths in metres; `girth` is a factor (1 for an average person in everyday clothes).

    `trunk` is the length from the hip joints to the centres of rotation of the arms; the upper arm is from
    there to the elbow; widths are between such centres.
    """

    stature: float
    girth: float
    upper_arm: float
    forearm: float
    hand: float
    thigh: float
    shank: float
    ankle_height: float
    foot: float
    trunk: float
    shoulder_width: float
    hip_width: float

    @property
    def lengths(self) -> tuple[float, ...]:
        """All but stature and girth, in this order."""
        return tuple(getattr(self, name) for name in LENGTHS)

    @classmethod
    def of(cls, stature_m: float = REFERENCE_STATURE, girth: float = 1.0, **lengths: float) -> Measures:
        """Measures of a person of this stature; `lengths` (metres) replace those that stature implies.

        Raises InputError for an unknown or implausible measure.
        """
        known = dict(zip(LENGTHS, shape_space().implied(stature_m).tolist(), strict=True))
        for name in lengths:
            if name not in known:
                raise InputError(f"unknown measure '{name}'; leave it out, or choose from {', '.join(known)}")
        measures = cls(stature=stature_m, girth=girth, **{**known, **lengths})
        measures._check(known)
        return measures

    def _check(self, usual: dict[str, float]) -> None:
        if not 0.5 <= self.stature <= 2.6:
            raise InputError(f"stature {self.stature} m is implausible; give metres between 0.5 and 2.6")
        if not 0.5 <= self.girth <= 2.0:
            raise InputError(f"girth {self.girth} is implausible; give a factor between 0.5 and 2")
        for name, value in zip(LENGTHS, self.lengths, strict=True):
            if not 0.5 <= value / usual[name] <= 2.0:
                raise InputError(
                    f"{name} {value} m does not fit a stature of {self.stature} m; "
                    f"give metres, about {usual[name]:.2f}"
                )


LENGTHS = tuple(field.name for field in fields(Measures))[2:]
