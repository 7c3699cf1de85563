"""Plays the scenarios of the chaos suite, and writes their table into docs/safety.md.

Run as `python -m tools.chaos [TEXT ...]`. With texts, only the scenarios whose names contain one of
the texts are played, and no table is written.
"""

import re
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

from tools.pages.safety import PAGE

from .judge import Outcome, problems
from .play import play
from .scenario import Scenario
from .scenarios import SCENARIOS
from .signals import end_by_signals
from .stage import StageError

_TABLE: Final = re.compile(r"(<!-- table of chaos -->\n).*?(<!-- end -->)", re.DOTALL)
_COLUMNS: Final = (
    "what fails",
    "first-out cause",
    "valve null after (claimed: within)",
    "bypass shut after",
    "pump unloaded after",
    "data lost",
    "exit code",
)


def main(wanted: list[str]) -> int:
    """Play scenarios, print the outcome of each, and return how many did not end as claimed.

    A scenario that could not be played counts as one of these.

    Args:
        wanted: texts, one of which a scenario's name must contain; empty plays all scenarios. The
            table is written only if all were played and ended as claimed.
    """
    end_by_signals()
    chosen = [s for s in SCENARIOS if not wanted or any(text in s.name for text in wanted)]
    played, failures = [], 0
    for number, scenario in enumerate(chosen, 1):
        print(f"[{number}/{len(chosen)}] {scenario.name} ... ", end="", flush=True)
        with tempfile.TemporaryDirectory(prefix="rig-chaos-") as folder:
            try:
                outcome = play(scenario, Path(folder))
            except StageError as error:
                print(f"FAILED: {error}")
                failures += 1
                continue
            found = problems(scenario, outcome)
        played.append((scenario, outcome))
        print(f"{row(scenario, outcome)} {'FAILED: ' + '; '.join(found) if found else ''}")
        if found:
            print(outcome.printed, outcome.report)
        failures += bool(found)
    print(f"{len(chosen) - failures} of {len(chosen)} as claimed")
    if not wanted and not failures:
        PAGE.write_text(with_table(PAGE.read_text(), table(played)))
    return failures


def with_table(page: str, lines: Iterable[str]) -> str:
    """Return the text of `page` with `lines` as the chaos suite's table, if it has such a table."""
    text = "\n".join(lines)
    return _TABLE.sub(lambda match: f"{match[1]}{text}\n{match[2]}", page)


def table(played: Iterable[tuple[Scenario, Outcome]]) -> Iterator[str]:
    """Yield the lines of the table in Markdown: two for its head, and one for each scenario."""
    yield f"| {' | '.join(_COLUMNS)} |"
    yield "|---" * len(_COLUMNS) + "|"
    for scenario, outcome in played:
        yield row(scenario, outcome)


def row(scenario: Scenario, outcome: Outcome) -> str:
    """Return the line of the table, in Markdown, that states the outcome of a scenario.

    Where no trip is claimed, the times of the devices are left empty.
    """
    lost = "all" if outcome.lost_s is None else f"{outcome.lost_s:.1f} s"
    if not scenario.causes:
        return f"| {scenario.name} | none: the run goes on | | | | {lost} | {outcome.exit_code} |"
    named = outcome.cause or "nobody is left to tell"
    cause = f"`{named}`" if named.isupper() else named
    valve, bypass, pump = (_milliseconds(at_s) for at_s in outcome.times.values())
    if scenario.null_ms is not None:
        valve += f" ({scenario.null_ms:g})"
    cells = (scenario.name, cause, valve, bypass, pump, lost, str(outcome.exit_code))
    return f"| {' | '.join(cells)} |"


def _milliseconds(seconds: float | None) -> str:
    return "not seen" if seconds is None else f"{1e3 * seconds:.0f} ms"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
