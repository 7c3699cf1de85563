"""Baselines as JSON: in the files that `rig baseline` writes and in the metadata of recordings."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from estimator.accounts import NUISANCES, NuisanceBelief, checked_model_error
from estimator.leaks import HealthyLevel
from estimator.learnt import noise_content, noise_of
from rig.plant import LEAKS, Model, model_sha256
from rig.recording import LARGEST_JSON, read_bounded
from rig.unique_keys import RepeatedLineError, json_of

from .baseline import PATTERN_FILTERS, Accepted, Baseline, BaselineError
from .checking import CHECKSUM, READ_VERSIONS, VERSION, checksum_of, problems_of

_NAMES: Final = [nuisance.name for nuisance in NUISANCES]


def content_of(baseline: Baseline) -> dict[str, Any]:
    """Return a baseline as plain values for JSON, from which `baseline_of` makes it again.

    The nuisances are in it twice: in SI units for people who read the file, and in units of their
    tolerances, with the whole covariance, for `baseline_of`.
    """
    belief = baseline.nuisances
    deviations = np.sqrt(np.diag(belief.covariance))
    return {
        "baseline_version": VERSION,
        "model": baseline.model,
        "model_sha256": baseline.model_hash,
        "model_error": baseline.model_error,
        "recordings": dict(baseline.recordings),
        "nuisances": {
            nuisance.name: {
                "unit": nuisance.unit,
                "value": nuisance.sigma * float(mean),
                "deviation": nuisance.sigma * float(deviation),
            }
            for nuisance, mean, deviation in zip(NUISANCES, belief.mean, deviations, strict=True)
        },
        "tolerance_mean": belief.mean.tolist(),
        "tolerance_covariance": belief.covariance.tolist(),
        "innovation_levels_Pa": {
            name: {
                "mean": level.mean.tolist(),
                "deviation": level.deviation.tolist(),
                "looks": level.looks,
            }
            for name, level in baseline.levels.items()
        },
        "noise": None if baseline.noise is None else noise_content(baseline.noise),
        "commissioning": None
        if baseline.commissioning is None
        else content_of(baseline.commissioning),
        "accepted": [
            {
                "recordings": dict(each.recordings),
                "hidden_L_per_min": dict(zip(LEAKS, each.hidden, strict=True)),
            }
            for each in baseline.accepted
        ],
    }


def baseline_of(content: Mapping[str, Any]) -> Baseline:
    """Return the baseline whose plain values `content_of` made; this undoes `content_of`.

    Raises:
        ValueError, KeyError, TypeError, AttributeError, numpy.linalg.LinAlgError: the content is
            not a baseline of this version.
    """
    if content["baseline_version"] not in READ_VERSIONS:
        known = " or ".join(map(str, READ_VERSIONS))
        raise ValueError(f"its version is {content['baseline_version']}, not {known}")
    if list(content["nuisances"]) != _NAMES:
        raise ValueError("it tells of other weaknesses of the model than this version knows")
    count = len(NUISANCES)
    belief = NuisanceBelief(
        np.array(content["tolerance_mean"], dtype=np.float64).reshape(count),
        np.array(content["tolerance_covariance"], dtype=np.float64).reshape(count, count),
    )
    np.linalg.cholesky(belief.covariance)
    stored = content["innovation_levels_Pa"]
    if not set(PATTERN_FILTERS) <= set(stored):
        raise ValueError(f"it has levels of {sorted(stored)}, not {list(PATTERN_FILTERS)}")
    # Files of earlier versions also have the level of a filter that no longer exists.
    levels = {name: _level_of(stored[name]) for name in PATTERN_FILTERS}
    # Files that are older than this setting lack it.
    model_error = checked_model_error(float(content.get("model_error", 1.0)))
    recordings = dict(content["recordings"])
    # So do files from before the noise was learnt.
    noise, first = content.get("noise"), content.get("commissioning")
    return Baseline(
        belief, levels, recordings, str(content["model"]), model_error,
        str(content.get("model_sha256", "")),
        None if noise is None else noise_of(noise),
        None if first is None else baseline_of(first),
        tuple(_accepted_of(each) for each in content.get("accepted", ())),
    )  # fmt: skip


def _accepted_of(content: Mapping[str, Any]) -> Accepted:
    hidden = content["hidden_L_per_min"]
    return Accepted(dict(content["recordings"]), tuple(float(hidden[leak]) for leak in LEAKS))


def _level_of(content: Mapping[str, Any]) -> HealthyLevel:
    return HealthyLevel(
        np.array(content["mean"], dtype=np.float64).reshape(2),
        np.array(content["deviation"], dtype=np.float64).reshape(2),
        int(content["looks"]),
    )


def write_baseline(baseline: Baseline, path: Path) -> None:
    """Write a baseline to a JSON file; if writing fails, an existing file stays as it was.

    The file has a checksum of its content beside what `content_of` returns.

    Raises:
        OSError: the file cannot be written.
        ValueError: a number of the baseline is NaN or infinite.
    """
    content = content_of(baseline)
    content[CHECKSUM] = checksum_of(content)
    text = json.dumps(content, indent=1, allow_nan=False)
    partial = path.with_name(path.name + ".partial")
    partial.write_text(text + "\n", encoding="utf-8")
    partial.replace(path)


def load_baseline(path: Path, model: Model) -> Baseline:
    """Return the baseline from a file that `write_baseline` wrote.

    A file from before there were checksums is read, and the baseline is `unverified`.

    Args:
        path: path of the JSON file.
        model: the model with which the baseline is to be used.

    Raises:
        BaselineError: the file cannot be read, is not a baseline of a version that is read, was
            changed after it was written (its checksum is wrong or was taken out), has a wrong
            number, unit or key (all of them are named), or was learnt with another model: one of
            another name, or, where the file has a hash, another hash.
    """
    try:
        content = json_of(read_bounded(path, LARGEST_JSON))
        if problems := problems_of(content):
            raise BaselineError([_none(path, problem) for problem in problems])
        baseline = replace(baseline_of(content), unverified=CHECKSUM not in content)
    except BaselineError:
        raise
    except RepeatedLineError as error:
        raise BaselineError([error.at(path)]) from None
    except RecursionError:
        raise BaselineError([_none(path, "its values are nested too deeply")]) from None
    except OSError as error:
        raise BaselineError([f"{path}: {error.strerror}; make one with rig baseline"]) from None
    except KeyError as error:
        raise BaselineError([_none(path, f"there is no {error} in it")]) from None
    except (ValueError, TypeError, AttributeError, ArithmeticError) as error:
        raise BaselineError([_none(path, str(error))]) from None
    remedy = f"make it anew with rig baseline --model {model.name}"
    if baseline.model != model.name:
        raise BaselineError(
            [f"{path}: learnt beside the model {baseline.model}, not {model.name}; {remedy}"]
        )
    found = model_sha256(model)
    if baseline.model_hash and baseline.model_hash != found:
        raise BaselineError(
            [
                f"{path}: model_sha256: {baseline.model_hash[:12]}: learnt beside the model "
                f"{model.name} when it was another one (it has {found[:12]} now); {remedy}"
            ]
        )
    return baseline


def baseline_doubt(path: str | Path, baseline: Baseline) -> str:
    """Return a sentence on what cannot be checked of a baseline's file; "" if all was checked."""
    if not baseline.unverified:
        return ""
    return (
        f"{path}: has no checksum, as it is from before there was one: whether it was changed "
        "after it was written cannot be checked; make it anew with rig baseline, which writes one"
    )


def _none(path: Path, reason: str) -> str:
    return f"{path}: not a baseline: {reason}; make it anew with rig baseline"
