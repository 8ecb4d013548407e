"""The fit of the tracker's certainty: a logistic function of the features, and a quantile of the distance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit

from benchmarks.certainty.gather import Gathered
from gepf.common.arrays import Array, Mask
from gepf.coordinator.settings import CertaintyFit, CertaintySettings, FeatureWeights
from gepf.coordinator.tracking.certainty import Features, log_odds

RIDGE = 100.0  # joints without information, for each weight of a feature of unit deviation
ONE_DEVIATION = 0.683  # share of the joints that should lie within it
LEAST_RESIDUAL = 1e-3  # of log metres, in the quantile's weights
MOST_STEPS, STILL = 100, 1e-6  # steps, and the size of step that ends the fit of the quantile


def distances(gathered: Sequence[Gathered]) -> list[Array]:
    """Error of each joint (F, J) in metres, without the constant offsets from a vendor's joints."""
    offsets = {}
    for person in {one.person for one in gathered} - {""}:
        mine = [np.where(g.holds[..., None], g.apart, np.nan) for g in gathered if g.person == person]
        offsets[person] = np.nanmedian(np.concatenate(mine), axis=0)
    return [np.linalg.norm(g.apart - offsets.get(g.person, 0.0), axis=-1) for g in gathered]


def joints_of(gathered: Sequence[Gathered]) -> tuple[Features, Array, NDArray[np.str_]]:
    """Features (n,), distances (n,) and kind (n,) of all joints whose reference is valid."""
    features = Features(
        *(np.concatenate([g.features[k][g.holds] for g in gathered]) for k in range(len(Features._fields)))
    )
    off = np.concatenate([d[g.holds] for d, g in zip(distances(gathered), gathered, strict=True)])
    return features, off, np.repeat([g.kind for g in gathered], [np.count_nonzero(g.holds) for g in gathered])


def fit(gathered: Sequence[Gathered], people: Sequence[str]) -> CertaintyFit:
    """Fit to all joints: half of the weight is on `people`, the other kinds share the rest equally.

    For the deviation, the other kinds have a quarter of that weight: their hidden joints have smaller errors.
    """
    features, off, kinds = joints_of(gathered)
    of_people = np.isin(kinds, people)
    others = {*kinds[~of_people].tolist()}
    counts = np.ones(len(off))
    for kind in others:
        counts[kinds == kind] = of_people.sum() / (len(others) * np.sum(kinds == kind))
    intercept, weights = fit_logistic(np.column_stack(features), off > CertaintySettings().wrong_m, counts)
    named = FeatureWeights(**dict(zip(Features._fields, weights.tolist(), strict=True)))
    odds = log_odds(features, CertaintySettings(fit=CertaintyFit(intercept, named)))
    columns = np.column_stack([np.ones(len(off)), odds, 1.0 - features.seen])
    counts = np.where(of_people, counts, counts / 4)
    a, b, c = fit_quantile(columns, np.log(off + np.finfo(float).tiny), counts)
    return CertaintyFit(intercept, named, a, b, c)


def fit_logistic(features: Array, off: Mask, counts: Array) -> tuple[float, Array]:
    """Intercept and weights (K,) of the log odds, from features (n, K) of joints with weights (n,)."""
    mean, scale = features.mean(axis=0), features.std(axis=0) + np.finfo(float).tiny
    columns = np.column_stack([np.ones(len(off)), (features - mean) / scale])
    ridge = np.repeat([0.0, RIDGE], [1, features.shape[1]])

    def cost(weights: Array) -> tuple[float, Array]:
        log_odds = columns @ weights
        misfit = counts @ (np.logaddexp(0.0, log_odds) - off * log_odds) + 0.5 * ridge @ weights**2
        return float(misfit), columns.T @ (counts * (expit(log_odds) - off)) + ridge * weights

    found = minimize(cost, np.zeros(columns.shape[1]), jac=True, method="BFGS").x
    weights = found[1:] / scale
    return float(found[0] - weights @ mean), weights


def fit_quantile(columns: Array, log_off: Array, counts: Array) -> tuple[float, ...]:
    """Weights of columns (n, K) whose sum is a quantile of log distances (n,) with weights (n,)."""
    found = np.linalg.lstsq(columns, log_off, rcond=None)[0]
    for _ in range(MOST_STEPS):
        residual = log_off - columns @ found
        slope = counts * np.where(residual > 0.0, ONE_DEVIATION, 1.0 - ONE_DEVIATION)
        weighted = columns * (slope / np.maximum(np.abs(residual), LEAST_RESIDUAL))[:, None]
        step = np.linalg.solve(weighted.T @ columns, weighted.T @ log_off) - found
        found = found + step
        if np.abs(step).max() < STILL:
            break
    return tuple(found.tolist())
