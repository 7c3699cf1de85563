"""The times within which the devices must be safe, of which docs/safety.md has a table.

Times within which the valve must be at null after a single fault are claimed by `SCENARIOS` (in
brackets in the table of chaos); those of faults that only the grammar draws stand here, together
with what may pass until bypass valves and pump unit follow.
"""

from typing import Final, NamedTuple


class Bound(NamedTuple):
    """A time that is claimed, ms, and in words what it consists of."""

    ms: float
    why: str


FOREIGN_MASTER: Final = Bound(
    100.0,
    "the node's count of refusals comes with the next sample: 20 ms as for any sample, and 80 ms "
    "for a slow machine, as the other master is a process of its own",
)
FOLDER_REMOVED: Final = Bound(
    1500.0, "a look every 0.25 s, a ramp of 0.5 s, and 0.75 s to copy what is held open"
)
ORDINARY: Final = Bound(
    200.0,
    "supervisor and field process have no real-time priority: what they must notice may take so "
    "much longer than is claimed while the machine has other work",
)
TURNING: Final = Bound(
    220.0,
    "a frozen encoder shows by the travel beyond 0.1 m/s, of which 5 mm must have summed: where "
    "the ram turns, in a sine of 0.15 m and 0.5 Hz, that takes 0.13 s and 0.09 s",
)
BYPASS_AFTER_NULL: Final = Bound(
    1500.0,
    "the loop's silence of 0.5 s, at most, until the field process acts; 0.2 s until null is "
    "confirmed or given up; 0.5 s of travel; 0.3 s for looks at 20 Hz and a slow machine",
)
PUMP_AFTER_NULL: Final = Bound(
    2000.0, "the bypass valves come first; then 0.5 s for the unit's frames and its valve"
)
BYPASS_BY_WATCHDOG: Final = Bound(
    2500.0, "1 s of the device's own watchdog, or as long for a connection to be given up, more"
)
PUMP_BY_WATCHDOG: Final = Bound(3000.0, "1 s of the unit's own watchdog more")
END_S: Final = Bound(
    70e3,
    "the supervisor gives up cleaning after 60 s, whatever hangs, and tells of that "
    "for 10 s at most",
)
LEFT_S: Final = Bound(20e3, "processes end after the run itself, each within its join's patience")
DATA: Final = Bound(1500.0, "the recorder writes to disk each second; 0.5 s for a slow machine")

TABLE: Final = {
    "valve at null after another master's write or claim": FOREIGN_MASTER,
    "valve at null after the run's folder was removed": FOLDER_REMOVED,
    "more, for an encoder that freezes where the ram turns": TURNING,
    "more, for what supervisor or field process must notice": ORDINARY,
    "bypass valves shut after the valve's null": BYPASS_AFTER_NULL,
    "pump unloaded after the valve's null": PUMP_AFTER_NULL,
    "bypass valves shut where their field process, wires or supervisor failed": BYPASS_BY_WATCHDOG,
    "pump unloaded where they failed": PUMP_BY_WATCHDOG,
    "end of the run after the last fault": END_S,
    "end of its processes after the run": LEFT_S,
    "end of the recording that may be missing at the first fault": DATA,
}
"""What is claimed, by the name that it has in docs/safety.md."""
