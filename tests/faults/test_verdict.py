"""The verdicts are names that other programs rely on."""

import json
import pickle

from faults.verdict import FAULT_KINDS, LEAK_KINDS, Verdict
from rig.plant.effects import CATALOGUE
from rig.plant.faults import FAULT_COLUMNS


def test_the_verdict_names_are_those_scripts_compare_with() -> None:
    assert list(Verdict) == [
        "healthy",
        "external_leakage_1",
        "external_leakage_2",
        "internal_leakage",
        "supply_leakage",
        "return_blockage",
        "multiple",
        "unknown_fault",
        "encoder_drift",
        "inconclusive",
    ]


def test_every_verdict_says_in_one_line_what_it_means() -> None:
    descriptions = [verdict.description for verdict in Verdict]
    assert all(text and "\n" not in text for text in descriptions)
    assert len(set(descriptions)) == len(descriptions)


def test_a_verdict_is_written_and_read_as_its_name() -> None:
    for verdict in Verdict:
        assert json.loads(json.dumps(verdict)) == verdict.value == f"{verdict}"
        assert Verdict(str(verdict)) is verdict
        assert pickle.loads(pickle.dumps(verdict)) is verdict


def test_the_plant_can_be_given_every_fault() -> None:
    assert set(FAULT_KINDS) <= set(FAULT_COLUMNS)
    linear = {name.removesuffix("_linear") for name in FAULT_COLUMNS if name.endswith("_linear")}
    assert linear == set(LEAK_KINDS)


def test_every_leak_of_the_actuator_is_an_effect_of_the_catalogue() -> None:
    assert set(LEAK_KINDS) <= set(CATALOGUE)
