"""Links of the repository as links of the site."""

from __future__ import annotations

from pathlib import Path

import pytest

from tools.website.links import Links

TEXT = "See [a\n[b]](TARGET), `[c](TARGET)`.\n\n```text\n[d](TARGET)\n```\n"


@pytest.mark.parametrize(
    ("file", "target", "found"),
    [
        ("docs/how-to/tls.md", "modbus.md#a-server", "modbus.md#a-server"),
        ("docs/how-to/tls.md", "../../vectors/README.md", "../vectors/readme.md"),
        ("README.md", "docs/how-to/tls.md", "../how-to/tls.md"),
        ("docs/explanation/crc.md", "../../src/barewire/rtu/crc.py", "../reference/api/rtu.rst"),
        ("docs/explanation/crc.md", "../../src/barewire/rtu/__init__.py", "../reference/api/rtu.rst"),
        (
            "docs/explanation/crc.md",
            "../../workbench/src/barewire_workbench/steps/checksums.py",
            "../reference/api/workbench.steps.rst",
        ),
        ("docs/explanation/crc.md", "../../Makefile", "../files/Makefile.md"),
        ("docs/explanation/crc.md", "../../vectors/index.json", "../files/vectors/index.json"),
        ("README.md", "https://example.org/a.md", "https://example.org/a.md"),
        ("README.md", "#two-commands", "#two-commands"),
    ],
)
def test_a_link_leads_to_the_page(file: str, target: str, found: str) -> None:
    links = Links()
    text = links.rewritten(TEXT.replace("TARGET", target), file)
    assert text.startswith(f"See [a\n[b]]({found}), ")
    assert text.endswith(f"```text\n[d]({target})\n```\n"), "a block of code stays as it is"
    assert links.files == ({found.removeprefix("../files/").removesuffix(".md")} if "files" in found else set())


def test_a_link_to_a_folder_becomes_text(tmp_path: Path) -> None:
    (tmp_path / "docs").mkdir()
    (tmp_path / "adapters").mkdir()
    assert Links(tmp_path).rewritten("[the adapters](../adapters)\n", "docs/a.md") == "the adapters\n"
