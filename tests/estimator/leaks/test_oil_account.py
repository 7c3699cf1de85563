"""The oil account and its test together: what they learn, and what they leave alone."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from estimator.accounts.flow import SPOOL_NOISE, AccountBlock
from estimator.accounts.noise import sensor_noise
from estimator.accounts.nuisances import NUISANCES
from estimator.accounts.sums import MARKS
from estimator.filters.registry import FilterRun
from estimator.leaks.detection import Decision, OilAccountDetector
from estimator.leaks.leak_statistic import LeakTest
from estimator.leaks.oil_account import OilAccount
from estimator.leaks.replaying import filter_recording, part_of, samples_of, stretch
from rig.io.simulated import simulated_rig
from rig.loop.simulated_loop import Motion
from rig.plant import FAULTS, NOMINAL, Model, Parameters
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.recording import Recording
from tools.simulated.recordings import recorded

Array = NDArray[np.float64]


def in_steps(truth: Parameters, seconds: float = 30.0, seed: int = 1) -> Recording:
    """Return a healthy rig in steps of 1.5 s: half of the time its spool is at its null."""
    ticks = round(seconds * 1000.0)
    levels = np.random.default_rng(seed).uniform(0.15, 0.45, 100)
    setpoint = levels[(np.arange(ticks) // 1500).astype(int)]
    motion = Motion(setpoint, False, np.zeros((ticks, 8)), 0.3, 1500)
    return recorded(simulated_rig(Model(parameters=truth), seed), motion)


def at_rest(seed: int, seconds: float = 30.0) -> Recording:
    """Return a rig that is the model, with its valve shut and its ram at rest."""
    ticks = round(seconds * 1000.0)
    motion = Motion(np.zeros(ticks), True, np.zeros((ticks, 8)), 0.3, 1500)
    return recorded(simulated_rig(Model(), seed), motion)


def blocks_of(recording: Recording, run: FilterRun) -> list[AccountBlock]:
    account = OilAccount(NOMINAL, LeakTest(1.0))
    return list(account.add(samples_of(recording), run))


@pytest.fixture(scope="module")
def sound() -> tuple[Recording, FilterRun]:
    recording = in_steps(NOMINAL)
    return recording, filter_recording(recording, Model())


@pytest.mark.parametrize("bias", [-4e-6, 0.0, 2.5e-6])
def test_the_null_bias_is_learnt_as_well_as_is_said(bias: float) -> None:
    recording = in_steps(NOMINAL._replace(spool_null_bias=bias))
    test = LeakTest(1.0)
    account = OilAccount(NOMINAL, test)
    assert test.null_bias() == (0.0, NUISANCES[0].sigma)
    for _ in account.add(samples_of(recording), filter_recording(recording, Model())):
        pass
    found, spread = test.null_bias()
    assert spread < 1e-6
    assert abs(found - bias) < 3.0 * spread


def test_a_null_that_the_model_knows_opens_the_right_edges() -> None:
    """At a null of 9 um the wrong edges are worth 0.04 L/min here."""
    truth = NOMINAL._replace(spool_null_bias=9e-6)
    recording = in_steps(truth)
    test = LeakTest(1.0)
    run = filter_recording(recording, Model(parameters=truth))
    blocks = OilAccount(truth, test).add(samples_of(recording), run)
    missing = np.array([block.missing for block in blocks])[4:] / LITRE_PER_MINUTE
    assert np.sqrt((missing**2).mean()) < 0.01
    found, spread = test.null_bias()
    assert abs(found) < 3.0 * spread


def test_what_the_bias_leaves_open_is_in_doubt(sound: tuple[Recording, FilterRun]) -> None:
    """At first the null is known to 10 um, which is 1 L/min; soon to a tenth of that."""
    doubts = np.array([block.doubts for block in blocks_of(*sound)]) / LITRE_PER_MINUTE
    assert doubts[:4].max() > 10.0 * doubts[-20:].mean()
    assert doubts[-20:].mean() < 0.03


def decided(recording: Recording, run: FilterRun, piece: int) -> Decision:
    detector, samples = OilAccountDetector(Model()), samples_of(recording)
    for start in range(0, recording.time_s.size, piece):
        part = slice(start, start + piece)
        detector.update(stretch(samples, part), part_of(run, part))
    return detector.decide()


@pytest.mark.parametrize("piece", [333, 501, 7000])
def test_how_samples_are_batched_does_not_matter(
    sound: tuple[Recording, FilterRun], piece: int
) -> None:
    recording, run = sound
    assert decided(recording, run, piece) == decided(recording, run, recording.time_s.size)


@pytest.mark.parametrize("channel", ["position_m", "pressure_1_Pa", "pressure_2_Pa"])
def test_a_recording_that_begins_without_a_sensor_is_judged_from_when_it_has_it(
    sound: tuple[Recording, FilterRun], channel: str
) -> None:
    late = Recording({name: values.copy() for name, values in sound[0].channels.items()})
    late.channels[channel][:1200] = np.nan
    run = filter_recording(late, Model())
    assert blocks_of(late, run)[0].start_s == pytest.approx(late.time_s[1200])
    assert decided(late, run, 500).verdict == "healthy"


def test_a_leak_that_the_model_has_is_none() -> None:
    truth = NOMINAL._replace(internal_leakage=3e-9, external_leakage_1=2e-9)
    recording = in_steps(truth)
    model = Model(parameters=truth)
    account = OilAccount(truth, LeakTest(1.0))
    run = filter_recording(recording, model)
    missing = np.array([b.missing for b in account.add(samples_of(recording), run)])
    assert np.abs(missing[4:]).mean() / LITRE_PER_MINUTE < 0.01
    unaware = np.array([b.missing for b in blocks_of(recording, run)])
    assert np.abs(unaware[4:]).mean() / LITRE_PER_MINUTE > 0.1


def test_accounts_of_a_rig_that_is_the_model_scatter_as_its_sensors_make_them(
    sound: tuple[Recording, FilterRun],
) -> None:
    """What is left is white and of variance one, within its chi-square bounds of 99.9 %."""
    left = np.array(
        [
            np.linalg.solve(np.linalg.cholesky(sensor_noise(block)), block.missing)
            for block in blocks_of(*sound)[4:]
        ]
    )
    low, high = chi2.ppf([0.0005, 0.9995], left.size) / left.size
    assert low < (left**2).mean() < high
    missing = np.array([block.missing for block in blocks_of(*sound)[4:]])
    assert np.corrcoef(missing.T)[0, 1] < -0.6  # What errs into one chamber errs out of the other.


@pytest.fixture(scope="module")
def resting() -> list[tuple[Recording, FilterRun]]:
    recordings = [at_rest(seed) for seed in (1, 2, 3)]
    return [(recording, filter_recording(recording, Model())) for recording in recordings]


def test_a_spool_at_rest_is_estimated_to_the_noise_that_its_accounts_make_up_for(
    resting: list[tuple[Recording, FilterRun]],
) -> None:
    """0.43 of its transducer's noise: what varies by more is taken for motion."""
    spool = np.concatenate([run.state("spool_m")[2000:] for _, run in resting])
    assert np.sqrt((spool**2).mean()) == pytest.approx(SPOOL_NOISE, rel=0.1)


def test_what_flows_past_a_spool_at_rest_scatters_as_its_transducer_makes_it(
    resting: list[tuple[Recording, FilterRun]],
) -> None:
    """At rest it alone moves oil out of one account into the other.

    The chi-square bounds of 99.9 % of 165 blocks would not hold a spool error a third off.
    """
    contrast = np.array([1.0, -1.0])
    blocks = [block for each in resting for block in blocks_of(*each)[4:]]
    left = np.array(
        [contrast @ b.missing / np.sqrt(contrast @ sensor_noise(b) @ contrast) for b in blocks]
    )
    low, high = chi2.ppf([0.0005, 0.9995], left.size) / left.size
    assert low < (left**2).mean() < high


def repeated(blocks: list[AccountBlock], count: int) -> list[AccountBlock]:
    return [
        replace(blocks[k % len(blocks)], start_s=0.5 * k, end_s=0.5 * k + 0.5) for k in range(count)
    ]


@pytest.mark.parametrize("step", [0.02e-6, 0.1e-6])
def test_a_null_that_wanders_raises_no_alarm(
    sound: tuple[Recording, FilterRun], step: float
) -> None:
    """0.1 um a block is 1.1 um after a minute: ten times the budget."""
    series = repeated(blocks_of(*sound)[6:54], 120)
    for seed in range(6):
        rng = np.random.default_rng(seed)
        wander = np.cumsum(rng.standard_normal(len(series))) * step / NUISANCES[0].sigma
        test = LeakTest(1.0)
        for block, size in zip(series, wander, strict=True):
            test.add(replace(block, missing=block.missing + size * block.nuisances[:, 0]))
            assert not test.search()


@pytest.mark.long
def test_noise_that_lasts_is_allowed_for() -> None:
    """At 200 a day, 40 runs of a minute allow 5.6 alarms; noise of 0.3 L/min dwarfs the budget."""
    recording = in_steps(NOMINAL)
    series = repeated(blocks_of(recording, filter_recording(recording, Model()))[6:54], 120)
    alarms = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        noise = 0.3 * LITRE_PER_MINUTE * rng.standard_normal((len(series), 2))
        for k in range(1, len(series)):
            noise[k] = 0.3 * noise[k - 1] + np.sqrt(1.0 - 0.09) * noise[k]
        sizes = rng.standard_normal(len(NUISANCES))
        test = LeakTest(200.0)
        alarmed = False
        for block, error in zip(series, noise, strict=True):
            test.add(replace(block, missing=block.nuisances @ sizes + error))
            alarmed |= bool(test.search())
        alarms += alarmed
    assert alarms <= 5


def test_an_hour_later_the_onset_is_as_sharp_and_the_sums_no_larger(
    sound: tuple[Recording, FilterRun],
) -> None:
    series = repeated(blocks_of(*sound)[6:54], 1500)
    test = LeakTest(1.0)
    for k, block in enumerate(series):
        leak = 0.2 * LITRE_PER_MINUTE / 2600.0 * block.faults[:, 0] if k >= 300 else 0.0
        test.add(replace(block, missing=block.missing + leak))
        if k % 10 == 0 or 300 <= k < 320:
            test.search()
    (found,) = test.search()
    assert FAULTS[found.fault] == "external_leakage_1"
    assert found.onset_s == pytest.approx(150.0, abs=0.5)
    assert test.sums.marks <= MARKS


def test_the_detector_needs_no_package_that_is_not_declared() -> None:
    """Numba's matrix products would need scipy, which only the tests have."""
    program = (
        "import sys; sys.modules['scipy'] = None\n"
        "import numpy as np\n"
        "from estimator.accounts.flow import AccountBlock\n"
        "from estimator.leaks.leak_statistic import LeakTest\n"
        "from estimator.accounts.nuisances import NUISANCE_COUNT\n"
        "test, rng = LeakTest(1.0), np.random.default_rng(0)\n"
        "for k in range(30):\n"
        "    y = 1e-7 * rng.standard_normal(2)\n"
        "    f = 1e-6 * rng.standard_normal((2, NUISANCE_COUNT))\n"
        "    s = rng.uniform(1e3, 2e3, (2, 5))\n"
        "    test.add(AccountBlock(k / 2, k / 2 + 0.5, y, f, s, s[0], True))\n"
        "assert test.search() == []\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_an_account_tells_how_far_the_spools_readings_are_from_its_estimate(
    sound: tuple[Recording, FilterRun],
) -> None:
    """A reading at the end of the range is none, and what the account misses is not touched."""
    recording, run = sound
    shown = recording.channels["spool_m"] + 3e-7
    shown[700:720] = 1.0
    moved = replace(recording, channels={**recording.channels, "spool_m": shown})
    before, after = blocks_of(recording, run), blocks_of(moved, run)
    further = np.array(
        [b.spool_departure - a.spool_departure for a, b in zip(before, after, strict=True)]
    )
    assert np.abs(np.delete(further, 1) - 3e-7).max() < 1e-10
    assert further[1] == pytest.approx(3e-7, abs=1e-7)
    assert all(np.array_equal(a.missing, b.missing) for a, b in zip(before, after, strict=True))
