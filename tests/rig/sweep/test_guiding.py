"""Cases of a sweep get the control law that a campaign's test of the same setpoint gets."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from control import (
    PROPORTIONAL,
    ControlLaw,
    ControlSettings,
    Guide,
    Setpoint,
    Sine,
    Trapezoid,
    guide_of,
)
from rig.configuration.sweeps.distributions import Distribution
from rig.configuration.sweeps.sweep import load_sweep
from rig.configuration.sweeps.sweep_plan import Sweep, SweptMotion
from rig.lanes import LANES
from rig.loop.lane_control import LaneGuide
from rig.plant.integrator import LONGEST_STEP, TICK
from rig.sweep.drawing import draw
from rig.sweep.group import Group, setting_of
from rig.sweep.run_cases import run_thesis7

TRACKING = ControlSettings(feedforward="model", integral_time=0.5, cyclic=True)
SINE = {"mean": 0.3, "amplitude": 0.1, "frequency": 0.5, "phase": 0.4}
TRAPEZOID = SINE | {"hold": 0.3}


def fixed(values: dict[str, float]) -> dict[str, tuple[Distribution, ...]]:
    return {key: (Distribution("fixed", (value,)),) for key, value in values.items()}


@pytest.fixture(scope="module")
def sweep() -> Sweep:
    base = load_sweep("leaks", Path(__file__).parent)
    gain = {"position_gain": (Distribution("uniform", (40.0, 80.0)),)}
    motions = (
        SweptMotion("sine", "sine", 1.0, "position", fixed(SINE)),
        SweptMotion("trapezoid", "trapezoid", 1.0, "position", fixed(TRAPEZOID) | gain),
        SweptMotion("plain", "sine", 1.0, "position", fixed(SINE), ControlSettings(gain=70.0)),
        SweptMotion("open", "sine", 1.0, "command", fixed(SINE)),
    )
    return replace(
        base, motions=motions, control=TRACKING, duration_s=20.0, longest_step_s=LONGEST_STEP
    )


def guided(group: Group) -> LaneGuide:
    guide = group.lanes.guide
    assert guide is not None
    return guide


def laned(group: Group, lane: int) -> Guide:
    """Return the guide of one lane of a group."""
    guide = guided(group)
    law = ControlLaw(False, *guide.law[1:, lane].tolist())
    return Guide(law, guide.feedforward[:, lane], guide.tones[:, :, lane], guide.expected[:, lane])


def test_a_case_has_the_guide_of_its_setpoint_its_law_and_its_gain(sweep: Sweep) -> None:
    setting, cases = setting_of(sweep), draw(sweep, 0, 4 * LANES)
    setpoints: dict[str, Setpoint] = {
        "sine": Sine(0.3, 0.1, 0.5, 0.4), "trapezoid": Trapezoid(0.3, 0.1, 0.5, 0.3, 0.4),
    }  # fmt: skip
    names = [motion.name for motion in sweep.motions]
    for kind, name in enumerate(names):
        at = np.resize(np.flatnonzero(cases.motions.kind == kind), LANES)
        group = Group(setting, cases, at)
        gains = guided(group).gain[0]
        if name not in setpoints:
            assert not guided(group).feedforward.size
            assert gains[0] == {"plain": 70.0, "open": sweep.rig.gain_V_per_m}[name]
            continue
        samples = setpoints[name].sample(np.arange(sweep.ticks) * TICK)
        for lane in (0, LANES - 1):
            expected = guide_of(
                setpoints[name], samples, TRACKING, sweep.model.parameters, sweep.rig.sensors,
                float(gains[lane]), sweep.rig.limits.command_V,
            )  # fmt: skip
            found = laned(group, lane)
            assert found.law == expected.law
            np.testing.assert_array_equal(found.tones, expected.tones)
            np.testing.assert_allclose(found.feedforward, expected.feedforward, atol=1e-5)
            np.testing.assert_allclose(found.expected, expected.expected, atol=1e-8)
        assert (np.unique(gains).size > 1) == (name == "trapezoid")


def test_in_a_group_of_several_motions_the_proportional_ones_stay_so(sweep: Sweep) -> None:
    setting, cases = setting_of(sweep), draw(sweep, 0, 8 * LANES)
    mixed = [int(np.flatnonzero(cases.motions.kind == lane % 4)[0]) for lane in range(LANES)]
    group = Group(setting, cases, np.array(mixed))
    law, gains = guided(group).law, guided(group).gain[0]
    for lane in range(LANES):
        assert (law[:, lane] == np.array(PROPORTIONAL._replace(proportional=False))).all() == (
            lane % 4 > 1
        )
        if lane % 4 > 1:
            assert not guided(group).feedforward[:, lane].any()
            assert np.isnan(guided(group).expected[:, lane]).all()
    assert gains[2] == 70.0


@pytest.mark.parametrize(
    ("names", "is_guided"),
    [
        (("open",), False),
        (("plain",), False),
        (("plain", "open"), False),
        (("plain", "thesis"), True),
        (("sine",), True),
        (("drawn",), True),
    ],
)
def test_a_sweep_with_the_proportional_loop_and_one_gain_has_no_guides(
    sweep: Sweep, names: tuple[str, ...], is_guided: bool
) -> None:
    plain = sweep.motions[2]
    known = {motion.name: motion for motion in sweep.motions} | {
        "thesis": replace(plain, name="thesis", control=ControlSettings()),
        "drawn": replace(
            plain,
            values=dict(plain.values) | {"position_gain": sweep.motions[1].values["position_gain"]},
        ),
    }
    setting = setting_of(replace(sweep, motions=tuple(known[name] for name in names)))
    assert setting.guided == is_guided
    if "plain" in names and not is_guided:
        assert setting.loop.gain == 70.0


@pytest.mark.long
def test_the_integral_of_a_case_takes_up_its_null_bias(sweep: Sweep) -> None:
    bias = 1e-5
    biased = replace(
        sweep,
        motions=sweep.motions[:1],
        parameters={"spool_null_bias": Distribution("fixed", (bias,))},
        leaks=None,
    )
    group = Group(setting_of(biased), draw(biased, 0, LANES), np.arange(LANES))
    run_thesis7(group)
    taken_up = (
        -bias / group.rigs.parameters[biased.rig.plant.parameters._fields.index("valve_gain")]
    )
    np.testing.assert_allclose(guided(group).kept[0], taken_up, rtol=0.1)
