"""An estimate with its body, for access to joints and angles by name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from markupsafe import Markup

from gepf.common.arrays import Array
from gepf.common.body import TRANSLATION, BodyModel, at_zero_shape, with_fixed_shape
from gepf.common.errors import InputError, check_choice
from gepf.coordinator.bodies.angles import Angles
from gepf.coordinator.bodies.families import angles_of
from gepf.coordinator.tracking import estimate

ROW = Markup('<tr><th>{}</th><td style="text-align: left">{}</td></tr>')


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Estimate(estimate.Estimate):
    """The reported pose of a frame, all hypotheses (M), and their certainty.

    Weights sum to 1. Joint positions are in the camera frame, metres. `residual` is the mean distance between
    observed points and the most likely hypothesis, metres; NaN if nothing was observed.
    """

    flexible: BodyModel
    """The body with its shape coefficients, if it has any, as degrees of freedom."""
    shape: Array = field(default_factory=lambda: np.empty(0))
    """The values (S,) of these shape coefficients."""
    held: Mapping[str, float] = field(default_factory=dict)

    @property
    def model(self) -> BodyModel:
        """The body in its present shape, with the degrees of freedom of the pose; built on request."""
        return body_of(self.flexible, self.shape.tobytes())

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names for `joint`."""
        return self.flexible.joint_names

    @property
    def angle_names(self) -> tuple[str, ...]:
        """Names for `angle`, besides the MPEG-4 names of the degrees of freedom."""
        return self._angles.names

    @property
    def _angles(self) -> Angles:
        return angles_of(at_zero_shape(self.flexible), self.held)

    def joint(self, name: str) -> Array:
        """Position (3,) of a joint, camera frame, metres; InputError lists the valid names."""
        at: Array = self.joint_positions[index_of(name, self.joint_names, "joint")]
        return at

    def joint_deviation(self, name: str) -> float:
        """Standard deviation of the error of a joint, metres; NaN if it is lost."""
        return self._of_joint("deviation", name)

    def joint_off_probability(self, name: str) -> float:
        """Probability that the error of a joint is above 15 cm; NaN if it is lost."""
        return self._of_joint("off_probability", name)

    def joint_seen(self, name: str) -> float:
        """Visible share, 0 to 1, of the surface around a joint; NaN if it is lost."""
        return self._of_joint("seen", name)

    def _of_joint(self, what: str, name: str) -> float:
        at = index_of(name, self.joint_names, "joint")
        return float(getattr(self.certainty, what)[at])

    def angle(self, name: str, *, degrees: bool = False) -> float:
        """An angle, radians unless `degrees`; the value nearest to zero, as one frame cannot show full turns.

        Values of prismatic joints are in metres; InputError if they are requested in degrees.
        """
        model = at_zero_shape(self.flexible)
        if name in model.dof_names:
            at = model.dof_names.index(name)
            if degrees and model.kinds[at] == TRANSLATION:
                raise refuse_degrees(name)
            value = self.pose[at]
        else:
            known = tuple(dict.fromkeys((*self.angle_names, *model.dof_names)))
            value = self._angles.measure(self.pose[None])[0, index_of(name, known, "angle")]
        return float(np.degrees(value) if degrees else value)

    def _repr_html_(self) -> str:
        """The main facts, and the angles in degrees, for notebooks."""
        facts = {"frame": self.frame, "status": self.status, "why": self.why or "-"}
        facts |= {"residual": f"{1000.0 * self.residual:.0f} mm", "hypotheses": len(self.hypothesis_weight)}
        angles = self._angles.measure(self.pose[None])[0]
        degrees = (
            f"{name} {value:z.0f}" for name, value in zip(self.angle_names, np.degrees(angles), strict=True)
        )
        return table({**facts, "angles, degrees": ", ".join(degrees)}.items())


@lru_cache(maxsize=16)
def body_of(flexible: BodyModel, shape: bytes) -> BodyModel:
    """The body with these values of its shape coefficients, as bytes."""
    return with_fixed_shape(flexible, np.frombuffer(shape))


def table(rows: Iterable[tuple[str, object]]) -> str:
    """Names and values as HTML."""
    lines = (ROW.format(name, value) for name, value in rows)
    return f"<table>{Markup('').join(lines)}</table>"


def refuse_degrees(name: str) -> InputError:
    """The error for a prismatic joint that is requested in degrees."""
    return InputError(f"'{name}' is a sliding joint, whose values are metres; leave degrees=True out")


def index_of(name: str, names: tuple[str, ...], kind: str) -> int:
    """Index of a name; InputError that lists all names."""
    check_choice(kind, name, names)
    return names.index(name)
