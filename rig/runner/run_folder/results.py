"""Writes `results.json`, the outcome of a campaign; the key of each figure names its unit."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import Any, Final

from estimator.leaks import Decision, Found
from faults import to_litres_per_minute
from rig.plant import LEAKS
from rig.recording import replacing
from rig.runner.outcomes import CampaignOutcome, InjectedFault, TestOutcome, friction_figures

from .directory import SCHEMA

SCHEMA_VERSION: Final = 1


def write_results(outcome: CampaignOutcome, path: Path) -> None:
    """Write the outcome of a campaign so far as `results.json`, replacing the file in one step."""
    text = json.dumps(results(outcome), indent=1, allow_nan=False, ensure_ascii=False)
    with replacing(path) as partial:
        partial.write_text(text + "\n", encoding="utf-8")


def results(outcome: CampaignOutcome) -> dict[str, Any]:
    """Return the outcome of a campaign as JSON-able values; NaN and infinity become None."""
    content = {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "name": outcome.name,
        "description": outcome.description,
        "rig": outcome.rig,
        "model": outcome.model,
        "filter": outcome.filter,
        "false_alarms_per_day": outcome.false_alarms_per_day,
        "started": outcome.started,
        "exit_code": outcome.exit_code,
        "counts": {str(status): count for status, count in outcome.counts.items()},
        "tests": [_test(test) for test in outcome.tests],
        "history": [asdict(each) for each in outcome.history],
        "provenance": outcome.provenance,
    }
    return dict(_finite(content))


def _test(test: TestOutcome) -> dict[str, Any]:
    return {
        "name": test.name,
        "expect": str(test.expect),
        "status": str(test.status),
        "message": test.message,
        "seed": test.seed,
        "duration_s": test.duration_s,
        "recorded_s": test.recorded_s,
        "wall_s": test.wall_s,
        "recording": test.recording,
        "injected": [_fault(fault) for fault in test.injected],
        "found": None if test.decision is None else _decision(test, test.decision),
        "on_fault": {
            "asked": str(test.on_fault),
            "actions": [asdict(each) for each in test.actions],
        },
        "onset_error_s": test.onset_error_s,
        "leak_error_L_per_min": litres_per_minute(test.leak_error_m3_per_s),
        "thresholds_from": test.thresholds_from,
        "friction": None if test.friction is None else friction_figures(test.friction),
        "attempts": [asdict(each) for each in test.attempts],
        "figures": {name: asdict(figure) for name, figure in test.figures.items()},
    }


def _fault(fault: InjectedFault) -> dict[str, Any]:
    return {
        "kind": fault.kind,
        "at_s": fault.at_s,
        "until_s": fault.until_s,
        "coefficient": fault.coefficient,
        "coefficient_unit": coefficient_unit(fault),
        "leak_L_per_min": litres_per_minute(fault.mean_flow_m3_per_s),
    }


def _decision(test: TestOutcome, decision: Decision) -> dict[str, Any]:
    return {
        "verdict": str(decision.verdict),
        "onset_s": decision.onset_s,
        "detected_at_s": test.detected_at_s,
        "latency_s": test.latency_s,
        "ended_s": decision.ended_s,
        "probabilities": decision.probabilities,
        "present_leaks": dict(zip(LEAKS, decision.present_leaks, strict=True)),
        **leak_figures(decision),
        "statistic": decision.statistic,
        "threshold": decision.threshold,
        "details": decision.details,
        "findings": findings(test.found),
    }


def findings(found: Sequence[Found]) -> list[dict[str, Any]]:
    """Return the faults that were found as JSON-able values, with times and sizes, in their order.

    Args:
        found: all faults that the verdicts named, in the order in which they were first named.
    """
    return [
        {
            "verdict": str(each.decision.verdict),
            "confirmed": each.confirmed,
            "active": each.active,
            "onset_s": each.decision.onset_s,
            "detected_at_s": each.detected_at_s,
            "ended_s": each.ended_s,
            **leak_figures(each.decision),
            "statistic": each.decision.statistic,
            "threshold": each.decision.threshold,
        }
        for each in found
    ]


def leak_figures(decision: Decision) -> dict[str, Any]:
    """Return the mean flow of a decision's leak, and its coefficient, as JSON-able values.

    Flow, standard error and 95 % interval are in L/min, the coefficient is in SI; None where the
    decision has no value.
    """
    interval = decision.interval_m3_per_s
    return {
        "leak_L_per_min": litres_per_minute(decision.leak_m3_per_s),
        "leak_std_L_per_min": litres_per_minute(decision.leak_std_m3_per_s),
        "interval_L_per_min": None if interval is None else [*map(to_litres_per_minute, interval)],
        "leak_coefficient": decision.coefficient,
    }


def litres_per_minute(flow: float | None) -> float | None:
    """Return a flow in L/min that is given in m^3/s; None if it is None."""
    return None if flow is None else to_litres_per_minute(flow)


def coefficient_unit(fault: InjectedFault) -> str:
    """Return the SI unit of a fault's coefficient, which depends on kind and leak law."""
    if fault.kind == "return_blockage":
        return "Pa/(m^3/s)^2"
    return "m^3/(s Pa)" if fault.linear else "m^3/(s Pa^0.5)"


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, float):
        return float(value) if isfinite(value) else None
    return value
