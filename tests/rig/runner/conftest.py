"""Fixtures that make a rig, tests and campaigns in Python, because the runner needs no YAML."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from control.setpoints import Sine
from faults.bypass import NOMINAL_BYPASSES
from faults.campaign import Campaign, CampaignTest
from faults.schedule import Fault
from faults.verdict import Verdict
from rig.configuration.rigs.limits import Limits
from rig.configuration.rigs.rig import Rig
from rig.plant import Model
from rig.plant.sensors import DATA_SHEET

SINE = Sine(0.3, 0.2, 0.5, 0.1, "position")

MakeTest = Callable[..., CampaignTest]
MakeCampaign = Callable[..., Campaign]


@pytest.fixture(scope="session")
def rig() -> Rig:
    """Return a simulated rig that equals the nominal model and has noisy transducers."""
    return Rig(
        name="bench",
        description="",
        backend="simulated",
        plant=Model(),
        sensors=DATA_SHEET,
        has_supply_pressure_sensor=True,
        has_load_cell=True,
        has_spool_sensor=True,
        bypass_valves=NOMINAL_BYPASSES,
        return_valve=None,
        limits=Limits(0.005, 0.6, 10.0, 2e7),
        gain_V_per_m=50.0,
        pace="fast",
    )


@pytest.fixture(scope="session")
def make_test() -> MakeTest:
    """Return a function that makes a campaign test: 14 s of a healthy sine, with changed fields."""

    def make(name: str = "healthy", **changes: Any) -> CampaignTest:
        test = CampaignTest(
            name=name,
            test_name=name,
            duration_s=14.0,
            start_position_m=0.32,
            settle_s=0.5,
            setpoint=SINE,
            load=None,
            faults=(),
            expect=Verdict.HEALTHY,
            repeat=1,
            seed=7,
        )
        return replace(test, **changes)

    return make


@pytest.fixture(scope="session")
def leaking(make_test: MakeTest) -> MakeTest:
    """Return a function that makes a campaign test with a leak of about 0.8 L/min from 8 s on.

    The test expects the leak to be found.
    """

    def make(kind: Verdict = Verdict.EXTERNAL_LEAKAGE_1, **changes: Any) -> CampaignTest:
        faults = (Fault(kind, 5e-9, at_s=8.0),)
        return make_test(**{"name": str(kind), "faults": faults, "expect": kind} | changes)

    return make


@pytest.fixture(scope="session")
def make_campaign() -> MakeCampaign:
    """Return a function that makes a campaign of tests, by default with the product filter."""

    def make(*tests: CampaignTest, filter_name: str = "product") -> Campaign:
        return Campaign(
            name="bench campaign",
            description="made by hand",
            rig_name="bench",
            model=Model(),
            filter_name=filter_name,
            false_alarms_per_day=1.0,
            tests=tests,
        )

    return make
