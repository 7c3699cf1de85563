"""Schedule files: every mistake with its line, campaigns checked along."""

from datetime import UTC, datetime
from pathlib import Path

import pytest

from rig.configuration import ConfigError, check
from rig.configuration.campaigns.schedule import Missed, Schedule, load_schedule

HEAD = "name: night\ntimezone: Europe/Helsinki\nruns: out\n"


def schedule_in(folder: Path, entries: str, head: str = HEAD) -> Schedule:
    path = folder / "night.yaml"
    path.write_text(f"{head}entries:\n{entries}\n")
    return load_schedule(path)


def test_entries_are_read_with_their_times_and_policies(tmp_path: Path) -> None:
    head = HEAD + "hook: [notify, '{entry}', 3]\ndefaults: {missed: skip, retries: 2}\n"
    schedule = schedule_in(
        tmp_path,
        "  - {name: a, campaign: quickstart, cron: 30 2 * * MON-FRI}\n"
        "  - {name: b, campaign: quickstart, every: 4 h, missed: run_all, retry_after: 5 min}\n"
        "  - {name: c, campaign: quickstart, rig: ideal, at: 2026-12-01 03:00}",
        head,
    )
    a, b, c = schedule.entries
    assert schedule.folder == tmp_path / "out"
    assert schedule.hook == ("notify", "{entry}", "3")
    assert (a.cron, a.missed, a.retries) == ("30 2 * * MON-FRI", Missed.SKIP, 2)
    assert (b.every_s, b.missed, b.retry_after_s) == (14400.0, Missed.RUN_ALL, 300.0)
    assert c.at == datetime(2026, 12, 1, 1, 0, tzinfo=UTC)
    assert c.rig is not None
    assert c.rig.endswith("ideal.yaml")


MISTAKES = {
    "  - {name: a, campaign: quickstart}": "give one of cron, every and at",
    "  - {name: a, campaign: quickstart, cron: 1 2 * * *, every: 4 h}": "has cron and every",
    "  - {name: a, campaign: quickstart, cron: 61 2 * * *}": "is no time: bad minute",
    "  - {name: a, campaign: quickstart, cron: 1 2 3}": "is no time: five fields are needed",
    "  - {name: a, campaign: quickstart, every: 4 V}": "is not a time",
    "  - {name: a, campaign: quickstart, at: tomorrow}": "is no date and time",
    "  - {name: a, campaign: quikstart, every: 4 h}": "did you mean quickstart?",
    "  - {name: a, campaign: quickstart, rig: nowhere, every: 4 h}": "is not a known rig",
    "  - {name: a, campaign: quickstart, every: 4 h, missed: all}": "did you mean run_all?",
    "  - {name: a, campaign: quickstart, every: 4 h, retries: 99}": "less than or equal to 10",
    "  - {name: a, campaign: quickstart, evry: 4 h}": "did you mean every?",
    "  - just a name": "is not a mapping",
    "  []": "is not a list of entries",
}


@pytest.mark.parametrize("entries", MISTAKES)
def test_a_mistake_is_reported_with_its_place_and_remedy(tmp_path: Path, entries: str) -> None:
    with pytest.raises(ConfigError) as caught:
        schedule_in(tmp_path, entries)
    assert "night.yaml:" in str(caught.value)
    assert MISTAKES[entries] in str(caught.value)


def test_all_mistakes_are_reported_at_once(tmp_path: Path) -> None:
    head = "name: night\ntimezone: Mars/Base\nhook: rm -rf /\n"
    entries = "  - {name: a, campaign: quickstart}\n  - {name: a, campaign: none, every: 1 h}"
    with pytest.raises(ConfigError) as caught:
        schedule_in(tmp_path, entries, head)
    reported = str(caught.value)
    for part in ("Mars/Base is not a known time zone", "no shell", "is given twice", "has no time"):
        assert part in reported


def test_a_campaign_with_mistakes_makes_none_of_a_schedule(tmp_path: Path) -> None:
    (tmp_path / "bad.yaml").write_text("name: bad\nrig: simulated\ntests:\n  - {name: t}\n")
    with pytest.raises(ConfigError, match=r"bad.yaml:4"):
        schedule_in(tmp_path, "  - {name: a, campaign: ./bad.yaml, every: 1 h}")


def test_the_shipped_schedule_checks(tmp_path: Path) -> None:
    report = check("nightly")
    assert report.kind == "schedule"
    assert len(report.summary) == 3
