"""Makes a picture of one leak test from a run's report, with its plots from motion to leak flow.

`python -m tools.pages.readme_picture RUN_DIR OUT.png` reads `RUN_DIR/report.html`, as `rig run`
writes it, and needs Chromium. The picture shows the first test that found an injected leak.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from html.parser import HTMLParser
from pathlib import Path
from typing import Final

WIDTH, HEIGHT = 1400, 1000
PANELS: Final = ("motion", "pressures", "missing_flow", "leak_flow")
BROWSERS: Final = (
    "chromium-headless-shell",  # has no windows, and starts at a fraction of the cost
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
)
TIMEOUT_S: Final = 120.0

_STYLE: Final = """
  body {{ max-width: none; padding: 14px 26px; }}
  body > header, body > footer, main > section:not(#tests), #tests > :not(#{test}),
  #{test} > summary > .quiet, #{test} .facts, #{test} .marks, #{test} .more, #{test} .body > .quiet,
  .panel figcaption p, .panel:not({panels}), .modebar, .plot::after {{ display: none !important; }}
  .test {{ margin: 0; border: 0; }}
  .test > summary {{ padding: 0 0 4px; font-size: 20px; list-style: none; }}
  .test .body {{ padding: 0; }}
  .story {{ max-width: none; margin: 0; font-size: 1rem; }}
  .panel {{ margin: 10px 0 0; }}
  .panel figcaption, .keys {{ display: inline-flex; vertical-align: middle; margin-right: 24px; }}
  .plot {{ height: 186px; }}
  .panel:first-child .plot {{ height: 200px; }}
"""
_SCRIPT: Final = """
  for (const test of document.querySelectorAll("details.test")) test.open = test.id === "{test}";
"""


class _LeakTests(HTMLParser):
    """A parser of reports that collects the ids of the tests that found an injected leak.

    Attributes:
        found: the ids of their HTML elements, in the order of the report.
    """

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Add the element's id to `found` if it is such a test."""
        attributes = dict(attrs)
        leaking = "leakage" in (attributes.get("data-injected") or "")
        if tag == "details" and leaking and attributes.get("data-status") == "passed":
            self.found.append(attributes.get("id") or "")


def staged(report: str) -> str:
    """Return the HTML of a report, changed to show only the first test that found an injected leak.

    Of the test's plots, those in `PANELS` are shown.

    Raises:
        ValueError: no test of the report found an injected leak, or the text is no whole report.
    """
    parser = _LeakTests()
    # After the last section there is only plotly's code, which takes long to parse.
    parser.feed(report[: report.index("<footer>")])
    if not parser.found:
        raise ValueError("no test of this report found an injected leak; run one that does")
    test = parser.found[0]
    panels = ", ".join(f'[data-panel="{panel}"]' for panel in PANELS)
    head, body = report.split("</head>", 1)
    style = f"<style>{_STYLE.format(test=test, panels=panels)}</style>"
    before, after = body.rsplit("</body>", 1)
    return f"{head}{style}</head>{before}<script>{_SCRIPT.format(test=test)}</script></body>{after}"


def browser() -> str:
    """Return the path of the first program in `BROWSERS` (Chromium or Chrome) that is installed.

    Raises:
        ValueError: none of them is on the search path.
    """
    for name in BROWSERS:
        if path := shutil.which(name):
            return path
    raise ValueError(
        "no Chromium here, which takes the picture; on Debian: "
        "sudo apt install chromium-headless-shell"
    )


def photograph(page: Path, picture: Path) -> None:
    """Write a screenshot (PNG, 1400 x 1000) of the HTML file `page` to `picture`, by `browser()`.

    An earlier `picture` is deleted first.

    Raises:
        ValueError: there is no browser, it took no picture, or it took longer than `TIMEOUT_S` and
            was killed.
    """
    with tempfile.TemporaryDirectory() as profile:
        command = [
            browser(), "--headless", "--disable-gpu", "--no-first-run", "--hide-scrollbars",
            "--disable-background-networking", "--disable-component-update", "--disable-sync",
            f"--user-data-dir={profile}", f"--window-size={WIDTH},{HEIGHT}",
            "--virtual-time-budget=10000", f"--screenshot={picture.resolve()}",
        ]  # fmt: skip
        if os.geteuid() == 0:
            command.append("--no-sandbox")  # Chromium does not start as root without this.
        picture.unlink(missing_ok=True)
        try:
            done = subprocess.run(
                [*command, page.resolve().as_uri()],
                capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise ValueError(
                f"Chromium ({command[0]}) took no picture within {TIMEOUT_S:g} s and was ended; "
                "run this again when the machine is less busy, or install another Chromium"
            ) from None
    if not picture.exists():
        raise ValueError(
            f"Chromium took no picture (exit {done.returncode}):\n{done.stderr[-2000:]}"
        )


def main() -> None:
    """Take the picture; end with a message if report, leak test, browser or picture is missing.

    A browser that hangs takes no picture either.
    """
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "run", type=Path, metavar="RUN_DIR", help="folder of a run, with its report"
    )
    parser.add_argument("picture", type=Path, metavar="OUT.png")
    given = parser.parse_args()
    report = given.run / "report.html"
    try:
        page = staged(report.read_text(encoding="utf-8"))
        with tempfile.TemporaryDirectory() as folder:
            stage = Path(folder) / "stage.html"
            stage.write_text(page, encoding="utf-8")
            photograph(stage, given.picture)
    except FileNotFoundError as error:
        sys.exit(f"{error.filename}: does not exist; run a campaign with --out {given.run} first")
    except ValueError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
