"""Measures of a person: stature, girth, age and segment lengths. Missing ones follow from stature."""

from __future__ import annotations

from dataclasses import dataclass, fields

from gepf.common.errors import InputError
from gepf.coordinator.bodies.human.shape_space import REFERENCE_STATURE, shape_space

DEVIATION = "stature_deviation"  # of an estimated stature, metres: an entry in a file of measures

BUILDS = {0.95: "slim", 1.15: "of average build", 1.3: "heavy"}
"""Upper limit of girth -> its name; people above all limits are very heavy."""


@dataclass(frozen=True)
class Measures:
    """Lengths in metres; `girth` is a factor (1 for an average person in everyday clothes), `age` in years.

    `trunk` is the length from the hip joints to the centres of rotation of the arms; the upper arm is from
    there to the elbow; widths are between such centres. Proportions depend on age up to 16 years.
    """

    stature: float
    girth: float
    age: float
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
        """All but stature, girth and age, in this order."""
        return tuple(getattr(self, name) for name in LENGTHS)

    def in_words(self, deviation_m: float = 0.0) -> str:
        """Stature and its standard deviation, age of a child, and build."""
        grown = self.age >= shape_space().ages[-1]
        age = "adult" if grown else f"child of about {self.age:.0f} years"
        build = next((word for limit, word in BUILDS.items() if self.girth < limit), "very heavy")
        doubt = f" (+- {100 * deviation_m:.0f} cm)" if deviation_m else ""
        return f"{self.stature:.2f} m{doubt}, {age}, {build}"

    @classmethod
    def of(
        cls,
        stature_m: float = REFERENCE_STATURE,
        girth: float = 1.0,
        age: float | None = None,
        **lengths: float,
    ) -> Measures:
        """Measures of a person of this stature; `lengths` (metres) replace those that stature and age imply.

        Raises InputError for an unknown or implausible measure.
        """
        space = shape_space()
        age = space.age(stature_m) if age is None else age
        known = dict(zip(LENGTHS, space.implied(stature_m, age).tolist(), strict=True))
        for name in lengths:
            if name not in known:
                all_names = ", ".join(field.name for field in fields(cls))
                raise InputError(f"unknown measure '{name}'; leave it out, or choose from {all_names}")
        measures = cls(stature=stature_m, girth=girth, age=age, **{**known, **lengths})
        measures._check(known)
        return measures

    def _check(self, usual: dict[str, float]) -> None:
        if not 0.5 <= self.stature <= 2.6:
            raise InputError(f"stature {self.stature} m is implausible; give metres between 0.5 and 2.6")
        if not 0.5 <= self.girth <= 2.0:
            raise InputError(f"girth {self.girth} is implausible; give a factor between 0.5 and 2")
        if not 0.0 <= self.age <= 120.0:
            raise InputError(f"age {self.age} is implausible; give years")
        for name, value in zip(LENGTHS, self.lengths, strict=True):
            if not 0.5 <= value / usual[name] <= 2.0:
                raise InputError(
                    f"{name} {value} m does not fit a stature of {self.stature} m; "
                    f"give metres, about {usual[name]:.2f}"
                )


LENGTHS = tuple(field.name for field in fields(Measures))[3:]
