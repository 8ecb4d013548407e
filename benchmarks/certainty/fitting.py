"""The fit of what the tracker's certainty goes by: a logistic and a log-linear function of the evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.certainty.gather import Gathered
from coordinator.tracking.certainty.assessment import Functions, is_hidden, limit, recall
from coordinator.tracking.certainty.certainty import OFF
from coordinator.tracking.certainty.evidence import CLUES

Array = NDArray[np.float64]

RIDGE = 1000.0  # joints that say nothing, for each weight of a clue of unit deviation
RENDERED_WEIGHT = 0.3  # of a joint of rendered people, whose exact truth is not what is asked about people
EXTREMES = (0.5, 99.5)  # per cent of each clue beyond which it counts as its limit
HIDDEN_WEIGHT = 10.0  # of joints of which less than half is shown, in the fit of the deviation
UNSEEN_STEPS = np.linspace(0.0, 2.0, 201)  # of what is added to hidden joints' log deviation
ONE_DEVIATION = 68.3  # per cent of joints that are to lie within it
STILL = 1e-6  # a step that ends the fit
MOST_OFF = 5.0  # deviations that a joint is off at the most, in a step of the fit


def judge(one: Gathered, functions: Functions) -> Array:
    """Log odds and log deviation (F, J, 2) of a recording's joints, as the tracker would have them."""
    return over_time(functions.judge(one.evidence, lone=one.lone), one.interval)


def given_of(one: Gathered) -> Array:
    """What log odds and log deviation (F, J, 2) have that is not fitted: what functions of no weight say."""
    nothing = np.zeros(len(CLUES))
    none = Functions(nothing, nothing, (0.0, nothing), (0.0, nothing))
    return none.judge(one.evidence, lone=one.lone)


def distances(gathered: Sequence[Gathered]) -> list[Array]:
    """How far off each joint (F, J) is, metres, without a person's constant offsets from a vendor's."""
    offsets = {}
    for person in {one.person for one in gathered} - {""}:
        mine = [np.where(g.holds[..., None], g.apart, np.nan) for g in gathered if g.person == person]
        offsets[person] = np.nanmedian(np.concatenate(mine), axis=0)
    return [np.linalg.norm(g.apart - offsets.get(g.person, 0.0), axis=-1) for g in gathered]


def averaged(one: Gathered, low: Array, high: Array) -> Array:
    """The evidence (F, J, K) within limits, averaged over the frames before."""
    return over_time(limit(one.evidence, low, high), one.interval)


def over_time(values: Array, intervals: Array) -> Array:
    """Values (F, ...) averaged over the frames before, as the tracker does it, from intervals (F,)."""
    frames: list[Array] = []
    for now, interval in zip(values, intervals, strict=True):
        frames.append(recall(now, frames[-1] if frames else None, interval))
    return np.array(frames)


def fit(gathered: Sequence[Gathered]) -> Functions:
    """Fit both functions to joints whose reference holds, and what hidden ones are worse by of new people."""
    return replace(fit_functions(gathered), unseen=fit_unseen(gathered))


def halfway(before: Functions, now: Functions) -> Functions:
    """The fit to present poses, its odds half-way back to those that the tracker went by.

    Half-way is as good of people left out as the better of the two, and better than a fit by itself of
    rendered ones. The deviation's weights stay: new ones say too little of joints outside the picture.
    """
    odds = middle(before.probability, now.probability)
    return Functions(now.low, now.high, odds, before.deviation, before.unseen)


def middle(one: tuple[float, Array], other: tuple[float, Array]) -> tuple[float, Array]:
    """The mean of two intercepts and of their weights (K,)."""
    return 0.5 * (one[0] + other[0]), 0.5 * (one[1] + other[1])


def fit_unseen(gathered: Sequence[Gathered]) -> float:
    """What to add to hidden joints' log deviation, by people who are each judged by a fit to all others."""
    people = sorted({one.person for one in gathered} - {""})
    if len(people) < 2:
        return 0.0
    parts = []
    for person in people:
        functions = fit_functions([one for one in gathered if one.person != person])
        mine = [one for one in gathered if one.person == person]
        for one, off in zip(mine, distances(mine), strict=True):
            at, hidden = one.holds & is_hidden(one.evidence), is_hidden(one.evidence).astype(np.float64)
            log_ratio = np.log(off + 1e-9) - judge(one, functions)[..., 1]
            parts.append(np.stack([log_ratio[at], over_time(hidden, one.interval)[at]], axis=1))
    log_ratio, share = np.concatenate(parts).T
    enough = [100.0 * np.mean(log_ratio < step * share) >= ONE_DEVIATION for step in UNSEEN_STEPS]
    return float(UNSEEN_STEPS[int(np.argmax(enough))] if any(enough) else UNSEEN_STEPS[-1])


def fit_functions(gathered: Sequence[Gathered]) -> Functions:
    """Fit both functions to joints whose reference holds.

    Rendered people have an intercept of their own, which is left out: their truth is exact, and the rates at
    which joints of people are off are those beside a measured reference.
    """
    holds = [one.holds for one in gathered]
    raw = np.concatenate([one.evidence[held] for one, held in zip(gathered, holds, strict=True)])
    low, high = np.percentile(raw, EXTREMES, axis=0)
    evidence = np.concatenate([averaged(g, low, high)[held] for g, held in zip(gathered, holds, strict=True)])
    off = np.concatenate([d[held] for d, held in zip(distances(gathered), holds, strict=True)])
    given = [over_time(given_of(g), g.interval)[h] for g, h in zip(gathered, holds, strict=True)]
    chance, spread = np.concatenate(given).T
    measured = are_measured(gathered)
    mean, scale = evidence.mean(axis=0), evidence.std(axis=0) + 1e-9
    columns = np.column_stack([np.ones(len(off)), ~measured, (evidence - mean) / scale])
    weight = np.where(measured, 1.0, RENDERED_WEIGHT)
    logistic = fit_logistic(columns, off > OFF, chance, weight)
    linear = fit_deviation(columns, off * np.exp(-spread), weight * weights_of(is_hidden(raw), measured))
    return Functions(low, high, unstandardised(logistic, mean, scale), unstandardised(linear, mean, scale))


def are_measured(gathered: Sequence[Gathered]) -> NDArray[np.bool_]:
    """Which joints that hold (n,) are of measured people; all, where none is."""
    measured = np.concatenate([np.full(np.count_nonzero(g.holds), bool(g.person)) for g in gathered])
    return measured if measured.any() else ~measured


def weights_of(hidden: NDArray[np.bool_], measured: NDArray[np.bool_]) -> Array:
    """Weights (n,) of joints in the fit of the deviation; hidden ones of people and rendered count alike."""
    people, rendered = np.count_nonzero(hidden & measured), np.count_nonzero(hidden & ~measured)
    scarcer = rendered / people if people and rendered else 1.0
    return np.where(hidden, HIDDEN_WEIGHT * np.where(measured, scarcer, 1.0), 1.0)


def fit_logistic(columns: Array, off: NDArray[np.bool_], given: Array, weight: Array) -> Array:
    """Weights (K + 2,) of the log odds beside those given (n,), by damped Newton steps.

    columns: (n, K + 2), ones, who is rendered, and clues of unit deviation. weight: (n,) of the joints.
    """
    ridge = ridge_of(columns)
    found = np.zeros(columns.shape[1])
    share = np.clip(off.mean(), 1e-3, 0.999)
    found[0] = np.log(share / (1.0 - share)) - given.mean()  # from elsewhere it need not converge

    def cost(weights: Array) -> float:
        log_odds = columns @ weights + given
        misfit = weight @ (np.logaddexp(0.0, log_odds) - off * log_odds)
        return float(misfit + 0.5 * weights @ ridge @ weights)

    for _ in range(50):
        chance = 1.0 / (1.0 + np.exp(-np.clip(columns @ found + given, -30.0, 30.0)))
        slope = columns.T @ (weight * (off - chance)) - ridge @ found
        curvature = (columns * (weight * chance * (1.0 - chance))[:, None]).T @ columns + ridge
        step = np.linalg.solve(curvature, slope)
        while cost(found + step) > cost(found) and np.abs(step).max() > STILL:  # whole ones may diverge
            step /= 2.0
        found += step
        if np.abs(step).max() <= STILL:
            break
    return found


def fit_deviation(columns: Array, off: Array, weight: Array) -> Array:
    """Weights (K + 2,) of the log deviation, from columns as for `fit_logistic`.

    The likeliest for distances that are spread exponentially, which far ones do not carry away; then scaled
    so that as many of measured people's lie within one deviation as should.
    """
    ridge = ridge_of(columns)
    found = np.zeros(columns.shape[1])
    found[0] = np.log(off.mean())
    for _ in range(50):
        share = np.minimum(off * np.exp(-columns @ found), MOST_OFF)
        slope = columns.T @ (weight * (share - 1.0)) - ridge @ found
        curvature = (columns * (weight * np.maximum(share, 0.1))[:, None]).T @ columns + ridge
        found += np.linalg.solve(curvature, slope)
    in_deviations = (off * np.exp(-columns @ found))[columns[:, 1] == 0.0]
    found[0] += np.log(np.percentile(in_deviations, ONE_DEVIATION))
    return found


def ridge_of(columns: Array) -> Array:
    """The ridge (K + 2, K + 2) that spares the intercepts; that of rendered people may stand for nobody."""
    return np.diag([0.0, 1.0, *np.full(columns.shape[1] - 2, RIDGE)])


def unstandardised(found: Array, mean: Array, scale: Array) -> tuple[float, Array]:
    """Intercept and weights (K,) for measured people's evidence as it is."""
    weights = found[2:] / scale
    return float(found[0] - weights @ mean), weights
