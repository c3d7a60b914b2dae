"""What forbids a release, and the links of the descriptions. `.ci/run` builds a whole one."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tools import release
from tools.release import EXAMPLE, LINK, ROOT, problems, version, with_addresses


def test_both_descriptions_have_links_that_work_on_an_index() -> None:
    for page in ("README.md", "workbench/README.md"):
        text = (ROOT / page).read_text(encoding="utf-8")
        assert LINK.findall(text)
        assert not LINK.findall(with_addresses(text, f"https://forge.example/v1/{page}"))
    picture = with_addresses("![a](b.svg), [c](d.md)", "https://forge.example/x/blob/v1/README.md")
    assert picture == "![a](https://forge.example/x/raw/v1/b.svg), [c](https://forge.example/x/blob/v1/d.md)"
    assert with_addresses("[a](../b.md#c) [d](#e) [f](https://g.example/)", "https://forge.example/v1/h/README.md") == (
        "[a](https://forge.example/v1/b.md#c) [d](#e) [f](https://g.example/)"
    )


def test_versions_agree() -> None:
    """Everything but the changelog and the state of the checkout, which are those of the day of the release."""
    assert not [problem for problem in problems(version()) if "version" in problem and "tag" not in problem]


def test_what_forbids_a_release(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(release, "run", lambda *command: "v9.9" if "tag" in command else " M README.md")
    now = version()
    assert problems("9.9") == [
        f"workbench/pyproject.toml has version {now}, pyproject.toml 9.9",
        f"integrations/modbus-connection/pyproject.toml has version {now}, pyproject.toml 9.9",
        'src/barewire/__init__.py has no line __version__ = "9.9"',
        'workbench/src/barewire_workbench/__init__.py has no line __version__ = "9.9"',
        "CHANGELOG.md has no section ## [9.9]",
        "there are changes that are not committed: git status",
        "the tag v9.9 exists: this version was released",
    ]


def test_a_dry_run_says_that_what_would_forbid_a_release_does_not_end_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(release, "problems", lambda version: ["no section"])
    monkeypatch.setattr(release, "build", lambda *_: None)
    for flags, status in (([], 1), (["--dry-run"], 0)):
        monkeypatch.setattr(sys, "argv", ["release", "--files", EXAMPLE, "--to", str(tmp_path / "new"), *flags])
        assert release.main() == status
    assert capsys.readouterr().err.splitlines() == [
        "this forbids a release: no section",
        "this would forbid a release: no section",
        "this is a dry run: the files are built and tried all the same",
    ]


def test_the_page_names_every_file() -> None:
    page = (ROOT / "packaging" / "README.md").read_text(encoding="utf-8")
    for name in (f"barewire-{version()}.tar.gz", f"barewire-{version()}.pyz", f"barewire_workbench-{version()}.tar.gz"):
        assert f"`{name}`" in page
