"""The pictures of the documentation are those that their commands draw today, and the page names each command."""

from __future__ import annotations

import pytest

from tests.explain.pictures.checks import assert_self_contained
from tools import pictures


@pytest.mark.parametrize("name", pictures.COMMANDS)
def test_a_picture_is_up_to_date(name: str) -> None:
    kept = (pictures.FOLDER / name).read_text(encoding="utf-8")
    assert kept == pictures.drawn(pictures.COMMANDS[name]), "run make pictures"
    assert_self_contained(kept)


def test_the_page_shows_each_picture_below_its_command() -> None:
    page = pictures.PAGE.read_text(encoding="utf-8")
    assert sorted(path.name for path in pictures.FOLDER.glob("*.svg")) == sorted(pictures.COMMANDS)
    for name, command in pictures.COMMANDS.items():
        between = page.partition(f"```text\n{command}\n```\n")[2].partition("```")[0]
        assert between.split("](", 1)[-1].startswith(f"../pictures/{name})"), name
