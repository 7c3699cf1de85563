"""The keys that every motion of a sweep may have, whatever its setpoint."""

from typing import Annotated, Any, Final

from control import ControlSettings
from rig.configuration.campaigns import CriterionFile, TestLimitFile
from rig.configuration.reading import Name, Physical, Schema, Under, options_schema
from rig.configuration.rigs import GAIN

from .distributions import Random


class EveryMotionFile(Schema):
    """Keys that every motion of a sweep may have."""

    name: Name | None = None
    share: Annotated[float, Physical("", 1e-6, 1e6, 1.0)] = 1.0
    control: Annotated[Any, Under(lambda: (options_schema(ControlSettings),))] = None
    position_gain: Annotated[Any, Random(GAIN)] = None
    criteria: Annotated[Any, Under(lambda: (CriterionFile,), many=True)] = None
    limits: Annotated[Any, Under(lambda: (TestLimitFile,), many=True)] = None


HINTS: Final = {
    key: f"every case lasts as long as the sweep's `duration`; give {key} to a segment: "
    f"`segments: [{{setpoint: ..., {example}}}]`"
    for key, example in (("cycles", "cycles: 20"), ("duration", "duration: 10 s"))
} | {
    "loop": "loop segments: `segments: [{loop: 3, segments: [...]}]`",
    "hold": "give it to a segment: `segments: [..., {hold: 5 s}]`",
    "blend": "give it to a segment: `segments: [..., {setpoint: ..., blend: 2 s}]`",
    "until": "a case lasts to the end of the sweep's `duration`; run it as a campaign",
    "wait_for": "nothing comes to wait for in a simulated case; run it as a campaign",
    "faults": "give the leaks of all cases under `leaks` of the sweep",
    "load": "give a spring to all cases under `effects`: `spring_load: {stiffness: 2e4 N/m}`",
    "control_changes": "a case has one control; give the motion twice, with two controls",
    "figures": "give figures of your own under `figures` of the sweep",
}
"""Keys of a campaign's test that a motion does not have -> where such a thing is given."""
