"""The options of a digital servovalve in a rig file."""

from dataclasses import dataclass
from typing import Annotated, Literal

from rig.plant import NOMINAL, Quantity as _Quantity

from .link import CanOptions


@dataclass(frozen=True, kw_only=True)
class CanValveOptions(CanOptions):
    """Keys of the driver in a rig file, besides those of its bus.

    Attributes:
        node: the valve's CANopen node id.
        setpoint: where its setpoint comes from: the valve's analog input or the bus.
        full_stroke: travel of the spool at 100 %.
        open_timeout: how long `open` waits for the valve's heartbeat, and then for its status.
        step_timeout: how long one transition of its state may take, and `safe_state` as a whole.
        watchdog: silence of this host at which the valve goes to a fault; 0 for never. It should be
            longer than the rig file's `field_silence`, so that a trip names the silent process.
    """

    node: Annotated[int, _Quantity("", 1, 126, "", "CiA 301; 127 is this host")] = 5
    setpoint: Literal["analog", "bus"] = "analog"
    full_stroke: Annotated[float, _Quantity("m", 1e-5, 1e-2, "", "10 V of table 2.1")] = (
        10.0 * NOMINAL.valve_gain
    )
    open_timeout: Annotated[float, _Quantity("s", 0.1, 60.0, "", "")] = 3.0
    step_timeout: Annotated[float, _Quantity("s", 0.05, 60.0, "", "")] = 1.0
    watchdog: Annotated[float, _Quantity("s", 0.0, 60.0, "", "")] = 2.0
