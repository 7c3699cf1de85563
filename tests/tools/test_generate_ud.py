"""The generated UD code is the one its generator writes."""

from tools.generate_ud import TARGET, source


def test_the_committed_module_is_what_the_generator_writes() -> None:
    assert TARGET.read_text(encoding="utf-8") == source()
