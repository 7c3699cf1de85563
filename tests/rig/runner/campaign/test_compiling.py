"""Whatever a session runs is compiled before it is armed; an operator is shown how far that is."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numba.core.runtime import _nrt_python  # type: ignore[attr-defined]
from numba.core.runtime.nrt import rtsys

from estimator.filters.registry import start_memory
from faults.campaign import CampaignTest, OnFault
from rig.configuration.rigs.rig import Rig, load_rig
from rig.loop.decided import DECIDED, Decided
from rig.plant import Model
from rig.runner import StopFlag
from rig.runner.campaign.compiled_pieces import PIECES, Needs, Piece
from rig.runner.campaign.compiling import ON_HARDWARE, _mark, compile_for, load
from rig.runner.campaign.simulated_bench import loop_of
from rig.runner.campaign.stopping import stop_on_signals

SINE = "{type: sine, mean: 0.3 m, amplitude: 0.2 m, frequency: 0.5 Hz}"
LEAK = "[{type: external_leakage_1, at: 8 s, flow: 0.8 L/min, pressure: 6.9 MPa}]"
PRODUCT = f"""
name: product
rig: simulated
defaults: {{duration: 14 s, settle: 0.5 s, setpoint: {SINE}}}
tests:
  - name: healthy
  - name: tolerated
    on_fault: tolerate
    faults: {LEAK}
  - name: held
    on_fault: hold
    faults: {LEAK}
  - name: spring
    load: {{stiffness: 20 kN/m, contact: 0.2 m}}
  - name: open loop
    setpoint: {{type: sine, amplitude: 3 V, frequency: 0.5 Hz}}
"""
PATTERN = f"""
name: pattern
rig: simulated
detector: {{filter: FILTER}}
defaults: {{duration: 20 s, settle: 0.5 s, setpoint: {SINE}}}
tests:
  - name: leak
    faults: {LEAK}
  - name: healthy
"""
CAMPAIGNS = {
    "product": PRODUCT,
    **{name: PATTERN.replace("FILTER", name) for name in ("thesis-6", "thesis-7")},
}

# In an interpreter of its own, that has used nothing yet. The simulated rig stands for hardware, as
# the supervisor's part in a session is the same.
SESSION = """
import sys
from pathlib import Path

from numba.core.dispatcher import Dispatcher

from rig.configuration.campaigns.campaign import load_campaign
from rig.loop.board import Board
from rig.loop.decided import no_decision
from rig.loop.wire.loop import post_decision
from rig.runner import StopFlag, run_campaign
from rig.runner.campaign.compiled_pieces import Needs
from rig.runner.campaign.compiling import ON_HARDWARE, SIMULATED, load
from rig.runner.campaign.simulated_bench import SimulatedBench

folder = Path(sys.argv[1])
campaign, rig = load_campaign(str(folder / "campaign.yaml"), None, folder)
needs = Needs(rig, campaign.filter_name)
load(needs, ON_HARDWARE, StopFlag())
load(needs, ("simulated loop",), StopFlag())

compile_or_load = Dispatcher.compile
def noted(self, signature):
    print(self.py_func.__module__, self.py_func.__qualname__, signature)
    return compile_or_load(self, signature)
Dispatcher.compile = noted

outcome = run_campaign(campaign, rig, folder / "run", bench=SimulatedBench(rig, folder))
post_decision(Board.create(1), 1, no_decision())
assert not any(test.message for test in outcome.tests), outcome.tests
"""


@pytest.mark.parametrize(
    "name",
    [
        "product",
        *(pytest.param(other, marks=pytest.mark.long) for other in ("thesis-6", "thesis-7")),
    ],
)
def test_a_supervisor_uses_nothing_for_the_first_time_while_its_rig_is_armed(
    name: str, tmp_path: Path
) -> None:
    (tmp_path / "campaign.yaml").write_text(CAMPAIGNS[name])
    used = subprocess.run(
        [sys.executable, "-c", SESSION, str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert used.returncode == 0, used.stderr
    assert used.stdout == ""


@pytest.fixture
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "cache"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(folder))
    return folder


@pytest.mark.usefixtures("empty_cache")
def test_what_is_compiled_is_reported_piece_by_piece_and_only_once() -> None:
    needs, told = Needs(load_rig("emulated"), "product"), list[str]()
    compile_for(needs, ("decisions",), told.append, StopFlag())
    assert told == [
        "compiling for this machine, once for each version of the program: decisions",
        "compiled the decisions, 1 of 1",
    ]
    compile_for(needs, ("decisions",), told.append, StopFlag())
    assert len(told) == 2


def test_a_loop_is_compiled_for_each_fast_driver_and_the_rest_is_not(tmp_path: Path) -> None:
    rig = load_rig("emulated")
    other = replace(
        rig, drivers=tuple(replace(spec, type=f"my_{spec.type}") for spec in rig.drivers)
    )
    for name in ON_HARDWARE:
        marks = {_mark(tmp_path, Needs(each, "product"), name) for each in (rig, other)}
        assert len(marks) == (2 if name == "loop" else 1)


@pytest.mark.usefixtures("empty_cache")
def test_a_stop_ends_compiling(monkeypatch: pytest.MonkeyPatch) -> None:
    stop, told = StopFlag(), list[str]()

    def tell(line: str) -> None:
        told.append(line)
        stop.request("SIGINT")

    compile_for(Needs(load_rig("emulated"), "product"), ON_HARDWARE, tell, stop)
    assert len(told) == 1


@pytest.mark.usefixtures("empty_cache")
def test_a_piece_that_cannot_be_compiled_is_reported_and_keeps_nothing_from_running() -> None:
    told: list[str] = []
    compile_for(Needs(load_rig("emulated"), "no filter"), ("filter",), told.append, StopFlag())
    assert "no filter 'no filter'" in told[-1]


# Beside one another, the parts are compiled for the very types that the loop calls them with.
PARTS = """
import sys
from pathlib import Path

from numba.core import event

from rig.configuration import load_rig
from rig.runner.campaign.compiled_pieces import PIECES, Needs

class Listener(event.Listener):
    def on_start(self, event):
        function = event.data["dispatcher"].py_func
        print(piece, f"{function.__module__}.{function.__qualname__}")
    def on_end(self, event):
        pass

needs = Needs(load_rig("simulated"), sys.argv[1])
with event.install_listener("numba:compile", Listener()):
    for piece in (*PIECES["simulated loop"].after, "simulated loop"):
        PIECES[piece].run(needs)
"""


@pytest.mark.long
@pytest.mark.usefixtures("empty_cache")
@pytest.mark.parametrize("name", ["product", "thesis-7"])
def test_the_simulated_loop_compiles_nothing_that_its_parts_have_compiled(name: str) -> None:
    told = subprocess.run(
        [sys.executable, "-c", PARTS, name], capture_output=True, text=True, check=True
    ).stdout
    compiled = [tuple(line.rsplit(" ", 1)) for line in told.splitlines()]
    before = {function for piece, function in compiled if piece != "simulated loop"}
    within = {function for piece, function in compiled if piece == "simulated loop"}
    assert "rig.loop.cycle.simulated_ticks" in within
    # Where no channel is concerned, the compiler takes the constant for a type of its own.
    assert {function.rpartition(".")[2] for function in within & before} <= {"_stop"}


@pytest.fixture
def allocations() -> Iterator[Callable[[], int]]:
    """Count what compiled code has allocated."""
    _nrt_python.memsys_enable_stats()
    yield lambda: int(rtsys.get_allocation_stats().alloc)
    _nrt_python.memsys_disable_stats()


@pytest.mark.parametrize("on_fault", [OnFault.IGNORE, OnFault.TOLERATE, OnFault.HOLD])
def test_a_hundred_times_the_ticks_allocate_no_more(
    on_fault: OnFault,
    rig: Rig,
    leaking: Callable[..., CampaignTest],
    allocations: Callable[[], int],
) -> None:
    test = leaking(on_fault=on_fault)
    loop = loop_of(rig, test, start_memory("product", Model(), rig.sensors), Model())
    confirmed = np.zeros(len(DECIDED))
    confirmed[Decided.CONFIRMED], confirmed[Decided.PRESENT] = 1.0, 5e-9
    loop.decided(confirmed)
    loop.advance(10)
    counted = []
    for ticks in (10, 1000):
        before = allocations()
        loop.advance(ticks)
        counted.append(allocations() - before)
    assert counted[0] == counted[1]


def test_a_signal_ends_the_loading_of_compiled_code_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def is_long(_: Needs) -> None:
        begun.append("piece")
        os.kill(os.getpid(), signal.SIGTERM)
        begun.append("rest of it")

    begun, stop = list[str](), StopFlag()
    for name in ("filter", "detector"):
        monkeypatch.setitem(PIECES, name, Piece(is_long))
    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        with stop_on_signals(stop):
            load(Needs(load_rig("emulated"), "product"), ("filter", "detector"), stop)
    finally:
        signal.signal(signal.SIGTERM, before)
    assert (begun, stop.reason) == (["piece"], "SIGTERM")
