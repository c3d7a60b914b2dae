"""The screens, sheets and solutions of the labs: complete, made of commands that run, and readable in Chromium.

Each page is opened from its file, checked by axe-core at the widths of a phone and of a desk, light and dark, and
printed.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from typing import Any, Literal

import pytest
from playwright.sync_api import Browser, Page, expect

from barewire_workbench.cli.labs import LABS
from barewire_workbench.cli.labs.model import Lab, LabExercise
from tests.test_docs import blocks, commands, run_page
from tests.test_terminals import run_terminals, typed_blocks
from tools.website import classroom
from tools.website.browser import chromium
from tools.website.explorer import pyodide_folder
from tools.website.source import ROOT

pytestmark = pytest.mark.long

LAB_IDS = [f"lab {number}" for number in LABS]
TASK = re.compile(r"barewire lab (\d+) check (\d+\.\d+) ANSWER")


def text_of(html: str) -> str:
    return " ".join(
        unescape(re.sub(r"<style>.*?</style>|<script>.*?</script>|<[^>]+>", "", html, flags=re.DOTALL)).split()
    )


def task_of(exercise: LabExercise) -> str:
    return " ".join(exercise.task.replace("`", "").split())


def commands_that_run(lab: Lab) -> list[list[str]]:
    """The commands of a page of the course that test_docs.py and test_terminals.py run, as words."""
    page = ROOT / "docs" / "tutorial" / lab.page
    console = [block for block in blocks(page.read_text(encoding="utf-8")) if block.language == "console"]
    typed = [line for found in typed_blocks(page).values() for block in found for line in block.text.splitlines()[1:]]
    return [*(command.words for block in console for command in commands(block)), *map(shlex.split, typed)]


# What is on the pages ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("lab", LABS.values(), ids=LAB_IDS)
def test_the_screens_have_the_whole_page_and_each_task(lab: Lab) -> None:
    screens = text_of(classroom.projected(lab))
    page = (ROOT / "docs" / "tutorial" / lab.page).read_text(encoding="utf-8")
    for block in blocks(page):
        if not block.text.startswith(f"$ barewire lab {lab.number}\n"):
            assert " ".join(block.text.split()) in screens
    for heading in re.findall(r"^#+ (.*)$", re.sub(r"```.*?```", "", page, flags=re.DOTALL), re.MULTILINE):
        assert heading in screens or heading == "Exercises"
    assert [number for _, number in TASK.findall(screens)] == [exercise.number for exercise in lab.exercises]
    assert all(task_of(exercise) in screens for exercise in lab.exercises)


@pytest.mark.parametrize("lab", LABS.values(), ids=LAB_IDS)
def test_the_sheet_has_each_task_with_room_and_no_solution(lab: Lab) -> None:
    sheet = classroom.sheet(lab)
    assert sheet.count('<div class="room">') == 3 * len(lab.exercises)
    tasks, looked_up = (text_of(part) for part in sheet.split("<h2>To look up</h2>"))
    for exercise in lab.exercises:
        assert task_of(exercise) in tasks
        tasks = tasks.replace(task_of(exercise), "").replace(exercise.form, "")
    solutions = [exercise.solution for exercise in lab.exercises if len(exercise.solution) > 3]
    assert not [text for text in solutions if text in tasks and text not in lab.devices[-1]]
    page = (ROOT / "docs" / "tutorial" / lab.page).read_text(encoding="utf-8")
    assert all(" ".join(block.text.split()) in looked_up for block in blocks(page) if block.language == "text")


@pytest.mark.parametrize("lab", LABS.values(), ids=LAB_IDS)
def test_every_command_on_screens_and_sheet_runs(lab: Lab) -> None:
    """It is one of the page, which other tests run, or the check of an exercise, of which the solutions have one."""
    known = commands_that_run(lab)
    codes = re.findall(r"<pre\b.*?</pre>", classroom.projected(lab), re.DOTALL)
    codes += re.findall(r"<code>.*?</code>", classroom.sheet(lab), re.DOTALL)
    lines = [line.removeprefix("$ ") for code in codes for line in unescape(re.sub(r"<[^>]+>", "", code)).splitlines()]
    shown = [line for line in lines if re.match(r"barewire \w", line)]
    assert len(shown) >= 2 * len(lab.exercises)
    for line in shown:
        task = TASK.fullmatch(line)
        assert shlex.split(line) in known or (task and lab.exercise(task[2])), line


def test_each_exercise_has_a_solution_that_the_command_finds_right(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = classroom.solutions()
    for lab in LABS.values():
        for exercise in lab.exercises:
            assert f"**{exercise.number}** {exercise.task}\n" in page
            assert f'barewire lab {lab.number} check {exercise.number} "{exercise.solution}"' in page
    monkeypatch.chdir(tmp_path)
    assert run_page(page, "solutions.md") == ""


@pytest.mark.proof  # half a minute of a slow line
def test_the_solutions_that_need_a_machine_are_right(tmp_path: Path) -> None:
    for number, part in enumerate(re.split(r"^## ", classroom.solutions(), flags=re.MULTILINE)):
        page = tmp_path / f"{number}.md"
        page.write_text(part, encoding="utf-8")
        if typed_blocks(page):
            assert "right:" in run_terminals(page, tmp_path)[2]


def test_only_the_teachers_page_leads_to_the_solutions() -> None:
    pages = [path for path in (ROOT / "docs").rglob("*.md") if "class/solutions" in path.read_text(encoding="utf-8")]
    assert [path.name for path in pages] == ["teach.md"]
    assert (ROOT / "docs" / "how-to" / "teach.md").read_text(encoding="utf-8").count(classroom.TABLE_PLACE) == 1
    assert all(f"{lab.page.removesuffix('.md')}-sheet.html" in classroom.table() for lab in LABS.values())


# In a browser ------------------------------------------------------------------------------------------------------

in_browser = pytest.mark.needs("chromium")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("class")
    classroom.build(target)
    return target


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


@pytest.fixture
def page(browser: Browser) -> Iterator[Page]:
    """Yield a page; its errors and requests to anything but files fail the test at the end."""
    page = browser.new_page(viewport={"width": 1280, "height": 720})
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on(
        "request", lambda request: None if request.url.startswith(("file:", "data:")) else faults.append(request.url)
    )
    yield page
    page.close()
    assert faults == []


def opened(page: Page, folder: Path, name: str) -> None:
    page.goto((folder / f"{name}.html").as_uri())
    page.wait_for_function("document.readyState === 'complete'")


@in_browser
@pytest.mark.parametrize("lab", LABS.values(), ids=LAB_IDS)
def test_each_screen_fits_a_projector_in_large_type_and_each_sheet_two_pages(
    page: Page, folder: Path, lab: Lab
) -> None:
    name = lab.page.removesuffix(".md")
    opened(page, folder, name)
    heights = page.evaluate("[...document.querySelectorAll('section')].map(screen => screen.offsetHeight)")
    pictures = page.evaluate("[...document.querySelectorAll('img')].filter(image => image.height > 0.8 * 720).length")
    assert len([height for height in heights if height != 720]) == pictures, "a high picture scrolls"
    sizes = page.evaluate(
        "[...document.querySelectorAll('p, li, td, pre')].map(e => parseFloat(getComputedStyle(e).fontSize))"
    )
    assert min(sizes) >= 14, "a fiftieth of the height of the screen"
    opened(page, folder, f"{name}-sheet")
    assert len(re.findall(rb"/Type\s*/Page\b", page.pdf(prefer_css_page_size=True))) == 2
    colours = page.evaluate("[...document.querySelectorAll('body, body *')].map(e => getComputedStyle(e).color)")
    assert set(colours) == {"rgb(0, 0, 0)"}


@in_browser
def test_keys_go_from_screen_to_screen(page: Page, folder: Path) -> None:
    opened(page, folder, "03-a-register-read-by-hand")
    for key, number in (
        ("ArrowRight", 2),
        ("PageDown", 3),
        (" ", 4),
        ("ArrowLeft", 3),
        ("End", 19),
        ("ArrowDown", 19),
        ("Home", 1),
    ):
        page.keyboard.press(key)
        expect(page.locator(f"[id='{number}'] > :first-child")).to_be_in_viewport()
        assert page.url.endswith(f"#{number}")


@in_browser
def test_keys_scroll_through_a_picture_that_is_higher_than_the_window(page: Page, folder: Path) -> None:
    opened(page, folder, "10-a-broken-line")
    number = page.locator("section", has=page.get_by_role("img", name="The messages of line-2.log")).get_attribute("id")
    page.evaluate(f"document.getElementById('{number}').scrollIntoView()")
    places = []
    while page.url.partition("#")[2] != str(int(number or "") + 1):
        page.keyboard.press("ArrowRight")
        places.append(page.evaluate("scrollY"))
        assert len(places) < 20
    assert len(places) > 2
    assert places == sorted(set(places))
    page.keyboard.press("ArrowLeft")
    assert page.evaluate(f"document.getElementById('{number}').getBoundingClientRect().top") == 0


LOOKS: list[tuple[int, Literal["light", "dark"]]] = [(390, "light"), (1280, "dark"), (390, "dark"), (1280, "light")]


@in_browser
@pytest.mark.parametrize("look", LOOKS, ids=str)
@pytest.mark.parametrize("share", [4, pytest.param(1, marks=pytest.mark.proof)])
def test_nothing_serious_is_inaccessible_or_outside_the_window(
    page: Page, folder: Path, look: tuple[int, Literal["light", "dark"]], share: int
) -> None:
    """A quarter of the pages in each look, so that each page is seen in one; all pages in all looks with `-m proof`."""
    width, scheme = look
    page.set_viewport_size({"width": width, "height": 720})
    page.emulate_media(color_scheme=scheme)
    axe = (Path(pyodide_folder()).parent / "axe-core" / "axe.min.js").read_text(encoding="utf-8")
    files = sorted(folder.glob("*.html"), key=lambda file: (file.stem.endswith("-sheet"), file.name))
    for file in files[LOOKS.index(look) % share :: share]:
        opened(page, folder, file.stem)
        assert page.evaluate("document.documentElement.scrollWidth") <= width, file.name
        page.evaluate(axe)
        found: dict[str, Any] = page.evaluate("axe.run({resultTypes: ['violations']})")
        serious = [
            f"{violation['id']}: {node['html'][:120]}"
            for violation in found["violations"]
            if violation["impact"] in ("serious", "critical")
            for node in violation["nodes"]
        ]
        assert serious == [], file.name
