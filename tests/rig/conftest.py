"""Fixtures that install drivers of third parties for one test, or spare it a real-time process."""

import gc
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from textwrap import dedent

import pytest

from rig.io import registry
from rig.loop import realtime

Install = Callable[..., Path]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Yield a function that installs a package of one module, with drivers as its entry points.

    The function takes the package's name, its source, and by type of driver the class in it. It
    returns the folder in which the package is installed.
    """
    site = tmp_path / "site-packages"
    site.mkdir()
    monkeypatch.syspath_prepend(str(site))

    def install(package: str, source: str, **drivers: str) -> Path:
        monkeypatch.delitem(sys.modules, package, raising=False)
        (site / f"{package}.py").write_text(dedent(source))
        about = site / f"{package}-1.0.dist-info"
        about.mkdir()
        (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
        lines = [f"{name} = {package}:{target}" for name, target in drivers.items()]
        (about / "entry_points.txt").write_text("\n".join(["[hydraulic_rig.drivers]", *lines]))
        registry._installed.cache_clear()
        return site

    yield install
    registry._installed.cache_clear()


@pytest.fixture
def plain_drivers(install: Install) -> None:
    """Install two drivers without a device, `plain_fast` and `plain_slow`.

    Their options state their signals and their rate.
    """
    install("plain_drivers", PLAIN_DRIVERS, plain_fast="Fast", plain_slow="Slow")


PLAIN_DRIVERS = '''
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from rig.io.driver import DriverError
from rig.io.modbus_daq.register_map import RegisterMap
from rig.plant.parameters import Quantity


@dataclass(frozen=True)
class Addresses:
    first: int = 0
    last: int = 9


@dataclass(frozen=True)
class Options:
    """Keys of a driver that reads and writes whatever it is told to."""

    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    rate: Annotated[float, Quantity("Hz", 1.0, 2000.0, "", "")] = 1000.0
    host: str = ""
    port: str = ""
    retries: Annotated[int, Quantity("", 0, 9, "", "")] = 1
    mode: Literal["gentle", "harsh"] = "gentle"
    verify: bool = True
    table: Path | None = None
    map: RegisterMap | None = None
    addresses: Addresses = Addresses(last=7)


class Slow:
    kind = "slow"
    Options = Options

    def __init__(self, name, options):
        if options.mode == "harsh" and not options.verify:
            raise DriverError(name, "is harsh without verifying", "write `verify: true`")
        self.name = name
        self.options = options
        self.inputs, self.outputs, self.rate_hz = options.inputs, options.outputs, options.rate

    def open(self):
        if self.options.host == "nowhere":
            raise DriverError(self.name, "nobody answers", "plug it in", "host")

    def read(self): return {}
    def write(self, outputs): ...
    def safe_state(self): ...
    def close(self): ...


class Plan(NamedTuple):
    calls: int = 0

    def exchange(self, fd, sequence, outputs, inputs, deadline_ns): return 1, 0


class Fast(Slow):
    kind = "fast"

    def fileno(self): return 0
    def plan(self): return Plan()
    def look_plan(self): return Plan()
    def driven(self): return ""
'''


@pytest.fixture
def no_memory_locked(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Have a request to lock this process's memory granted without its being done.

    A worker of the tests has gigabytes, which the kernel would fetch page by page. Afterwards the
    objects that exist are kept out of garbage collections again, as they were.
    """
    monkeypatch.setattr(realtime._libc, "mlockall", lambda _flags: 0)
    yield
    gc.freeze()
