"""A report of `rig check` as JSON values, for the operator's page and for other programs."""

from math import isfinite
from typing import TYPE_CHECKING, Any

from .campaigns import PlannedTest, limit_in_words

if TYPE_CHECKING:
    from .checking import CheckReport


def report_content(report: "CheckReport") -> dict[str, Any]:
    """Return a report as JSON values.

    Its keys are `kind`, `path`, `name`, `summary` (lines of text), `warnings`, `rig` (for a
    campaign: the lines that describe its rig with all its limits), `tests`, and `text`, all of what
    `rig check` prints. Quantities are in SI units, as their keys say.
    """
    return {
        "kind": report.kind,
        "path": str(report.path),
        "name": report.name,
        "summary": [line.strip() for line in report.summary],
        "rig": [line.strip() for line in report.rig],
        "tests": [_test(each) for each in report.tests],
        "warnings": list(report.warnings),
        "text": str(report),
    }


def _test(plan: PlannedTest) -> dict[str, Any]:
    """Return the plan of a test; a speed that is not finite, that of a jump, is None."""
    test, speed = plan.test, plan.peak_speed_m_per_s
    return {
        "name": test.name,
        "duration_s": test.duration_s,
        "settle_s": test.settle_s,
        "position_m": list(plan.position_range_m),
        "command_V": None if plan.command_range_V is None else list(plan.command_range_V),
        "peak_speed_m_per_s": speed if isfinite(speed) else None,
        "valve_speed_m_per_s": plan.valve_speed_m_per_s,
        "following": None if plan.following is None else str(plan.following),
        "expect": str(test.expect),
        "faults": [str(fault) for fault in plan.faults],
        "leak_test": [line.strip() for line in plan.leak_test],
        "limits": [limit_in_words(limit) for limit in test.limits],
        "warnings": list(plan.warnings),
    }
