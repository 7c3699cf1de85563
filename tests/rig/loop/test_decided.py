from faults.verdict import FAULT_KINDS, LEAK_KINDS, Verdict
from rig.loop.decided import DECIDED, PRESENT, VERDICT_CODES, Decided, no_decision
from rig.plant import FAULTS, LEAKS


def test_every_verdict_has_a_code_of_its_own_that_is_never_given_to_another() -> None:
    assert sorted(VERDICT_CODES) == sorted(Verdict)
    # Recordings hold these.
    assert [VERDICT_CODES[code] for code in (0, 3, 8, 9)] == [
        "healthy",
        "internal_leakage",
        "inconclusive",
        "encoder_drift",
    ]


def test_its_columns_are_those_that_the_detector_decides_on() -> None:
    assert tuple(FAULT_KINDS) == FAULTS
    assert tuple(LEAK_KINDS) == LEAKS
    assert DECIDED[Decided.PRESENT :] == PRESENT
    assert no_decision().size == len(DECIDED)
