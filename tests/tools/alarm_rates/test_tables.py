"""The tables of alarms and leaks count what was judged."""

from functools import partial

from estimator.accounts.nuisances import UNINFORMED
from estimator.leaks.learnt_test import LearntLeakTest
from rig.plant import LEAKS, NOMINAL
from tests.estimator.learnt.made_up import moving_blocks, noise
from tools.alarm_rates.hours import Piece
from tools.alarm_rates.judging import Alarm, Judged, Sought, false_alarms
from tools.alarm_rates.tables import alarm_table, leak_table, stated_table


def judged() -> Judged:
    leak = LEAKS[0]
    return Judged(
        1,
        {"moving": 86400.0, "creep": 43200.0},
        [Alarm(100.0, "moving"), Alarm(100.0, "creep"), Alarm(10.0, "creep")],
        [Sought(0.03, leak, True, False), Sought(0.03, leak, False, True)],
        [(100.0, 50.0, 200.0), (10.0, 3.0, 30.0)],
    )


def cells(table: str, *starts: str) -> list[str]:
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()]
    return next(line for line in lines if tuple(line[: len(starts)]) == starts)


def test_alarms_are_counted_by_setting_and_regime() -> None:
    table = alarm_table([judged()])
    assert cells(table, "100", "all")[2:6] == ["36.00", "2", "150.0", "1"]
    assert cells(table, "10", "creep")[2:6] == ["12.00", "1", "5.0", "2"]
    assert cells(table, "10", "moving")[3] == "0"


def test_leaks_are_counted_by_place_and_size() -> None:
    line = cells(leak_table([judged()]), "0.03", "10 s", "external leakage 1")
    assert line[3].startswith("1 of 2")
    assert line[4] == "1"


def test_what_baselines_stated_stands_beside() -> None:
    assert cells(stated_table([judged()]), "10", "1") == ["10", "1", "3.0 to 30"]


def test_a_quiet_rig_does_not_alarm() -> None:
    blocks = moving_blocks(60, 12)
    begin = partial(LearntLeakTest, 10.0, UNINFORMED, noise(), NOMINAL)
    assert not list(false_alarms(Piece(blocks, ["sines"] * 60), begin))
