from pathlib import Path

import pytest

from tools.pages import readme_picture
from tools.pages.readme_picture import browser, main, staged


def report(*tests: tuple[str, str]) -> str:
    sections = "".join(
        f'<details class="test" id="test-{number}" data-status="{status}" '
        f'data-injected="{injected}"></details>'
        for number, (status, injected) in enumerate(tests, 1)
    )
    return (
        f"<html><head></head><body>{sections}<footer></footer><script>plot()</script></body></html>"
    )


def test_the_picture_is_of_the_first_leak_that_was_found() -> None:
    page = staged(
        report(
            ("passed", ""),
            ("failed", "external_leakage_1"),
            ("passed", "return_blockage"),
            ("passed", "internal_leakage"),
            ("passed", "external_leakage_2"),
        )
    )
    assert 'test.id === "test-4"' in page
    assert "#tests > :not(#test-4)" in page


def test_the_stage_is_set_before_the_page_is_drawn_and_the_test_opened_after() -> None:
    page = staged(report(("passed", "internal_leakage")))
    assert page.index("<style>") < page.index("</head>")
    assert page.index("plot()") < page.index('test.id === "test-1"') < page.index("</body>")


def test_a_report_without_a_found_leak_makes_no_picture() -> None:
    with pytest.raises(ValueError, match="no test of this report found an injected leak"):
        staged(report(("passed", ""), ("failed", "internal_leakage")))


def test_a_machine_without_chromium_is_told_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ValueError, match="sudo apt install chromium"):
        browser()


def test_a_folder_without_a_report_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("sys.argv", ["readme_picture", str(tmp_path), str(tmp_path / "out.png")])
    with pytest.raises(SystemExit, match=r"report\.html: does not exist"):
        main()


def test_a_browser_that_hangs_is_ended_and_told_of(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    hanging = tmp_path / "chromium"
    hanging.write_text("#!/bin/sh\nexec /bin/sleep 600\n")
    hanging.chmod(0o755)
    (tmp_path / "report.html").write_text(report(("passed", "internal_leakage")))
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(readme_picture, "TIMEOUT_S", 0.1)
    monkeypatch.setattr("sys.argv", ["readme_picture", str(tmp_path), str(tmp_path / "out.png")])
    with pytest.raises(SystemExit, match=r"took no picture within 0\.1 s"):
        main()
