"""Checks of what a baseline's file holds before it is used: its checksum, keys, units and numbers.

A changed or damaged baseline would move the judgement on every later recording without a word.
"""

import hashlib
import json
from collections.abc import Collection, Iterator, Mapping
from math import isfinite
from typing import Any, Final

import numpy as np

from estimator.accounts import MOST_MODEL_ERROR, NUISANCE_COUNT, NUISANCES
from estimator.leaks import LEAST_LOOKS
from estimator.learnt import LARGEST, MOST_DEAD_ZONE, noise_of
from rig.plant import FAULTS, LEAKS

from .baseline import PATTERN_FILTERS

VERSION: Final = 2
"""Version of the form of baselines' files that is written. Since version 2 a file must have its
checksum: one without was changed."""
READ_VERSIONS: Final = (1, VERSION)
"""Versions that are read. Those of version 1 have the same keys, and may lack the checksum, as the
first of them were written before there was one."""
CHECKSUM: Final = "content_sha256"
"""Key of the SHA-256 of all the rest of a file."""
MOST_TOLERANCES: Final = 100.0
"""Most that a nuisance, or its deviation, may be in multiples of its tolerance. A hundred
tolerances are a spool null that is off by 1 mm, all of a servovalve's stroke, or a discharge
coefficient that is off by 500 %: no rig has them. A learnt deviation is about 1 or less, as the
tolerance itself is what was known before any data."""
MOST_PRESSURE_PA: Final = 1e9
"""Most that a level of innovations may be, Pa: some fifty times the supply pressure of a rig."""
MOST_LOOKS: Final = 1_000_000_000
"""Most half seconds that a level may be learnt from: fifteen years of recordings."""

_FORMER_FILTERS: Final = ("thesis-7-ud",)
"""Filters that no longer exist, whose levels files of earlier versions have as well."""
_NEEDED: Final = (
    "baseline_version", "model", "recordings", "nuisances", "tolerance_mean",
    "tolerance_covariance", "innovation_levels_Pa",
)  # fmt: skip
_ADDED_LATER: Final = ("model_sha256", "model_error", "noise", "commissioning", "accepted")
_REGIME_KEYS: Final = ("seconds", "noise_L_per_min", "factor", "chambers", "lasting")
_NOISE_KEYS: Final = (
    "regimes", "dead_zone_L_per_min", "peaks", "expected_alarms_per_day", "spool_correction",
)  # fmt: skip
_PEAK_KEYS: Final = ("over", "hours", "count", "excess", "regimes")


def checksum_of(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 (hex) of a file's values without the checksum itself.

    It is that of the values as JSON in ASCII with sorted keys and no spaces, so that indents and
    the order of keys do not count.
    """
    rest = {key: value for key, value in content.items() if key != CHECKSUM}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def problems_of(content: object) -> list[str]:
    """Return all reasons why the values of a file are no baseline; empty if they are one.

    Each reason begins with the key that it is about. A field of many numbers has one reason, which
    names the first number and how many more are wrong.
    """
    if not isinstance(content, dict):
        return ["it is no JSON object"]
    if "baseline_version" in content and content["baseline_version"] not in READ_VERSIONS:
        known = " or ".join(map(str, READ_VERSIONS))
        version = _shown(content["baseline_version"])
        return [f"baseline_version: its version is {version}, not {known}"]
    if "baseline_version" not in content:
        return ["baseline_version: there is no such key in it"]
    found = []
    if CHECKSUM in content and content[CHECKSUM] != checksum_of(content):
        found.append(f"{CHECKSUM}: the file was changed after it was written")
    if CHECKSUM not in content and content["baseline_version"] != 1:
        found.append(
            f"{CHECKSUM}: there is no such key in it, and each file of version "
            f"{content['baseline_version']} is written with it: the file was changed"
        )
    return found + list(_of_baseline(content, "", (CHECKSUM,)))


def _of_baseline(content: object, at: str, more: Collection[str] = ()) -> Iterator[str]:
    """Yield what is wrong with a baseline; `at` is what stands before its keys in messages."""
    yield from _of_keys(content, at, _NEEDED, (*_ADDED_LATER, *more))
    if not isinstance(content, dict):
        return
    for key in ("model", "model_sha256"):
        if not isinstance(content.get(key, ""), str):
            yield f"{at}{key}: {_shown(content[key])} is no text"
    if at and content.get("baseline_version", VERSION) not in READ_VERSIONS:
        known = " or ".join(map(str, READ_VERSIONS))
        yield f"{at}baseline_version: {_shown(content['baseline_version'])} is not {known}"
    if "model_error" in content:
        yield from _of_number(content["model_error"], 0.0, MOST_MODEL_ERROR, f"{at}model_error")
    if "recordings" in content:
        yield from _of_recordings(content["recordings"], f"{at}recordings")
    if "nuisances" in content:
        yield from _of_nuisances(content["nuisances"], f"{at}nuisances")
    if "tolerance_mean" in content:
        mean = content["tolerance_mean"]
        yield from _of_list(mean, -MOST_TOLERANCES, NUISANCE_COUNT, f"{at}tolerance_mean")
    if "tolerance_covariance" in content:
        yield from _of_covariance(content["tolerance_covariance"], f"{at}tolerance_covariance")
    if "innovation_levels_Pa" in content:
        yield from _of_levels(content["innovation_levels_Pa"], f"{at}innovation_levels_Pa")
    if content.get("noise") is not None:
        yield from _of_noise(content["noise"], f"{at}noise")
    if content.get("commissioning") is not None:
        yield from _of_baseline(content["commissioning"], f"{at}commissioning: ")
    accepted = content.get("accepted", [])
    if not isinstance(accepted, list):
        yield f"{at}accepted: {_shown(accepted)} is no list"
        return
    for index, each in enumerate(accepted):
        yield from _of_accepted(each, f"{at}accepted[{index}]")


def _of_keys(
    content: object, at: str, needed: Collection[str], allowed: Collection[str] = ()
) -> Iterator[str]:
    """Yield what is wrong with the keys of an object: those that lack and those that are unknown.

    `at` is what stands before a key in messages, such as "nuisances: ", or "".
    """
    if not isinstance(content, dict):
        yield f"{at}{_shown(content)} is no JSON object"
        return
    for key in needed:
        if key not in content:
            yield f"{at}{key}: there is no such key in it"
    for key in content:
        if key not in needed and key not in allowed:
            yield f"{at}{key[:60]}: is an unknown key"


def _of_recordings(content: object, name: str) -> Iterator[str]:
    if not isinstance(content, dict):
        yield f"{name}: {_shown(content)} is no JSON object of hashes by name"
        return
    for key, value in content.items():
        if not isinstance(value, str):
            yield f"{name}: {key}: {_shown(value)} is no hash"


def _of_nuisances(content: object, name: str) -> Iterator[str]:
    names = [nuisance.name for nuisance in NUISANCES]
    yield from _of_keys(content, f"{name}: ", names)
    if not isinstance(content, dict):
        return
    if set(content) == set(names) and list(content) != names:
        yield f"{name}: are in another order than {', '.join(names[:3])}, ..."
    for nuisance in NUISANCES:
        fields = content.get(nuisance.name)
        at = f"{name}: {nuisance.name}"
        if nuisance.name not in content:
            continue
        yield from _of_keys(fields, f"{at}: ", ("unit", "value", "deviation"))
        if not isinstance(fields, dict):
            continue
        if fields.get("unit", nuisance.unit) != nuisance.unit:
            yield f"{at}: unit: {_shown(fields['unit'])} is not {nuisance.unit!r}"
        most = MOST_TOLERANCES * nuisance.sigma
        if "value" in fields:
            yield from _of_number(fields["value"], -most, most, f"{at}: value")
        if "deviation" in fields:
            yield from _of_number(fields["deviation"], 0.0, most, f"{at}: deviation", above=True)


def _of_covariance(content: object, name: str) -> Iterator[str]:
    rows = content if isinstance(content, list) else []
    count = NUISANCE_COUNT
    if len(rows) != count or any(not isinstance(r, list) or len(r) != count for r in rows):
        yield f"{name}: has not {count} rows of {count} numbers"
        return
    most = MOST_TOLERANCES**2
    found = [
        problem
        for row, values in enumerate(rows)
        for column, value in enumerate(values)
        for problem in _of_number(value, -most, most, f"{name}[{row}][{column}]")
    ]
    if found:
        yield _first(found)
        return
    covariance = np.array(rows, dtype=np.float64)
    variances = np.diag(covariance)
    if wrong := np.flatnonzero(variances <= 0.0).tolist():
        row = wrong[0]
        yield f"{name}[{row}][{row}]: the variance {variances[row]:g} is not above 0"
        return
    # Rounding leaves differences of some 1e-15 of the deviations in what is learnt.
    scale = np.sqrt(np.outer(variances, variances))
    uneven = np.argwhere(np.abs(covariance - covariance.T) > 1e-9 * scale)
    if uneven.size:
        row, column = uneven[0].tolist()
        yield f"{name}[{row}][{column}]: differs from [{column}][{row}]: it is not symmetric"
        return
    try:
        np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        yield f"{name}: is not positive definite"


def _of_levels(content: object, name: str) -> Iterator[str]:
    yield from _of_keys(content, f"{name}: ", PATTERN_FILTERS, _FORMER_FILTERS)
    if not isinstance(content, dict):
        return
    for filter_name in (*PATTERN_FILTERS, *_FORMER_FILTERS):
        if filter_name not in content:
            continue
        level, at = content[filter_name], f"{name}: {filter_name}"
        yield from _of_keys(level, f"{at}: ", ("mean", "deviation", "looks"))
        if not isinstance(level, dict):
            continue
        if "mean" in level:
            yield from _of_list(level["mean"], 0.0, 2, f"{at}: mean", MOST_PRESSURE_PA)
        if "deviation" in level:
            where = f"{at}: deviation"
            yield from _of_list(level["deviation"], 0.0, 2, where, MOST_PRESSURE_PA, above=True)
        if "looks" in level:
            looks = level["looks"]
            yield from _of_number(looks, LEAST_LOOKS, MOST_LOOKS, f"{at}: looks", whole=True)


def _of_noise(content: object, name: str) -> Iterator[str]:
    """Yield what is wrong with learnt noise: keys and numbers first, then `noise_of`'s ranges."""
    found = list(_of_keys(content, f"{name}: ", _NOISE_KEYS[:3], _NOISE_KEYS))
    if isinstance(content, dict):
        regimes = content.get("regimes", {})
        for regime, fields in regimes.items() if isinstance(regimes, dict) else ():
            found += _of_keys(fields, f"{name}: regimes: {regime}: ", (), _REGIME_KEYS)
        zones, peaks = content.get("dead_zone_L_per_min", {}), content.get("peaks", {})
        found += _of_keys(zones, f"{name}: dead_zone_L_per_min: ", FAULTS)
        found += _of_keys(peaks, f"{name}: peaks: ", _PEAK_KEYS[:4], _PEAK_KEYS)
        by_regime = peaks.get("regimes", {}) if isinstance(peaks, dict) else {}
        for regime, fields in by_regime.items() if isinstance(by_regime, dict) else ():
            at = f"{name}: peaks: regimes: {regime}: "
            found += _of_keys(fields, at, ("hours", "count"))
        found += _of_leaves(content, name)
    if not found:
        try:
            noise_of(content)  # type: ignore[arg-type]
        except KeyError as error:
            found.append(f"{name}: {error.args[0]}: there is no such key in it")
        except (ValueError, TypeError, AttributeError) as error:
            found.append(str(error) if str(error).startswith("noise:") else f"{name}: wrong form")
    yield from found


def _of_leaves(content: object, name: str) -> Iterator[str]:
    """Yield what is wrong with all that stands in nested objects, which must be numbers."""
    if not isinstance(content, dict):
        yield from _of_number(content, -LARGEST, LARGEST, name)
        return
    for key, value in content.items():
        yield from _of_leaves(value, f"{name}: {key}")


def _of_accepted(content: object, name: str) -> Iterator[str]:
    yield from _of_keys(content, f"{name}: ", ("recordings", "hidden_L_per_min"))
    if not isinstance(content, dict):
        return
    if "recordings" in content:
        yield from _of_recordings(content["recordings"], f"{name}: recordings")
    hidden = content.get("hidden_L_per_min")
    if "hidden_L_per_min" in content:
        yield from _of_keys(hidden, f"{name}: hidden_L_per_min: ", LEAKS)
    if isinstance(hidden, dict):
        for leak in LEAKS:
            if leak in hidden:
                where = f"{name}: hidden_L_per_min: {leak}"
                yield from _of_number(hidden[leak], 0.0, MOST_DEAD_ZONE, where)


def _of_list(
    content: object, least: float, count: int, name: str, most: float = MOST_TOLERANCES,
    *, above: bool = False,
) -> Iterator[str]:  # fmt: skip
    """Yield one reason if a list has not so many numbers from `least` to `most`."""
    if not isinstance(content, list) or len(content) != count:
        yield f"{name}: has not {count} numbers"
        return
    found = [
        problem
        for index, value in enumerate(content)
        for problem in _of_number(value, least, most, f"{name}[{index}]", above=above)
    ]
    if found:
        yield _first(found)


def _first(found: list[str]) -> str:
    return found[0] + (f" (and {len(found) - 1} more of it)" if len(found) > 1 else "")


def _of_number(
    value: object, least: float, most: float, name: str, *, above: bool = False, whole: bool = False
) -> Iterator[str]:
    """Yield a reason if a value is no number within a range.

    Args:
        value: what the file has.
        least: the least permitted number; with `above`, the number must exceed it.
        most: the largest permitted number.
        name: the key.
        above: whether the number must be above `least`.
        whole: whether it must be a whole number.
    """
    kinds = (int,) if whole else (int, float)
    if isinstance(value, bool) or not isinstance(value, kinds):
        yield f"{name}: {_shown(value)} is no {'whole ' if whole else ''}number"
        return
    # Python compares whole numbers of any length with floats without an error.
    if isinstance(value, float) and not isfinite(value):
        yield f"{name}: {value} is not finite"
    elif not least <= value <= most or (above and value == least):
        over = f"above {least:g}, at most {most:g}" if above else f"{least:g} to {most:g}"
        yield f"{name}: {_shown(value)} is outside {over}"


def _shown(value: object) -> str:
    """Return a value for a message, cut to 40 characters."""
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) > 10**30:
        return "a number of more than 30 digits"
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."
