"""Writes into a rig file what commissioning found of the rig."""

from dataclasses import replace
from datetime import datetime
from pathlib import Path

from rig.configuration import (
    Rig,
    rewrite_rig,
    wiring_lines,
    with_control,
    with_section,
    with_values,
)
from rig.plant import SensorParameters

from .findings import Changes


def write_rig_file(
    file: Path, out: Path | None, rig: Rig, changes: Changes, begun: datetime
) -> list[str]:
    """Write the changes into a rig file, or to a new one; return what was written, in lines.

    All other lines stay, comments too. A section that the file inherits from its parent is copied
    into it before a value in it is changed.

    Args:
        file: the rig file.
        out: the new file; None to replace `file`, of which a backup is kept.
        rig: the rig as `file` describes it.
        changes: what was found; something must have changed.
        begun: when commissioning began, UTC.

    Raises:
        ConfigError: the written file is unusable; the old one is in place again.
        NotAsMeantError: it describes another rig; as before.
        OSError: a file cannot be written.
    """
    remark = f"by rig commission, {begun:%Y-%m-%d %H:%M} UTC"
    text = file.read_text(encoding="utf-8")
    meant = changes.applied(rig)
    values: dict[tuple[str, ...], str] = {}
    if changes.position_max is not None:
        limits = meant.limits
        values["limits", "position"] = (
            f"[{limits.position_min_m:.12g} m, {limits.position_max_m:.12g} m]"
        )
    if changes.stroke_max is not None:
        values["plant", "parameters", "stroke_max"] = f"{changes.stroke_max:.12g} m"
    units = SensorParameters.__annotations__
    for key, value in (changes.noises or {}).items():
        unit = units[key].__metadata__[0].unit
        values["sensors", key] = f"{value:.12g} {unit}"
    text = with_values(text, file, values, f"as in the parent, {remark}")
    if changes.wiring is not None:
        text = with_section(text, "wiring", list(wiring_lines(changes.wiring, remark)), "by rig ")
    if changes.null_V is not None:
        text = with_control(text, meant.control, remark)

    def is_meant(written: Rig) -> bool:
        # The ladder follows from limits and stroke.
        return written == replace(meant, name=written.name, ladder=written.ladder)

    return rewrite_rig(file, out, text, is_meant, begun)
