"""Where the emulated devices are served, and what to say when an address is taken."""

import errno
from typing import Final, NamedTuple

DAQ_PORT: Final = 15502


class AddressError(ValueError):
    """An address that cannot be served on; bad input, as `problems` says to the command line."""

    def __init__(self, device: str, host: str, port: int, error: OSError) -> None:
        if error.errno == errno.EADDRINUSE:
            state = "in use"
            remedy = "end the program that has it (ss -ltnp shows it), or --set-port"
            remedy = f"{remedy} {device}=PORT (0: any free one)"
        else:
            state = f"not to be had ({error.strerror or error})"
            remedy = f"give an address of this machine, or --set-port {device}=PORT"
        super().__init__(f"{device}: port {port} of {host} is {state}; {remedy}")
        self.problems = (str(self),)


class Address(NamedTuple):
    """A TCP address."""

    host: str
    port: int
