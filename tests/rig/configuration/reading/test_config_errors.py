"""Bad files: every mistake at once, each at its line, and never anything but a `ConfigError`."""

import contextlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, strategies as st

from rig.configuration import ConfigError, Problem, load_campaign
from rig.configuration.checking import check
from rig.configuration.reading import document
from rig.configuration.reading.document import MAX_BYTES
from rig.configuration.reading.lookup import copy_shipped, shipped_config_dir

BAD_CAMPAIGN = """\
name: bad
rig: rig.yaml
modle: nominal
detector: {filter: thesis-8}
defaults:
  duration: 40 s
tests:
  - name: fast
    duration: 3 s
    setpoint: {type: sine, mean: 0.5 m, amplitude: 0.2 m, frequency: 0.5 Hz}
  - name: mixed
    setpoint: {type: sine, mean: 0.3 m, amplitude: 2 V, frequency: 0.5 Hz}
    expect: healty
    faults:
      - type: external_leakage_2
        at: 50 s
        flow: 0.3 L/min
      - {type: internal_leakage, at: 18 s, coefficient: 4e-9 m^3/(s Pa)}
  - name: mixed
    setpoint: {type: constant, value: 12 V}
    duration: 20 s
    duration: 30 s
  - name: ${level}
    matrix: {flow: [0.3 L/min, 0.8 L/min]}
    setpoint: {type: constant, value: 0.3 m}
"""
BAD_RIG = """\
name: bad
plant:
  model: nominal
  parameters:
    supply_pressure: 138 MPa
    spool_null_bias: 3 um
    viscus: 350 N s/m
bypass_valves:
  external_leakage_2: {needle: {maximum: 2e-8 m^3/(s Pa^0.5)}}
limits:
  position: [5 mm, 0.6 m]
  pressure: 20 bar
"""


@pytest.fixture
def bad(tmp_path: Path) -> list[Problem]:
    (tmp_path / "rig.yaml").write_text(BAD_RIG)
    path = tmp_path / "campaign.yaml"
    path.write_text(BAD_CAMPAIGN)
    with pytest.raises(ConfigError) as caught:
        check(path)
    return caught.value.problems


def test_every_mistake_of_all_files_is_reported_at_once_at_its_line(bad: list[Problem]) -> None:
    assert [(Path(p.path).name, p.line, p.column, p.field) for p in bad] == [
        ("campaign.yaml", 3, 1, "modle"),
        ("campaign.yaml", 4, 12, "filter"),
        ("campaign.yaml", 9, 5, "duration"),
        ("campaign.yaml", 10, 5, "setpoint"),
        ("campaign.yaml", 12, 5, "setpoint"),
        ("campaign.yaml", 13, 5, "expect"),
        ("campaign.yaml", 16, 9, "at"),
        ("campaign.yaml", 17, 9, "flow"),
        ("campaign.yaml", 18, 10, "type"),
        ("campaign.yaml", 18, 44, "coefficient"),
        ("campaign.yaml", 19, 5, "name"),
        ("campaign.yaml", 20, 5, "setpoint"),
        ("campaign.yaml", 22, 5, "duration"),
        ("campaign.yaml", 23, 5, "name"),
        ("rig.yaml", 5, 5, "supply_pressure"),
        ("rig.yaml", 6, 5, "spool_null_bias"),
        ("rig.yaml", 7, 5, "viscus"),
        ("rig.yaml", 12, 3, "pressure"),
    ]


def test_a_mistake_reads_as_one_line_with_value_limit_and_remedy(bad: list[Problem]) -> None:
    lines = str(ConfigError(bad)).splitlines()
    assert len(lines) == len(bad)
    assert lines[14].endswith(
        "rig.yaml:5:5 supply_pressure: 138 MPa is above 35 MPa; did you mean 13.8 MPa?"
    )


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "is not a mapping"),
        (b"- a\n- b\n", "is not a mapping"),
        (b"a: [1, 2\nb: 3\n", "cannot be parsed"),
        (b"a: 1\n---\nb: 2\n", "cannot be parsed"),
        (b"name: \xff\xfe\n", "cannot be parsed"),
        (b"name: &a [*a]\n", "contains itself"),
        (b"name: " + b"[" * 2000, "cannot be parsed"),
        (b"name: " + b"[" * 40 + b"]" * 40, "nested too deeply"),
        (b"name: !!python/object:os.system x\ntests: 1\n", "cannot be read"),
        (b"name: 2024-13-45\ntests: 1\n", "cannot be read"),
        (b"tests: 1\n? [a, b]\n: 1\n", "is not a known key"),
        (b"a: \t- x\n", "cannot be parsed"),
    ],
)
def test_a_file_that_is_no_yaml_mapping_is_an_error_with_a_place(
    tmp_path: Path, content: bytes, reason: str
) -> None:
    path = tmp_path / "broken.yaml"
    path.write_bytes(content)
    with pytest.raises(ConfigError) as caught:
        check(path)
    assert any(reason in str(problem) for problem in caught.value.problems)
    assert all(problem.line >= 1 for problem in caught.value.problems)


@pytest.mark.long
def test_a_short_file_that_unfolds_without_end_is_refused(tmp_path: Path) -> None:
    levels = "".join(f"l{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 9)}]\n" for i in range(1, 9))
    path = tmp_path / "bomb.yaml"
    path.write_text("l0: &l0 [x]\n" + levels)
    with pytest.raises(ConfigError, match="too large"):
        check(path)


@pytest.mark.parametrize(
    "file",
    [
        "campaigns/quickstart.yaml", "rigs/emulated.yaml", "models/nominal.yaml",
        "schedules/nightly.yaml", "maps/io_node.yaml", "stream/mtls.yaml",
    ],
)  # fmt: skip
def test_a_bomb_in_a_file_of_any_kind_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: str
) -> None:
    monkeypatch.setattr(document, "MAX_VALUES", 5000)  # the true limit takes a second to reach
    levels = "".join(f"l{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 9)}]\n" for i in range(1, 9))
    path = tmp_path / Path(file).name
    shipped = (shipped_config_dir() / file).read_text()
    path.write_text(f"{shipped}\nl0: &l0 [x]\n{levels}")
    with pytest.raises(ConfigError, match="too large"):
        check(path)


def test_a_giant_file_is_refused_unparsed(tmp_path: Path) -> None:
    path = tmp_path / "giant.yaml"
    path.write_bytes(b"name: " + b"x" * MAX_BYTES)
    with pytest.raises(ConfigError, match="is larger than 8 MB"):
        check(path)


# One thing changed in a file that works: a clean result or a ConfigError, nothing else.

FILES = (
    "campaigns/quickstart.yaml",
    "campaigns/loaded_7_2.yaml",
    "rigs/simulated.yaml",
    "models/nominal.yaml",
)
MUTATED = [
    pytest.param(name, marks=pytest.mark.long) if "loaded" in name else name for name in FILES
]
JUNK: st.SearchStrategy[Any] = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=12),
    st.sampled_from(
        ["3 V", "0.3 m", "-1 s", "1e300 MPa", "${level}", "${", "none", "nominal", "../..", "+5 %"]
    ),
    st.lists(st.integers(), max_size=3),
    st.dictionaries(st.text(max_size=4), st.integers(), max_size=2),
    st.just([[]]),
    st.just({"type": "sine"}),
)


def places(value: Any) -> list[tuple[Any, Any]]:
    """Return every (container, key or index) of a parsed file."""
    entries = list(value.items()) if isinstance(value, dict) else []
    entries += list(enumerate(value)) if isinstance(value, list) else []
    return [(value, key) for key, _ in entries] + [
        place for _, inner in entries for place in places(inner)
    ]


def replace(container: Any, key: Any, junk: Any) -> None:
    container[key] = junk


def delete(container: Any, key: Any, junk: Any) -> None:
    del container[key]


def rename(container: Any, key: Any, junk: Any) -> None:
    if isinstance(container, dict):
        container[str(junk)] = container.pop(key)


@pytest.mark.parametrize("name", MUTATED)
@given(data=st.data(), mutation=st.sampled_from([replace, replace, delete, rename]), junk=JUNK)
def test_a_mutated_file_is_checked_or_refused(
    tmp_path_factory: pytest.TempPathFactory,
    name: str,
    data: st.DataObject,
    mutation: Callable[[Any, Any, Any], None],
    junk: Any,
) -> None:
    content = yaml.safe_load((shipped_config_dir() / name).read_text())
    container, key = data.draw(st.sampled_from(places(content)))
    mutation(container, key, junk)
    path = tmp_path_factory.mktemp("mutated") / Path(name).name
    path.write_text(yaml.safe_dump(content))
    with contextlib.suppress(ConfigError):
        assert str(check(path))


@pytest.mark.parametrize("name", MUTATED)
@given(
    position=st.floats(0.0, 1.0),
    length=st.integers(0, 8),
    inserted=st.text(alphabet="abc019 :-[]{}&*!|>'\"%@`#\n\t,.${}\x00\x85", max_size=4),
)
def test_a_file_with_a_typing_slip_is_checked_or_refused(
    tmp_path_factory: pytest.TempPathFactory, name: str, position: float, length: int, inserted: str
) -> None:
    text = (shipped_config_dir() / name).read_text()
    start = round(position * len(text))
    path = tmp_path_factory.mktemp("slipped") / Path(name).name
    path.write_text(text[:start] + inserted + text[start + length :])
    with contextlib.suppress(ConfigError):
        assert str(check(path))


def test_a_mistake_in_a_parent_is_reported_at_the_parent(tmp_path: Path) -> None:
    copy_shipped(tmp_path)
    model = tmp_path / "models" / "nominal.yaml"
    model.write_text(model.read_text().replace("689 MPa", "689 GPa"))
    with pytest.raises(ConfigError) as caught:
        check(tmp_path / "campaigns" / "simulation_7_1.yaml")
    assert [Path(problem.path).name for problem in caught.value.problems] == ["nominal.yaml"]


def test_a_device_that_has_no_end_is_not_read(tmp_path: Path) -> None:
    sine = "{type: file, path: /dev/zero}"
    path = tmp_path / "campaign.yaml"
    path.write_text(f"name: endless\nrig: simulated\ntests:\n  - {{name: a, setpoint: {sine}}}\n")
    with pytest.raises(ConfigError, match="cannot be read: it is a device; check the path"):
        load_campaign(path)
