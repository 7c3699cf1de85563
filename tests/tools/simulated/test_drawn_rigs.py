import numpy as np
import pytest

from rig.plant import Model
from rig.plant.parameters import NOMINAL, quantities
from rig.plant.simulation import simulate
from tools.simulated.drawn_rigs import MOTIONS, drawn_motion, drawn_rig, mixed_motion


def test_drawn_rigs_are_plausible_and_unlike_one_another() -> None:
    rigs = [drawn_rig(np.random.default_rng(seed)) for seed in range(50)]
    for name, quantity in quantities().items():
        values = np.array([getattr(rig, name) for rig in rigs])
        assert ((values >= quantity.lower) & (values <= quantity.upper)).all(), name
    spread = np.array([rig.bulk_modulus for rig in rigs]) / NOMINAL.bulk_modulus
    assert 0.85 <= spread.min() < 0.9 < 1.1 < spread.max() <= 1.15


def test_the_same_seed_draws_the_same_motion() -> None:
    first, second = (mixed_motion(np.random.default_rng(3), 200_000) for _ in range(2))
    assert np.array_equal(first.setpoint, second.setpoint)
    assert first.kinds == second.kinds


@pytest.mark.parametrize("seed", range(10))
def test_closed_loop_setpoints_stay_clear_of_the_stroke_ends(seed: int) -> None:
    setpoint, open_loop = drawn_motion(np.random.default_rng(seed), 40_000)
    assert np.ptp(setpoint) > 0.05
    if not open_loop:
        assert 0.05 < setpoint.min() < setpoint.max() < 0.55
    mixed = mixed_motion(np.random.default_rng(seed), 100_000)
    closed = mixed.setpoint[~mixed.open_loop]
    assert 0.05 < closed.min() < closed.max() < 0.55


def test_half_an_hour_of_mixed_motion_has_every_kind_and_names_it() -> None:
    motion = mixed_motion(np.random.default_rng(0), 1_800_000)
    assert set(motion.kinds) == {*MOTIONS, "standstill"}
    assert np.diff(motion.starts).max() <= 90_000
    assert motion.kind_at(motion.starts[4]) == motion.kinds[4]
    assert motion.kind_at(motion.starts[4] - 1) == motion.kinds[3]
    still = motion.kinds.index("standstill")
    stretch = motion.setpoint[motion.starts[still] : motion.starts[still + 1]]
    assert np.ptp(stretch) == 0.0


def test_an_open_loop_of_mixed_motion_is_taken_back_before_it_drifts_to_an_end() -> None:
    motion = mixed_motion(np.random.default_rng(0), 1_800_000)
    changes = np.flatnonzero(np.diff(motion.open_loop.astype(int)))
    opened = changes[np.diff(motion.open_loop.astype(int))[changes] > 0]
    closed = changes[np.diff(motion.open_loop.astype(int))[changes] < 0]
    assert (closed[: opened.size] - opened[: closed.size]).max() <= 15_000
    command = motion.setpoint[opened[0] + 1 : closed[0] + 1]
    for bias in (-3e-6, 3e-6):
        rig = Model().with_effect("spool_null_bias", value=bias)
        position = simulate(rig, command)["position"]
        assert 0.05 < position.min() < position.max() < 0.55
