"""What `rig gap` says on the terminal: the finding in lines, and a table of what was fitted."""

from collections.abc import Iterator

from rich import box
from rich.table import Table
from rich.text import Text

from estimator.gap import GapResult
from rig.report.gap import estimated, gap_words, headline, in_words, where_words

_STYLES = {"adequate": "green", "missing_effect": "red", "unknown_effect": "red"}


def gap_lines(result: GapResult) -> Iterator[Text | str]:
    """Yield the finding in words."""
    yield Text(f"{result.verdict}: {headline(result)}", _STYLES.get(result.verdict, "yellow"))
    yield from result.reasons
    for line in where_words(result.where):
        yield f"where: {line}"
    yield gap_words(result)
    for experiment in result.experiments[:1]:
        apart = " and ".join(map(in_words, experiment.effects))
        if experiment.campaign:
            sure = f"predicted z {experiment.z:.0f}"
            yield f"to tell {apart} apart: {experiment.motion} ({sure})"
        else:
            yield f"{apart} cannot be told apart: {experiment.motion}"


def gap_table(result: GapResult, *, plain: bool) -> Table:
    """Return a table of effects and nuisances; `plain` draws it with ASCII."""
    table = Table(box=box.ASCII2 if plain else box.ROUNDED)
    for heading in ("", "name", "value, 95 % interval", "was", "evidence", "may as well be"):
        table.add_column(heading, overflow="fold")
    for effect in result.effects:
        others = ", ".join(rival.effect for rival in effect.indistinguishable)
        for each in effect.parameters:
            name = effect.name if each.key == "value" else f"{effect.name}.{each.key}"
            table.add_row(
                "missing", Text(name, "bold"), estimated(each), f"{each.before:.4g}",
                f"z = {effect.z:.1f}", others,
            )  # fmt: skip
    for each in result.refitted:
        how = "refitted" if not result.as_given else "refitted, not kept"
        end = "at the end of its tolerance" if each.at_an_end else ""
        table.add_row(how, each.key, estimated(each), f"{each.before:.4g}", end, "")
    return table
