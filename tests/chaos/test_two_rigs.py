"""Two rigs with a station each, on one console: both are seen and ordered, and never mixed up."""

from collections.abc import Iterator
from contextlib import ExitStack

import pytest
import yaml
from playwright.sync_api import expect, sync_playwright

from tools.chaos.lab import JOG, Lab
from tools.chaos.stage import COMPILE_S

from .test_console_and_browser import WAVE, Desk, lab_of_the_patient, moves_on, position_m

pytestmark = pytest.mark.long

NAMES = ("left", "right")


@pytest.fixture
def rigs(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Iterator[dict[str, Lab]]:
    """Yield two labs by the names of their rigs, whose streams meet at one address."""
    with ExitStack() as labs:
        found = {}
        for processor, name in enumerate(NAMES):
            folder = tmp_path_factory.mktemp(name)
            lab = labs.enter_context(lab_of_the_patient(folder, monkeypatch))
            rig = yaml.safe_load((folder / "rig.yaml").read_text()) | {"name": name}
            rig["loop"]["cpu"] = processor
            (folder / "rig.yaml").write_text(yaml.safe_dump(rig))
            found[name] = lab
        stream = found["left"].stage.stream.read_text()
        found["right"].stage.stream.write_text(stream)
        # Both sign and check commands by the same key, as those of one user.
        monkeypatch.setenv("XDG_STATE_HOME", str(found["left"].stage.folder / "state"))
        yield found


def test_both_are_seen_and_the_stop_of_one_leaves_the_other_alone(rigs: dict[str, Lab]) -> None:
    for lab in rigs.values():
        lab.station()
    with sync_playwright() as playwright:
        desk = Desk(rigs["left"], playwright)
        desk.serve()
        page = desk.sit_down()
        chosen, word = page.locator("#rig"), page.locator("#rig-state-word")
        for name in NAMES:
            chosen.select_option(name)
            expect(page.locator("#rig-name")).to_have_text(name)
            expect(word).to_have_text("Idle")
        for name, lab in rigs.items():
            jog = lab.lends(*JOG[:2], *WAVE.split(), *JOG[2:])
            lab.stage.wait(
                lambda lab=lab: 0.27 < position_m(lab) < 0.33 and moves_on(lab),  # type: ignore[misc]
                f"the wave of {name}", COMPILE_S,
            )  # fmt: skip
            assert lab.driver() == jog.pid
        for stopped, other in (NAMES, NAMES[::-1]):
            chosen.select_option(stopped)
            expect(page.locator("#rig-name")).to_have_text(stopped)
            expect(word).to_have_text("In use")
            page.keyboard.press("F9")
            rigs[stopped].stage.wait(rigs[stopped].stage.is_safe, f"{stopped} to be safe")
            rigs[stopped].stage.wait(rigs[stopped].is_idle, f"the station of {stopped}")
            expect(word).to_have_text("Idle")
            if stopped == NAMES[0]:
                assert moves_on(rigs[other])
                assert rigs[other].driver() is not None
        for name, lab in rigs.items():
            kept = " ".join(entry["text"] for entry in lab.log)
            (other,) = set(NAMES) - {name}
            assert f"station of {name} started" in kept
            assert other not in kept
            assert len(lab.kept("lent")) == 1
        assert desk.browser is not None
        desk.browser.close()
