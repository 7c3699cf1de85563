"""What the page shows of a rig: in the units of the screen, dead when it is dead, no nonsense."""

import json
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, strategies as st

from rig.channels import BYPASSES
from rig.console.snapshot_sections import sections
from rig.plant import FAULTS
from rig.stream.known import Snapshot

from .fakes import RUNNING

NAN = float("nan")
DECIDED: dict[str, Any] = {
    "verdict": "internal_leakage",
    "name": "first",
    "test": 1,
    "time_s": 18.5,
    "sent_ns": 2 * 10**18,
    "statistic": 40.0,
    "threshold": 6.2,
    "leak_m3_per_s": 1e-5,
    "interval_m3_per_s": [0.9e-5, 1.1e-5],
    "onset_s": 12.0,
    "suspected": None,
    "probabilities": {"internal_leakage": 0.99996},
    "details": {"threshold_1_Pa": 55e3},
}


def test_the_bypasses_are_those_of_the_faults_a_rig_can_have() -> None:
    assert BYPASSES == FAULTS


def told(**changed: Any) -> dict[str, Any]:
    return sections(replace(RUNNING, **changed))


def test_values_are_in_the_units_of_the_screen() -> None:
    readings = {r["name"]: (r["value"], r["unit"]) for r in told()["readings"]}
    assert readings["position"] == ("300.12", "mm")
    assert readings["oil"] == ("40.0", "°C")
    assert readings["load"] == (None, "kN")


def test_the_tank_is_shown_in_degrees_and_of_a_stream_without_it_nothing() -> None:
    warm = told(latest={"tank_temperature_K": 313.15})["readings"]
    assert warm == [{"name": "tank", "value": "40.0", "unit": "°C"}]
    assert "tank" not in [reading["name"] for reading in told()["readings"]]


def test_verdicts_of_an_earlier_campaign_are_not_mixed_with_those_of_this_one() -> None:
    before = DECIDED | {"sent_ns": 10**18 - 1, "name": "of yesterday"}
    shown = told(verdicts=(before, DECIDED))["verdicts"]
    assert [each["test"] for each in shown] == ["first"]


def test_a_leak_has_its_interval_in_litres_a_minute() -> None:
    decision = told(decision=DECIDED)["decision"]
    assert decision["leak_L_per_min"] == [0.6, 0.54, 0.66]
    assert (decision["onset_s"], decision["thresholds_kPa"]) == (12.0, [55.0, None])


def test_a_decision_of_an_earlier_run_is_not_shown() -> None:
    assert told(decision=DECIDED | {"sent_ns": 10**17})["decision"] == {}


def test_a_stream_that_died_is_dead_with_its_age() -> None:
    life = told(alive=False, age_s=7.04)["life"]
    assert (life["life"], life["age_s"]) == ("dead", 7.0)
    ended = {**RUNNING.campaign, "status": "ended"}
    assert told(alive=False, age_s=7.04, campaign=ended)["life"]["life"] == "ended"
    assert told(alive=True, campaign=ended)["life"]["life"] == "live"
    assert sections(Snapshot("bench"))["life"]["life"] == "unheard"


def test_interlocks_are_reported_in_words_with_the_first_out_first() -> None:
    latest = {"estop_closed": 0.0, "valve_enabled": 1.0, "watchdog_tripped": NAN}
    trips = {
        "first_out": [
            {"by": "loop", "cause": "ESTOP_OPEN", "sentence": "the emergency stop is open",
             "remedy": "release it", "after_s": 0.0},
            {"by": "field", "cause": "ESTOP_OPEN", "after_s": 0.0123},
        ],
        "confirmed": {"valve null": 0.001, "bypass shut": None},
    }  # fmt: skip
    found = told(latest=latest, health={"trips": trips, "homed": True})["interlocks"]
    words = {each["name"]: (each["text"], each["how"]) for each in found["contacts"]}
    assert words["emergency stop"] == ("open", "bad")
    assert words["valve"] == ("enabled", "live")
    assert words["I/O watchdog"] == ("not known", "off")
    assert words["position"] == ("homed", "good")
    unheard = {
        each["name"]: each["text"]
        for each in told(latest=latest, health={})["interlocks"]["contacts"]
    }
    assert unheard["position"] == "not known"
    # What the session before has measured is not known of the one that reads nothing yet.
    before = told(latest=latest | {"estop_closed": 1.0}, is_sampled=False)
    assert {each["text"] for each in before["interlocks"]["contacts"]} == {"not known", "not homed"}
    assert not before["life"]["is_read"]
    was = told(latest=latest, is_sampled=False, alive=False)
    assert was["interlocks"]["contacts"][0]["text"] == "open"
    assert [each["by"] for each in found["first_out"]] == ["loop", "field"]
    assert [each["after_ms"] for each in found["first_out"]] == [0.0, 12.0]
    assert found["confirmed"] == [
        {"step": "valve null", "after_ms": 1.0},
        {"step": "bypass shut", "after_ms": None},
    ]


def test_a_rig_without_bypass_valves_has_none() -> None:
    assert told()["bypass"] == []
    latest = {"internal_leakage_ball": 1.0, "flow_internal_m3_per_s": 1e-5}
    assert told(latest=latest)["bypass"] == [
        {"name": "internal_leakage", "ball": 1.0, "needle": None,
         "metered_L_per_min": 0.6, "shut_L_per_min": None}
    ]  # fmt: skip


@pytest.mark.parametrize(
    "shut", [{"ball": 0.0}, {"ball": 0.0, "needle": 0.3}, {"needle": 0.0}], ids=str
)
def test_what_a_meter_reads_of_a_shut_valve_is_its_zero(shut: dict[str, float]) -> None:
    latest = {f"external_leakage_1_{part}": value for part, value in shut.items()}
    (valve,) = told(latest=latest | {"flow_1_m3_per_s": 8.3e-7})["bypass"]
    assert (valve["metered_L_per_min"], valve["shut_L_per_min"]) == (None, 0.05)


NONSENSE = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20) | st.binary(),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=9), inner, max_size=3)
    ),
    max_leaves=4,
)  # fmt: skip
KINDS = ("decision", "health", "campaign", "progress", "state")
NAMES = st.sampled_from(
    ["verdict", "interval_m3_per_s", "trips", "first_out", "timing", "tests", "details", "sent_ns",
     "begun_ns", "silent_s", "leak_m3_per_s", "probabilities", "status", "time_s", "missed"]
)  # fmt: skip


@given(
    st.sampled_from(KINDS),
    st.dictionaries(NAMES, NONSENSE | st.dictionaries(NAMES, NONSENSE, max_size=2), max_size=4),
)
def test_nonsense_from_the_stream_is_shown_as_json_all_the_same(
    kind: str, content: dict[str, Any]
) -> None:
    """Whoever may publish on a rig's keys may publish anything."""
    changed: dict[str, Any] = {kind: content, "verdicts": (content,), "events": (content,)}
    last = {"last": dict.fromkeys(("campaign", "decision", "trips", "acknowledged"), content)}
    for found in (told(**changed), told(campaign=last)):
        assert json.loads(json.dumps(found, allow_nan=False))


@pytest.mark.parametrize("text", ["<script>", "x" * 5000])
def test_texts_are_kept_as_texts_and_short(text: str) -> None:
    event = {"kind": "told", "text": text, "at_ns": 10**18}
    assert told(events=(event,))["events"][0]["text"] == text[:500]


def test_what_drove_a_rig_last_is_shown_as_it_would_be_itself() -> None:
    trips = {"first_out": [{"by": "loop", "sentence": "open"}], "confirmed": {"pump": None}}
    campaign = {**RUNNING.campaign, "status": "ended", "exit_code": 3}
    last = {"campaign": campaign, "decision": DECIDED, "trips": trips, "ended_ns": 10**18}
    idle = {"status": "idle", "begun_ns": 3 * 10**18}
    shown = told(campaign=idle | {"last": last}, verdicts=(DECIDED,))
    alone = told(campaign=campaign, decision=DECIDED, health={"trips": trips}, verdicts=(DECIDED,))
    assert shown["campaign"]["status"] == "idle"
    for name in ("campaign", "decision"):
        assert shown["last"][name] == alone[name]
    assert shown["verdicts"] == alone["verdicts"]
    assert shown["last"]["interlocks"]["confirmed"] == [{"step": "pump", "after_ms": None}]
    assert shown["last"]["acknowledged"] == {}
    assert alone["last"] == told(campaign=idle)["last"] == {}
