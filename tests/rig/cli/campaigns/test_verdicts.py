from dataclasses import replace

from estimator.leaks.detection import Decision
from rig.cli.campaigns.progress import cells_of, found
from rig.runner import Status, TestOutcome
from rig.runner.outcomes.in_words import percent
from rig.runner.outcomes.reactions import FaultAction

LEAK = Decision(
    "external_leakage_1",
    leak_m3_per_s=5e-6,
    leak_std_m3_per_s=2e-7,
    probabilities={"healthy": 0.03, "external_leakage_1": 0.97},
)


def test_a_verdict_comes_with_its_probability_and_flow() -> None:
    assert found(LEAK) == "external_leakage_1 97.0 % 0.300 ± 0.024 L/min"
    assert found(replace(LEAK, probabilities={})) == "external_leakage_1 0.300 ± 0.024 L/min"
    assert found(Decision("unknown_fault", probabilities={"healthy": 0.0})) == "unknown_fault"


def test_no_rounding_makes_a_verdict_certain() -> None:
    reported = [percent(share) for share in (0.5, 0.954, 0.9989, 0.99951, 1.0)]
    assert reported == ["50 %", "95.4 %", "99.9 %", "> 99.9 %", "> 99.9 %"]


def test_the_table_says_what_was_done_about_a_fault() -> None:
    test = TestOutcome(
        "held", LEAK.verdict, Status.PASSED, 1, 20.0, decision=LEAK,
        actions=(FaultAction(12.5, None, "holding the ram"),),
    )  # fmt: skip
    assert str(cells_of(test)[-1]) == "passed, held from 12.5 s on"
