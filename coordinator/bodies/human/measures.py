"""Measures of a person: stature, girth and segment lengths.

Missing lengths follow from stature. The fractions lie between the segments of Drillis & Contini (1966;
in Winter, "Biomechanics and Motor Control of Human Movement", 4th ed. 2009, fig. 4.1), which end at
landmarks on the skin, and the distances between joint centres of de Leva, "Adjustments to
Zatsiorsky-Seluyanov's segment inertia parameters", J. Biomech. 29 (1996). The joint centre of the shoulder
is taken 1-2 % of stature below the landmark there, the acromion, so the upper arm is shorter than theirs.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

from common.errors import InputError

REFERENCE_STATURE = 1.75  # metres, of a person of unknown stature

FRACTIONS_OF_STATURE = {
    "upper_arm": 0.166,
    "forearm": 0.148,
    "hand": 0.108,
    "thigh": 0.243,
    "shank": 0.247,
    "ankle_height": 0.040,
    "foot": 0.152,
    "trunk": 0.276,
    "shoulder_width": 0.206,
    "hip_width": 0.106,
}


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

    @classmethod
    def of(cls, stature_m: float = REFERENCE_STATURE, girth: float = 1.0, **lengths: float) -> Measures:
        """Measures of a person of this stature; `lengths` (metres) replace those that stature implies.

        Raises InputError for an unknown or implausible measure.
        """
        known = {name: fraction * stature_m for name, fraction in FRACTIONS_OF_STATURE.items()}
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
        for field in fields(self)[2:]:
            value = getattr(self, field.name)
            if not 0.5 <= value / usual[field.name] <= 2.0:
                raise InputError(
                    f"{field.name} {value} m does not fit a stature of {self.stature} m; "
                    f"give metres, about {usual[field.name]:.2f}"
                )
