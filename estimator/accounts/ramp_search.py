"""Search for the ramp along which one leak most likely grew, in compiled code.

Each leak, each fault of the lines and a null that moves is tried along ramps, from some marks on
and over some durations, beside the nuisances (`estimator.accounts.regression`). Along a ramp from
time b over s seconds the level is (t - b) / s, so that the products of its column with another one
are

    sum of level x products = [B - B' - b (A - A')] / s + A'

where A is the sum of the products between marks from the ramp's beginning on, B that of the
products times their time, and dashes stand for the same from the ramp's end on. No ramp costs more
than that, however long it is. Times count back from now, so that sums of old blocks, which both
hold, do not hide the difference.
"""

from math import log1p, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.jit import njit
from rig.plant import inner

from .nuisances import NUISANCE_COUNT, NULL_SHIFT
from .regression import LEAST_INFORMATION, NOISE_WEIGHT, Regression
from .row import FAULT_COUNT, SUPPLY_LEAKAGE
from .sums import SHAPE_COUNT, SHIFT, AccountSums, Places

Array = NDArray[np.float64]

_N: Final = NUISANCE_COUNT
_M: Final = SHAPE_COUNT
_LL, _LF, _LY = Places.FAULT_SQUARES, Places.FAULT_CROSSED, Places.FAULT_PRODUCTS
_SIZE, _SECONDS, _BLOCKS = Places.SIZES, Places.SECONDS, Places.BLOCKS
_REFINEMENTS: Final = 12
"""Most rounds in which the best ramp is refined; each tries ramps around the best one so far."""
_FINEST: Final = 1.05
"""Refinement ends when durations a factor below this apart no longer differ."""


class RampRules(NamedTuple):
    """What a ramp must be like, and how it is compared with others.

    Attributes:
        least_s: shortest duration, s.
        most_s: longest duration, s.
        onsets: greatest number of onsets between which the first ramps were tried.
        witnesses: fewest blocks from a ramp's beginning on.
        settled: if a cause leaves less than this part of the noise variance, the variance is
            estimated anew.
        odds: a ramp that goes on until now is preferred to a likelier one that has ended, unless
            its gain in twice the log likelihood is less by this.
    """

    least_s: float
    most_s: float
    onsets: int
    witnesses: int
    settled: float
    odds: float


class LikelyRamp(NamedTuple):
    """The likeliest leak that grew, and the ramp along which it did.

    Attributes:
        gain: its gain in twice the log likelihood.
        rival: the greatest gain, among the same ramps, of a fault of the lines or of a null that
            moves, which may do so in either direction.
        fault: index of the leak in `FAULTS`.
        mark: mark at which it begins to grow.
        seconds: for how long it grows, s.
        variance: noise variance that would be left, in units of the expected noise.
    """

    gain: float
    rival: float
    fault: int
    mark: int
    seconds: float
    variance: float


def likeliest_ramp(
    sums: AccountSums, least: float, marks: NDArray[np.int64], seconds: Array, rules: RampRules
) -> LikelyRamp:
    """Return the likeliest leak along some ramps, refined; its gain is 0 if no leak is likely.

    Args:
        sums: sums over the blocks so far.
        least: lower bound of the estimated noise variance.
        marks: mark at which each ramp begins, (ramps,); at least one.
        seconds: how long each lasts, s, (ramps,).
        rules: what all ramps must be like; those that are tried first must be so already.
    """
    regression = Regression(*sums.nuisances(), 2 * sums.blocks, least)
    vectors, values, projected = regression.axes
    total, before = sums.packed
    starts = sums.starts_s
    end_s = float(starts[-1]) + sums.seconds(sums.marks - 1)
    since, crossed, visible = _from_each_mark(total, before, starts, end_s, rules.witnesses)
    turned = (crossed.reshape(-1, _N) @ vectors).reshape(crossed.shape)
    noise = (
        total[Places.MISSING], regression.freedom, regression.variance, least, rules.settled,
    )  # fmt: skip
    scored = (starts, end_s, since, turned, visible, values, projected, noise)
    # The last mark since which a leak can have grown for the shortest duration.
    last = last_mark(starts, end_s, rules.least_s)
    limits = rules.least_s, rules.most_s
    return LikelyRamp(*_searched(marks, seconds, last, rules.onsets, limits, rules.odds, scored))


def last_mark(starts: Array, end_s: float, least_s: float) -> int:
    """Return the last mark since which a leak can have grown for a time; -1 if there is none.

    Args:
        starts: time at which the block after each mark starts, s, (marks,).
        end_s: time at which the last block ends, s.
        least_s: the time, s.
    """
    return int(np.searchsorted(starts, end_s - least_s + 1e-6, side="right")) - 1


def compile_ramp_search() -> None:
    """Compile the search for ramps, or load it from the cache."""
    starts = np.arange(2.0)
    zeros = np.zeros(Places.BLOCKS + 4)
    since, crossed, visible = _from_each_mark(zeros, np.zeros((2, zeros.size)), starts, 2.0, 1)
    noise = 0.0, 1.0, 1.0, 1.0, 1.0
    scored = (starts, 2.0, since, crossed, visible, np.zeros(_N), np.zeros(_N), noise)
    first = np.zeros(1, dtype=np.int64)
    _searched(first, np.ones(1), 0, 1, (1.0, 2.0), 1.0, scored)


@njit(cache=True, error_model="numpy")
def _from_each_mark(total, before, starts, end_s, witnesses):
    """Return sums over the intervals between marks, from each mark up to now.

    Args:
        total: packed sums over all blocks, (width,), as in `estimator.accounts.sums`.
        before: packed sums before each mark, (marks, width).
        starts: time at which the block after each mark starts, s, (marks,).
        end_s: time at which the last block ends, s.
        witnesses: fewest blocks with a cause that shows.

    Returns:
        Products of each of the six fault columns with itself, with the null's shift and with the
        missing flow, each times the powers 0, 1 and 2 of the time less `end_s`,
        (marks + 1, 3, 3, 6); those with the nuisances times the powers 0 and 1,
        (marks + 1, 2, 6, n); and whether each cause shows, bool (marks, 6). The last row is 0.
    """
    marks = starts.size
    since, crossed = np.zeros((marks + 1, 3, 3, _M)), np.zeros((marks + 1, 2, _M, _N))
    visible = np.empty((marks, _M), np.bool_)
    for j in range(marks - 1, -1, -1):
        after = total if j == marks - 1 else before[j + 1]
        here = before[j]
        end = end_s if j == marks - 1 else starts[j + 1]
        time = 0.5 * (starts[j] + end) - end_s
        for i in range(_M):
            at = _LL + i * _M
            own = after[at + i] - here[at + i]
            shifted = after[at + SHIFT] - here[at + SHIFT]
            missing = after[_LY + i] - here[_LY + i]
            weight = 1.0
            for power in range(3):
                since[j, 0, power, i] = since[j + 1, 0, power, i] + weight * own
                since[j, 1, power, i] = since[j + 1, 1, power, i] + weight * shifted
                since[j, 2, power, i] = since[j + 1, 2, power, i] + weight * missing
                weight *= time
            for a in range(_N):
                place = _LF + i * _N + a
                part = after[place] - here[place]
                crossed[j, 0, i, a] = crossed[j + 1, 0, i, a] + part
                crossed[j, 1, i, a] = crossed[j + 1, 1, i, a] + time * part
        enough = total[_BLOCKS] - here[_BLOCKS] >= witnesses
        for i in range(FAULT_COUNT):
            visible[j, i] = enough and total[_SIZE + i] - here[_SIZE + i] > 0.0
        visible[j, SHIFT] = enough
    return since, crossed, visible


@njit(cache=True, error_model="numpy")
def _columns(mark, seconds, starts, end_s, since, crossed, products, turned):
    """Fill in the products of all causes along one ramp.

    Args:
        mark: mark at which the ramp begins.
        seconds: how long it lasts, s.
        starts: as for `_from_each_mark`.
        end_s: as for `_from_each_mark`.
        since: from `_from_each_mark`.
        crossed: from `_from_each_mark`, in the axes of the nuisances' products.
        products: (3, 6), filled with the causes' products with themselves, with the null's shift
            and with the missing flow.
        turned: (6, n), filled with their products with the nuisances.
    """
    marks = starts.size
    begin = starts[mark] - end_s
    grown = mark
    while grown < marks:
        end = 0.0 if grown == marks - 1 else starts[grown + 1] - end_s
        if 0.5 * (starts[grown] - end_s + end) - begin >= seconds:
            break
        grown += 1
    steep = 1.0 / seconds
    for i in range(_M):
        for k in range(2):
            plain = since[mark, k, 0, i] - since[grown, k, 0, i]
            timed = since[mark, k, 1, i] - since[grown, k, 1, i]
            twice = since[mark, k, 2, i] - since[grown, k, 2, i]
            rising = twice - 2.0 * begin * timed + begin * begin * plain
            products[k, i] = steep * steep * rising + since[grown, k, 0, i]
        plain = since[mark, 2, 0, i] - since[grown, 2, 0, i]
        timed = since[mark, 2, 1, i] - since[grown, 2, 1, i]
        products[2, i] = steep * (timed - begin * plain) + since[grown, 2, 0, i]
        for a in range(_N):
            plain = crossed[mark, 0, i, a] - crossed[grown, 0, i, a]
            timed = crossed[mark, 1, i, a] - crossed[grown, 1, i, a]
            turned[i, a] = steep * (timed - begin * plain) + crossed[grown, 0, i, a]


@njit(cache=True, error_model="numpy")
def _scored(products, turned, values, projected, total, freedom, variance, least, out):
    """Fill `out` (3, 6) with coefficient, explained sum and noise variance left of each cause.

    Each is fitted with a shift of the null that has grown along the same ramp, as
    `estimator.accounts.regression` fits sudden faults. A cause that the nuisances explain entirely
    has 0, 0 and the given variance.

    Args:
        products: from `_columns`.
        turned: from `_columns`.
        values: eigenvalues of F'F, (n,).
        projected: F'y in the axes of the eigenvectors, (n,).
        total: y'y.
        freedom: degrees of freedom of the noise variance that is left.
        variance: noise variance by which nuisances are weighed against noise.
        least: lower bound of the noise variance that is left.
        out: is filled.
    """
    weighted = total
    prior = variance / (NULL_SHIFT * NULL_SHIFT)
    shift_square, shift_product = products[0, SHIFT] + prior, products[2, SHIFT]
    for a in range(_N):
        kept = 1.0 / (values[a] + variance)
        weighted -= projected[a] * projected[a] * kept
        shift_square -= kept * turned[SHIFT, a] * turned[SHIFT, a]
        shift_product -= kept * turned[SHIFT, a] * projected[a]
    alone = shift_product / shift_square
    for i in range(_M):
        information, crossing, projection = products[0, i], products[1, i], products[2, i]
        for a in range(_N):
            part = turned[i, a] / (values[a] + variance)
            information -= part * turned[i, a]
            projection -= part * projected[a]
            crossing -= part * turned[SHIFT, a]
        information -= crossing * crossing / shift_square
        projection -= crossing * alone
        out[0, i], out[1, i], out[2, i] = 0.0, 0.0, variance
        if information > LEAST_INFORMATION * products[0, i]:
            coefficient = projection / information
            explained = coefficient * projection
            shifted = alone - coefficient * crossing / shift_square
            beliefs = prior / variance * shifted * shifted
            for a in range(_N):
                size = projected[a] - coefficient * turned[i, a] - shifted * turned[SHIFT, a]
                size /= values[a] + variance
                beliefs += size * size
            residual = weighted - alone * shift_product - explained - variance * beliefs
            out[0, i], out[1, i] = coefficient, explained
            out[2, i] = max((NOISE_WEIGHT + residual) / freedom, least)


@inner
def _best_of(marks, seconds, scored):
    """Return the fields of `LikelyRamp` of the best of some ramps, none of them refined.

    Args:
        marks: mark at which each ramp begins, (ramps,).
        seconds: how long each lasts, s, (ramps,).
        scored: the sums by which ramps are scored, as `likeliest_ramp` puts them together.
    """
    starts, end_s, since, crossed, visible, values, projected, noise = scored
    total, freedom, variance, least, settled = noise
    count = marks.size
    products, turned = np.empty((count, 3, _M)), np.empty((count, _M, _N))
    for r in range(count):
        _columns(marks[r], seconds[r], starts, end_s, since, crossed, products[r], turned[r])
    scores = np.empty((count, 3, _M))
    weighed = variance
    for _ in range(3):
        left = weighed
        for r in range(count):
            _scored(products[r], turned[r], values, projected, total, freedom, weighed, least,
                    scores[r])  # fmt: skip
            for i in range(_M):
                usable = visible[marks[r], i] and (scores[r, 0, i] > 0.0 or i >= SUPPLY_LEAKAGE)
                if usable:
                    left = min(left, scores[r, 2, i])
        if left > settled * weighed:
            break
        weighed = left
    best, rival, at, fault = -1.0, 0.0, 0, 0
    for r in range(count):
        for i in range(_M):
            line = i >= SUPPLY_LEAKAGE
            gain = 0.0
            if visible[marks[r], i] and (scores[r, 0, i] > 0.0 or line):
                gain = freedom * log1p(scores[r, 1, i] / (freedom * scores[r, 2, i]))
            if line:
                rival = max(rival, gain)
            elif gain > best:
                best, at, fault = gain, r, i
    return best, rival, fault, marks[at], seconds[at], scores[at, 2, fault]


@njit(cache=True, error_model="numpy")
def _near(mark, seconds, apart, factor, last, starts, end_s, limits):
    """Return mark and duration of ramps around one, which is among them.

    Args:
        mark: mark at which the ramp begins.
        seconds: how long it lasts, s.
        apart: greatest difference of the marks.
        factor: factor on the duration, and its inverse.
        last: the last mark at which a ramp may begin.
        starts: as for `_from_each_mark`.
        end_s: as for `_from_each_mark`.
        limits: shortest and longest duration, s.
    """
    step = max(apart // 2, 1)
    marks, times = np.empty(15, np.int64), np.empty(15)
    count = 0
    for part in (1.0 / factor, 1.0, factor):
        before = -1
        for k in range(-2, 3):
            of = min(max(mark + k * step, 0), last)
            if of != before:
                time = min(seconds * part, end_s - starts[of])
                marks[count], times[count] = of, min(max(time, limits[0]), limits[1])
                count += 1
            before = of
    return marks[:count], times[:count]


@njit(cache=True, error_model="numpy")
def _searched(marks, seconds, last, onsets, limits, odds, scored):
    """Return the fields of `LikelyRamp`, as `likeliest_ramp` does."""
    starts, end_s = scored[0], scored[1]
    best = _best_of(marks, seconds, scored)
    apart, factor = max(last // onsets, 1), sqrt(sqrt(2.0))
    for _ in range(_REFINEMENTS):
        near, times = _near(best[3], best[4], apart, factor, last, starts, end_s, limits)
        better = _best_of(near, times, scored)
        if better[0] > best[0]:
            best = better
            continue
        if apart == 1 and factor < _FINEST:
            break
        apart, factor = max(apart // 2, 1), sqrt(factor)
    first = max(best[3] - 2 * apart - 2, 0)
    on = np.arange(first, min(best[3] + 2 * apart + 2, last) + 1)
    until_now = np.empty(on.size)
    for k in range(on.size):
        until_now[k] = min(max(end_s - starts[on[k]], limits[0]), limits[1])
    going_on = _best_of(on, until_now, scored)
    if going_on[2] == best[2] and going_on[0] > best[0] - odds:
        best = going_on
    return best
