"""Requests that every decoder accepts, with all of their numbers at the bounds."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.body import LEAST_SPREAD, ROOT_DOFS, BodyModel
from gepf.common.bounds import LARGEST, LARGEST_PRECISION, SMALLEST
from gepf.common.camera import Intrinsics
from gepf.common.errors import ProtocolError
from gepf.common.frame import SubjectFrame, SubjectView, View
from gepf.common.protocol.frames import decode_frame, encode_frame
from gepf.common.protocol.messages import RefineRequest, decode_request, encode_request
from gepf.common.protocol.models import decode_model, encode_model
from gepf.common.refinement import Particles, PosePrior
from gepf.common.settings import RefineSettings
from gepf.worker.warm_up import tiny_frame, tiny_model

FAR_PIXEL = 2**31 - 1
MAX_TRIALS = 100  # per case
POSITIVE = (SMALLEST, 1e-3, 0.01, 1.0, LARGEST)
ANY_SETTING = (0.0, 1e-300, 1e-6, 0.1, 1.0, LARGEST)

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """The decoded input of a refinement."""

    model: BodyModel
    frame: SubjectFrame
    request: RefineRequest


class Extremes:
    """Makes cases, each with all of its numbers at random places; the same seed makes the same ones."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def case(self) -> Case:
        """A case after encoding and decoding; ProtocolError if it is not accepted."""
        model = self._one_of((self._model, self._pyramid))()
        frame = self._one_of((self._frame, tiny_frame))()
        settings, poses = self._settings(), self._poses(len(model.dof_names))
        prior = self._one_of((None, self._prior(poses.shape)))
        request = RefineRequest("room/extreme", 0, model.hash, Particles(poses, settings, prior=prior))
        return Case(
            decode_model(encode_model(model)),
            decode_frame(encode_frame(frame)),
            decode_request(encode_request(request)),
        )

    def accepted(self, count: int) -> list[Case]:
        """This number of accepted cases."""
        cases: list[Case] = []
        for _ in range(MAX_TRIALS * count):
            with suppress(ProtocolError):  # where limits leave no room between them
                cases.append(self.case())
            if len(cases) == count:
                return cases
        raise AssertionError(f"of {MAX_TRIALS * count} cases only {len(cases)} are accepted")

    def _one_of(self, choices: Sequence[T]) -> T:
        return choices[int(self._rng.integers(len(choices)))]

    def _coin(self) -> bool:
        return bool(self._rng.integers(2))

    def _numbers(self, shape: tuple[int, ...], largest: float) -> Array:
        """Usual ones, extreme ones, a few extreme ones among usual ones, or all the same."""
        usual = self._rng.normal(size=shape) * self._one_of((1e-3, 0.1, 1.0))
        sizes = [0.0, 1e-300, 1e-9, 1e-3, 0.1, 1.0, 10.0, largest / 2, largest]
        extreme = self._rng.choice(sizes, size=shape) * self._rng.choice([-1.0, 1.0], size=shape)
        few = np.where(self._rng.random(shape) < 0.1, extreme, usual)
        return self._one_of((usual, extreme, few, np.full(shape, extreme.flat[0])))

    def _poses(self, dofs: int) -> Array:
        """Anywhere, or where the pyramid is seen."""
        if self._coin():
            return self._numbers((2, dofs), LARGEST)
        near: Array = 0.01 * self._rng.normal(size=(2, dofs))
        near[:, 2:3] += 2.0
        return near

    def _prior(self, shape: tuple[int, ...]) -> PosePrior:
        """With a mean near or anywhere, for all or each; of any precision."""
        mean = self._poses(shape[1])
        deviations = self._numbers(shape[1:], LARGEST_PRECISION**0.5)
        precision = self._one_of((np.outer(deviations, deviations), deviations**2, np.diag(deviations**2)))
        return PosePrior(mean if self._coin() else mean[0], precision)

    def _pyramid(self) -> BodyModel:
        """The one that kernels are warmed up with, and one thing about it changed."""
        changes: tuple[dict[str, Any], ...] = (
            {},
            {"vertices": self._numbers((4, 3), 1.0)},
            {"points": self._numbers((6, 3), LARGEST)},
            {"limits": np.sort(self._numbers((6, 2), LARGEST), axis=1)},
            {"axes": self._axes(6), "balls": np.zeros(0, dtype=np.int64)},
            {"triangles": self._rng.integers(0, 4, (6, 3))},
        )
        return replace(tiny_model(), **self._one_of(changes))

    def _spreads(self, dofs: int, balls: list[int]) -> Array:
        """Positive, and one of each ball."""
        spreads = np.exp(self._rng.uniform(np.log(LEAST_SPREAD), np.log(LARGEST), dofs))
        for start in balls:
            spreads[start : start + 3] = spreads[start]
        return spreads

    def _model(self) -> BodyModel:
        dofs, vertices = self._one_of((1, 2, 3, 6, 6, 9, 20)), self._one_of((1, 3, 4, 10, 60))
        links, triangles = self._one_of((1, 2, 3)), self._one_of((0, 1, 4, 30, 100))
        free = np.tile([-np.inf, np.inf], (dofs, 1))
        limits = np.sort(self._numbers((dofs, 2), LARGEST), axis=1)
        first = [start for start in range(0, dofs - 2, 3) if self._coin()]
        return BodyModel(
            name="extreme",
            dof_names=tuple(ROOT_DOFS[:dofs]) + tuple(f"joint-{k}" for k in range(6, dofs)),
            kinds=self._rng.integers(0, 2, dofs),
            parents=np.array([self._one_of((j - 1, int(self._rng.integers(-1, j)))) for j in range(dofs)]),
            axes=self._axes(dofs),
            points=self._numbers((dofs, 3), LARGEST),
            limits=free if self._coin() else limits,
            rest_spreads=self._spreads(dofs, first),
            balls=np.array(first, dtype=np.int64),
            link_names=tuple(f"link-{k}" for k in range(links)),
            link_dofs=self._rng.integers(-1, dofs, links),
            vertices=self._numbers((vertices, 3), LARGEST),
            triangles=self._rng.integers(0, vertices, (triangles, 3)),
            skin_links=self._rng.integers(0, links, (vertices, 2)),
            skin_weights=self._weights(vertices),
            joint_names=("joint",),
            joint_links=np.zeros(1, dtype=np.int64),
            joint_points=np.zeros((1, 3)),
        )

    def _axes(self, dofs: int) -> Array:
        axes = np.eye(3)[self._rng.integers(0, 3, dofs)] if self._coin() else self._rng.normal(size=(dofs, 3))
        unit: Array = axes / np.linalg.norm(axes, axis=1, keepdims=True)
        return unit

    def _weights(self, vertices: int) -> Array:
        """Shares (V, 2) that sum to 1, and may be far beyond it."""
        share = self._rng.random(vertices) if self._coin() else self._numbers((vertices,), 900.0)
        return np.stack([share, 1.0 - share], axis=1)

    def _frame(self) -> SubjectFrame:
        height, width = self._one_of((1, 2, 5, 32)), self._one_of((1, 3, 32))
        shape = (height, width)
        depths: tuple[NDArray[Any], ...] = (
            np.full(shape, 65535),
            np.full(shape, 1),
            np.zeros(shape),
            self._rng.integers(0, 65536, shape),
            self._rng.integers(0, 2, shape) * 2000,
        )
        depth = self._one_of(depths).astype(np.uint16)
        focal, centre = (160.0, SMALLEST, LARGEST, 1.0), (15.5, -LARGEST, LARGEST, 0.0)
        camera = Intrinsics(width, height, *map(self._one_of, (focal, focal, centre, centre)))
        views = (
            (0, 0, width, height),
            (-FAR_PIXEL, -FAR_PIXEL, FAR_PIXEL, FAR_PIXEL),
            (FAR_PIXEL, FAR_PIXEL, FAR_PIXEL, FAR_PIXEL),
        )
        seen = np.flatnonzero(depth)
        picked = seen[self._rng.random(len(seen)) < self._one_of((1.0, 0.5, 0.05))].astype(np.uint32)
        scale = self._one_of((1000.0, SMALLEST, LARGEST, 1.0))
        view = SubjectView(View(0, 0.0, depth, scale, camera), picked, self._one_of(views))
        return SubjectFrame(0, 0.0, (view,))

    def _settings(self) -> RefineSettings:
        return RefineSettings(
            icp_iterations=self._one_of((0, 1, 3, 6)),
            descent=self._one_of(("plain", "accelerated")),
            damping=self._one_of(ANY_SETTING),
            sensor=self._one_of(("distance", "camera")),
            outside_weight=self._one_of(ANY_SETTING),
            pose_deviation=self._one_of(ANY_SETTING),
            max_rest_pull=self._one_of(ANY_SETTING),
            noise_depth=self._one_of(POSITIVE),
            noise_lateral=self._one_of(POSITIVE),
            likelihood_scale=self._one_of(POSITIVE),
        )
