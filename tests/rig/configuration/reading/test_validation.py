"""Sections with the same keys share a schema; what one section holds is nothing to the next."""

from pathlib import Path
from typing import Annotated, Any

from rig.configuration.reading.document import Sources
from rig.configuration.reading.fields import Physical
from rig.configuration.reading.validation import checked


def section(folder: Path, text: str, highest: float = 1.0) -> tuple[dict[str, Any], list[str]]:
    """Return what a section with a length and a name holds, and the problems with it."""
    path = folder / "section.yaml"
    path.write_text(text)
    sources = Sources()
    root = sources.read_yaml(path)
    assert root is not None
    fields = {"length": Annotated[Any, Physical("m", 0.0, highest)], "name": Any}
    return checked(root, fields), [str(problem) for problem in sources.problems.found]


def test_a_section_that_was_wrong_leaves_nothing_to_a_like_one(tmp_path: Path) -> None:
    values, problems = section(tmp_path, "length: 2 m\nnmae: a\n")
    assert values == {"length": None, "name": None}
    assert len(problems) == 2
    assert section(tmp_path, "length: 20 cm\n") == ({"length": 0.2, "name": None}, [])
    assert section(tmp_path, "name: b\n") == ({"length": None, "name": "b"}, [])


def test_like_keys_with_other_limits_have_these_limits(tmp_path: Path) -> None:
    assert len(section(tmp_path, "length: 2 m\n")[1]) == 1
    assert section(tmp_path, "length: 2 m\n", highest=3.0) == ({"length": 2.0, "name": None}, [])
