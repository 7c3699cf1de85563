"""Compares what the detector finds under both laws in a run of leaks.yaml."""

import json
import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

_NAME = re.compile(r"(\w+?)(?: ([\d.]+))?, (\w+) (\d+)$")


@dataclass
class Found:
    """What the detector found of one leak under one law, over its repeats.

    Attributes:
        right: number of tests with the expected verdict.
        tests: number of tests.
        latencies_s: time from onset to the confirmed verdict where there is one, s.
        sizes: mean flow that was found, L/min.
    """

    right: int = 0
    tests: int = 0
    latencies_s: list[float] = field(default_factory=list)
    sizes: list[float] = field(default_factory=list)


def table(run_folder: Path) -> Iterator[str]:
    """Yield the lines of the table in Markdown, from the results of a run of leaks.yaml."""
    results = json.loads((run_folder / "results.json").read_text())
    found: dict[tuple[str, str], dict[str, Found]] = defaultdict(lambda: defaultdict(Found))
    for test in results["tests"]:
        match = _NAME.fullmatch(test["name"])
        if match is None:
            continue
        place, level, law, _ = match.groups()
        each = found[place, level or "-"][law]
        each.tests += 1
        each.right += test["status"] == "passed"
        verdict = test.get("found") or {}
        if verdict.get("latency_s") is not None:
            each.latencies_s.append(verdict["latency_s"])
        size = verdict.get("leak_L_per_min")
        if size is not None and place != "healthy":
            each.sizes.append(size)
    yield "| leak | L/min | law | right | named after, s | size found, L/min |"
    yield "|---|--:|---|--:|--:|--:|"
    for (place, level), laws in found.items():
        for law, each in laws.items():
            shown = f"{np.mean(each.sizes):.3f} ± {np.std(each.sizes):.3f}" if each.sizes else ""
            late = f"{np.median(each.latencies_s):.1f}" if each.latencies_s else ""
            right = f"{each.right} of {each.tests}"
            yield f"| {place} | {level} | {law} | {right} | {late} | {shown} |"
