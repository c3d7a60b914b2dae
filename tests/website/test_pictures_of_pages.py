"""The pictures of the documentation are those that their commands draw today, and the page names each command."""

from __future__ import annotations

import re

import pytest

from barewire_workbench.cli.labs.repair import RECORDINGS, recording_text
from tests.workbench.pictures.checks import assert_self_contained
from tools import pictures, screens


@pytest.mark.parametrize("name", pictures.ALL)
def test_a_picture_is_up_to_date(name: str) -> None:
    kept = (pictures.FOLDER / name).read_text(encoding="utf-8")
    assert kept == pictures.drawn(pictures.ALL[name]), "run make pictures"
    assert_self_contained(kept)


def test_the_page_shows_each_picture_below_its_command() -> None:
    page = pictures.PAGE.read_text(encoding="utf-8")
    assert sorted(path.name for path in pictures.FOLDER.glob("*.svg")) == sorted([*pictures.ALL, *screens.SCREENS])
    for name, command in pictures.COMMANDS.items():
        between = page.partition(f"```text\n{command}\n```\n")[2].partition("```")[0]
        assert between.split("](", 1)[-1].startswith(f"../pictures/{name})"), name


@pytest.mark.parametrize(
    ("name", "page"),
    [("screen-sniff.svg", "listening-in.md"), ("screen-panel.svg", "panel.md"), ("screen-ramp.svg", "panel.md")],
)
def test_a_screen_has_the_text_that_it_has_today(name: str, page: str) -> None:
    """Its colours and frames are those of Textual, which may change them."""
    kept = (pictures.FOLDER / name).read_text(encoding="utf-8")
    assert not re.search(r"@font-face|@import|href=|https?:(?!//www.w3.org/2000/svg)|url\((?!#)", kept)
    assert f"](../pictures/{name})" in (pictures.ROOT / "docs" / "how-to" / page).read_text(encoding="utf-8")
    pytest.importorskip("textual")
    drawn = screens.text_of(screens.SCREENS[name]())
    assert screens.text_of(kept).split() == drawn.split(), "run make pictures"


@pytest.mark.parametrize("name", pictures.COURSE)
def test_a_page_of_the_course_shows_the_picture(name: str) -> None:
    (page,) = (pictures.ROOT / "docs" / "tutorial").glob(f"{name[4:6]}-*.md")
    assert f"](../pictures/{name})" in page.read_text(encoding="utf-8")


def test_the_recording_of_lab_10_is_that_of_the_command() -> None:
    (recording,) = (recording for recording in RECORDINGS if recording.name == "line-2.log")
    assert (pictures.FOLDER / recording.name).read_text(encoding="utf-8") == recording_text(recording)
