"""The Python lines of README.md, and values that are read, pass mypy --strict in a program that uses barewire."""

from __future__ import annotations

from pathlib import Path

import pytest

import barewire
from tests.test_docs import blocks

mypy = pytest.importorskip("mypy.api")
pytestmark = pytest.mark.long

ROOT = Path(__file__).parent.parent

VALUES = """
import barewire

with barewire.connect("az3", "can://memory/types?node=5") as az3:
    reading = az3.read("TARGET VELOCITY")
    if reading.number > 5:
        print(reading.number + 1, reading.text.upper())
"""
"""The value of a reading is a number, a text or bytes: strict checkers want to know which."""


def test_the_lines_of_the_readme_and_typed_values(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = Path(barewire.__file__).parent.parent
    monkeypatch.setenv("MYPYPATH", str(source))
    monkeypatch.chdir(tmp_path)  # no settings of this project: those of a user
    programs = [VALUES, VALUES.replace("reading.number", "reading.value")]
    readme = (ROOT / "README.md").read_text("utf-8")
    programs += [block.text for block in blocks(readme) if block.language == "python"]
    files = [tmp_path / f"program_{number}.py" for number in range(len(programs))]
    for file, program in zip(files, programs):
        file.write_text(program)
    options = ["--strict", "--follow-imports=silent", "--cache-dir", str(tmp_path / "cache"), "--config-file="]
    output, errors, _ = mypy.run([*options, *map(str, files)])
    assert errors == ""
    wrong = {line.partition(":")[0] for line in output.splitlines() if ": error:" in line}
    assert wrong == {"program_1.py"}, output  # `value > 5` is what they refuse
