"""What commissioning found, and what follows from it for the rig file."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

from rig.configuration import Rig
from rig.io import Wiring

Found = Literal["as in the file", "changed", "new", "not found"]

SCHEMA: Final = "rig-commissioning"
"""Value of the key `schema`, by which `commissioning.json` is recognized."""


@dataclass(frozen=True)
class Finding:
    """One thing that commissioning looked for.

    Attributes:
        subject: what it is.
        found: what was found, in words; empty if it was not.
        before: what the rig file says of it, in words; empty if it says nothing.
        standing: how what was found stands to the file.
        remark: what a reader should know besides; for what was not found, why, and the remedy.
    """

    subject: str
    found: str
    before: str
    standing: Found
    remark: str = ""


@dataclass(frozen=True)
class Changes:
    """What is changed in a rig file; None, or empty, is what stays.

    Attributes:
        wiring: the whole wiring.
        null_V: the `null` of the section `control`, V.
        noises: key of the section `sensors` -> noise, SI.
        stroke_max: the parameter of the plant, m.
        position_max: upper limit of the position, m.
    """

    wiring: Wiring | None = None
    null_V: float | None = None  # noqa: N815
    noises: Mapping[str, float] | None = None
    stroke_max: float | None = None
    position_max: float | None = None

    @property
    def any(self) -> bool:
        """Whether anything is changed."""
        return self != Changes()

    def applied(self, rig: Rig) -> Rig:
        """Return the rig as its file will describe it."""
        if self.wiring is not None:
            rig = replace(rig, wiring=self.wiring)
        if self.null_V is not None:
            rig = replace(rig, control=replace(rig.control, null=self.null_V))
        if self.noises:
            rig = replace(rig, sensors=rig.sensors._replace(**self.noises))
        if self.stroke_max is not None:
            par = rig.plant.parameters._replace(stroke_max=self.stroke_max)
            rig = replace(rig, plant=replace(rig.plant, parameters=par))
        if self.position_max is not None:
            limits = replace(rig.limits, position_max_m=self.position_max)
            rig = replace(rig, limits=limits)
        return rig


def findings_figures(findings: list[Finding]) -> list[dict[str, Any]]:
    """Return the findings as JSON-able values; other programs rely on the keys."""
    return [dict(vars(each)) for each in findings]
