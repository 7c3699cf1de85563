"""What a leak test asks of a rig."""

from typing import Protocol

from rig.plant import Reading


class Lockable(Protocol):
    """A rig whose blocking valves, servovalve and transducers a leak test uses."""

    @property
    def time_s(self) -> float:
        """Time since the rig was taken over, s."""

    def exchange(self, command_V: float) -> Reading:  # noqa: N803
        """Set the servovalve's command, wait for one sample period, and return a sample."""

    @property
    def arrived(self) -> bool:
        """Whether both blocking valves are known to be where they were sent."""

    def block(self, chamber_1: bool, chamber_2: bool) -> None:
        """Order the blocking valves to shut (true) or to open; they need time to move.

        A valve opens, and the first one shuts, with the servovalve at null only.
        """

    def release(self) -> None:
        """Bring the rig to its safe state: servovalve at null, then both blocking valves open.

        Open is safe here: a locked chamber that warms up gains 0.5 MPa/K, 10 MPa from 20 K, and no
        unloaded pump relieves it; whoever opens a line would not know. The servovalve at null holds
        a ram that nothing pushes.
        """
