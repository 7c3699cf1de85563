"""Writes `results.json`, the outcome of a campaign; the key of each figure names its unit."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

from estimator.leaks import Decision, Found
from faults import to_litres_per_minute
from rig.plant import LEAKS
from rig.recording import replacing
from rig.runner.leak_test import leak_test_figures
from rig.runner.outcomes import (
    CampaignOutcome,
    InjectedFault,
    TestOutcome,
    friction_figures,
    jsonable,
    litres_per_minute,
    named,
)

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
        **named(outcome, "name", "description", "rig", "model", "filter", "false_alarms_per_day"),
        **named(outcome, "started", "exit_code", "counts"),
        "tests": [_test(test) for test in outcome.tests],
        **named(outcome, "history", "provenance"),
        **(named(outcome, "calibrations", "uncalibrated") if outcome.calibrations else {}),
    }
    return dict(jsonable(content))


def _test(test: TestOutcome) -> dict[str, Any]:
    return {
        **named(test, "name", "expect", "status", "message", "seed"),
        **named(test, "duration_s", "recorded_s", "wall_s", "recording"),
        "injected": [_fault(fault) for fault in test.injected],
        "found": None if test.decision is None else _decision(test, test.decision),
        "on_fault": {"asked": test.on_fault, "actions": test.actions},
        "onset_error_s": test.onset_error_s,
        "leak_error_L_per_min": litres_per_minute(test.leak_error_m3_per_s),
        "thresholds_from": test.thresholds_from,
        "friction": None if test.friction is None else friction_figures(test.friction),
        **named(
            test,
            "attempts",
            "figures",
            "criteria",
            "limits",
            "limits_not_judged",
            "counted",
            "segments",
            "control_changes",
        ),
        **({} if test.leak_test is None else {"leak_test": leak_test_figures(test.leak_test)}),
    }


def _fault(fault: InjectedFault) -> dict[str, Any]:
    return {
        **named(fault, "kind", "at_s", "until_s", "coefficient"),
        "coefficient_unit": _coefficient_unit(fault),
        "leak_L_per_min": litres_per_minute(fault.mean_flow_m3_per_s),
    }


def _decision(test: TestOutcome, decision: Decision) -> dict[str, Any]:
    return {
        **named(decision, "verdict", "onset_s"),
        **named(test, "detected_at_s", "latency_s"),
        **named(decision, "ended_s", "probabilities"),
        "present_leaks": dict(zip(LEAKS, decision.present_leaks, strict=True)),
        **leak_figures(decision),
        **named(decision, "statistic", "threshold", "details"),
        **returns_of(decision),
        **drift_of(decision),
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
            **named(each, "confirmed", "active"),
            "onset_s": each.decision.onset_s,
            **named(each, "detected_at_s", "ended_s"),
            **leak_figures(each.decision),
            **named(each.decision, "statistic", "threshold"),
            **returns_of(each.decision),
            **drift_of(each.decision),
        }
        for each in found
    ]


def returns_of(decision: Decision) -> dict[str, Any]:
    """Return what a decision says of a leak that comes and goes, as JSON-able values.

    `intermittent` is false for a fault that stays and for none; the other values are then null, and
    `episodes` is an empty list. Flows are in L/min, all else in SI.
    """
    found = decision.returns
    if found is None:
        return {"intermittent": False, "duty": None, "duty_interval": None, "openings": None,
                "episodes": [], "goes_with": None}  # fmt: skip
    return {
        "intermittent": True,
        "duty": found.duty,
        "duty_interval": list(found.duty_interval),
        "openings": found.openings,
        "episodes": [
            {
                **named(each, "start_s", "end_s"),
                "leak_L_per_min": to_litres_per_minute(each.flow_m3_per_s),
            }
            for each in found.episodes
        ],
        "goes_with": None if found.goes_with is None else asdict(found.goes_with),
    }


def drift_of(decision: Decision) -> dict[str, Any]:
    """Return what a decision says of an encoder that drifts, as JSON-able values.

    `could_also_be` lists the causes that the accounts do not tell from the verdict. The rate of the
    drift and its standard error are in m/s; they are null where the accounts show no drift.
    """
    drift = decision.drift
    return {
        "could_also_be": list(decision.could_also_be),
        "encoder_drift_m_per_s": None if drift is None else drift.rate_m_per_s,
        "encoder_drift_std_m_per_s": None if drift is None else drift.deviation_m_per_s,
    }


def leak_figures(decision: Decision) -> dict[str, Any]:
    """Return the mean flow of a decision's leak, and its coefficient, as JSON-able values.

    Flow, standard error and 95 % interval are in L/min, the coefficient is in SI; None where the
    decision has no value. Of a leak that grows there is its flow now (L/min) and the rate at which
    it grows or grew (L/min in a minute), with their standard errors; the flow from which it grew
    (L/min), within how many seconds, and whether it grows on. Else these are None.
    """
    interval, growth = decision.interval_m3_per_s, decision.growth
    return {
        "leak_L_per_min": litres_per_minute(decision.leak_m3_per_s),
        "leak_std_L_per_min": litres_per_minute(decision.leak_std_m3_per_s),
        "interval_L_per_min": None if interval is None else [*map(to_litres_per_minute, interval)],
        "leak_coefficient": decision.coefficient,
        "leak_now_L_per_min": growth and to_litres_per_minute(growth.now_m3_per_s),
        "leak_now_std_L_per_min": growth and to_litres_per_minute(growth.now_std_m3_per_s),
        "growth_L_per_min_per_min": growth and to_litres_per_minute(60.0 * growth.rate_m3_per_s2),
        "growth_std_L_per_min_per_min": growth
        and to_litres_per_minute(60.0 * growth.rate_std_m3_per_s2),
        "grew_from_L_per_min": growth and to_litres_per_minute(growth.from_m3_per_s),
        "grew_within_s": growth and growth.seconds,
        "grows_on": growth and growth.grows_on,
    }


def _coefficient_unit(fault: InjectedFault) -> str:
    """Return the SI unit of a fault's coefficient, which depends on kind and leak law."""
    if fault.kind == "return_blockage":
        return "Pa/(m^3/s)^2"
    return "m^3/(s Pa)" if fault.linear else "m^3/(s Pa^0.5)"
