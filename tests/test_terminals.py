"""Types the shell blocks of the documentation into terminals, as a reader does who pastes them from top to bottom.

A block of the language `sh` whose first line is a comment `# terminal N` is typed into the terminal of that number, a
bash on a pseudo-terminal. `until Ctrl-C` in that comment says that the last command runs on; the test waits for its
first output, and presses Ctrl-C at the end of the page. Every other command must end with status 0. So a block that
would block its terminal, needs what the page has not made yet, or hides a command behind another one is found.

A block of the language `output` behind such a block is what its commands print, in the form of the `console` blocks of
tests/test_docs.py: a line `...` stands for any number of lines. Their status is not checked then: a command that fails
shows why. Of a command that runs until Ctrl-C, the block has the first lines.

Ports and paths below /tmp are replaced by free ones: another program may have taken those that the page prints.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from tests.helpers import free_port, some_of
from tests.test_docs import PAGES, ROOT, Block, blocks, fits, named

pytestmark = pytest.mark.long

PROMPT = re.compile(r"\[(\d+)\]% $")
"""The prompt of the terminals: the status of the command before it."""

LIMIT = 60.0
"""Seconds for one command."""

STAYS = 0.3
"""Seconds after its first output in which a command that runs until Ctrl-C must not end."""

# bash gets the terminal as its controlling terminal: Ctrl-C becomes SIGINT of the command that runs in it.
SHELL = """
import fcntl, os, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execvp("bash", ["bash", "--norc", "--noprofile", "--noediting", "-i"])
"""


def typed_blocks(page: Path) -> dict[int, list[Block]]:
    """The blocks of a page by the number of their terminal, which is also their order."""
    found: dict[int, list[Block]] = {}
    for block in blocks(page.read_text(encoding="utf-8")):
        number = re.match(r"# terminal (\d+)\b", block.text)
        if number and block.language == "sh" and not block.skip:
            found.setdefault(int(number[1]), []).append(block)
    return found


def outputs(page: Path) -> dict[int, list[str]]:
    """The lines of each block `output`, by the line of the typed block before it."""
    found, before = {}, 0
    for block in blocks(page.read_text(encoding="utf-8")):
        if block.language == "output":
            assert before, f"{page.name}:{block.line}: no block with a terminal stands before this output"
            found[before] = block.text.splitlines()
        before = block.line if block.language == "sh" and block.text.startswith("# terminal ") else 0
    return found


LAST_SHOWN = {("read-a-parameter.md", 4): "38400"}
"""What a command that runs until Ctrl-C shows before it is pressed: a watch reads the end of a move after the move."""


class Terminal:
    """A bash on a pseudo-terminal."""

    def __init__(self, folder: Path) -> None:
        self._ours, theirs = os.openpty()
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        environment = os.environ | {"PATH": path, "PS1": r"[$?]% ", "TERM": "xterm", "COLUMNS": "120"}
        self._shell = subprocess.Popen(
            [sys.executable, "-c", SHELL],
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            cwd=folder,
            env=environment,
            start_new_session=True,
        )
        os.close(theirs)
        self.screen = ""
        """Everything that was shown."""
        self.output: list[str] = []
        """The lines that the commands since the last `clear` printed."""
        self._changed = threading.Condition()
        # All terminals are read at any time, as a window is: a program whose terminal is not read stops.
        self._reader = threading.Thread(target=self._read)
        self._reader.start()
        self._wait_for_prompt()

    def type(self, line: str) -> int:
        """Type a line, wait for the prompt, and return the status of the command."""
        start = self.start(line)
        status = self._wait_for_prompt()
        self.output += self.printed(start)
        return status

    def start(self, line: str) -> int:
        """Type a line; return where its output begins in `screen`."""
        start = len(self.screen)
        os.write(self._ours, f"{line}\n".encode())
        self._wait(lambda: "\n" in self.screen[start:], line)
        return start + self.screen[start:].index("\n") + 1

    def wait_for_output(self, start: int) -> None:
        """Wait until a command that runs on has shown something."""
        self._wait(lambda: self.screen[start:].strip(), "no output")
        with self._changed:
            ended = self._changed.wait_for(lambda: PROMPT.search(self.screen), STAYS)
        assert not ended, f"ended at once:\n{self.screen}"

    def wait_for_text(self, text: str) -> None:
        """Wait until the screen has shown a text."""
        self._wait(lambda: text in self.screen, f"{text!r} is not shown")

    def printed(self, start: int) -> list[str]:
        """Return the lines on the screen from `start` on, up to the next prompt, without escape sequences."""
        text = re.split(r"\[\d+\]% ", re.sub(r"\r|\x1b\[[0-9;?]*[A-Za-z]", "", self.screen[start:]))[0]
        return [line.rstrip() for line in text.splitlines()]

    def press_ctrl_c(self) -> int:
        """Interrupt the command that runs; return its status."""
        os.write(self._ours, b"\x03")
        return self._wait_for_prompt()

    def close(self) -> None:
        """End the shell and what runs in it, as a closed window does."""
        self._shell.send_signal(signal.SIGHUP)
        self._shell.wait(30)
        self._reader.join(30)
        os.close(self._ours)

    def _wait_for_prompt(self) -> int:
        self._wait(lambda: PROMPT.search(self.screen), "no prompt: the command does not end")
        found = PROMPT.search(self.screen)
        assert found
        self.screen += "\n"  # the next prompt is another one
        return int(found[1])

    def _wait(self, done: Callable[[], object], what: str) -> None:
        with self._changed:
            assert self._changed.wait_for(done, LIMIT), f"{what}\n{self.screen}"

    def _read(self) -> None:
        with suppress(OSError):  # EIO: the shell and its commands have ended
            while data := os.read(self._ours, 65536):
                with self._changed:
                    self.screen += data.decode("utf-8", "replace")
                    self._changed.notify_all()


def on_this_machine(text: str, folder: Path, ports: dict[str, int]) -> str:
    """The same commands with free ports, and paths in a folder of the test."""

    def port(match: re.Match[str]) -> str:
        return f"127.0.0.1:{ports.setdefault(match[1], free_port())}"

    return re.sub(r"127\.0\.0\.1:(\d+)", port, text).replace("/tmp/", f"{folder}/")


def run_terminals(page: Path, folder: Path) -> dict[int, str]:
    """Type all blocks in order, press Ctrl-C in each terminal where a command runs, and return what each showed."""
    terminals: dict[int, Terminal] = {}
    running: list[int] = []
    ports: dict[str, int] = {}
    shown = outputs(page)
    try:
        for number, block in sorted((number, block) for number, found in typed_blocks(page).items() for block in found):
            if number not in terminals:
                terminals[number] = Terminal(folder)
            terminal = terminals[number]
            terminal.output.clear()
            *lines, last = on_this_machine(block.text, folder, ports).splitlines()
            runs_on = "until Ctrl-C" in block.text.partition("\n")[0]
            for line in lines if runs_on else [*lines, last]:
                assert terminal.type(line) == 0 or block.line in shown, terminal.screen
            if runs_on:
                start = terminal.start(last)
                terminal.wait_for_output(start)
                terminal.output += terminal.printed(start)
                running.append(number)
            if block.line in shown:
                expected = on_this_machine("\n".join(shown[block.line]), folder, ports).splitlines()
                text = "".join(f"  page  | {line}\n" for line in expected) + terminal.screen
                whole = [*expected, "..."] if runs_on else expected
                assert fits(whole, terminal.output), f"{page.name}:{block.line}\n{text}"
        for number in reversed(running):
            terminals[number].wait_for_text(LAST_SHOWN.get((page.name, number), ""))
            assert terminals[number].press_ctrl_c() in (0, 130), terminals[number].screen
        return {number: terminal.screen for number, terminal in terminals.items()}
    finally:
        for terminal in terminals.values():
            terminal.close()


FIRST_READ = ("03-a-register-read-by-hand.md", "05-ascii-and-tcp.md", "07-can-and-sdo.md")
"""The pages of `make test`: a serial line, TCP and CAN, as a reader meets them first. Each command is a process."""
TYPED = sorted((page for page in PAGES if typed_blocks(page)), key=lambda page: page.name not in FIRST_READ)


@pytest.mark.parametrize("page", some_of(TYPED, len(FIRST_READ)), ids=named)
def test_the_blocks_of_a_page_run_in_their_terminals(page: Path, tmp_path: Path) -> None:
    screens = run_terminals(page, tmp_path)
    assert not any("Traceback" in screen for screen in screens.values())
    if page.name == "read-a-parameter.md":
        page_shows_what_it_says(screens, tmp_path)


def page_shows_what_it_says(screens: dict[int, str], folder: Path) -> None:
    positions = [int(text) for text in re.findall(r"Position Actual Value\W+(-?\d+)", screens[4])]
    assert (positions[0], positions[-1]) == (0, 38400)
    assert any(0 < position < 38400 for position in positions), "watch began after the move"
    assert (folder / "move.svg").stat().st_size > 1000
    assert "operation enabled, position 38400" in screens[5]
    assert "fault " in screens[1]
    assert "Thyristors temperature = 24" in screens[2]


def test_every_shell_block_of_the_readme_is_typed_or_says_why_not() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    left = [
        block.text.splitlines()[0]
        for block in blocks(text)
        if block.language in ("sh", "bash", "shell") and not block.skip and not block.text.startswith("# terminal ")
    ]
    assert [line.split("#")[0].strip() for line in left] == ["make demo"], "only the two commands of make"


@pytest.mark.parametrize(
    ("block", "reported"),
    [
        ("# terminal 1\necho one\necho two\n```\n\n```output\none\n", "page  | one"),
        ("# terminal 1\ncat\necho reached\n", "no prompt"),
        ("# terminal 1: until Ctrl-C\necho ended\n", "ended at once"),
        ("# terminal 1\nfalse\necho reached\n", "false"),
    ],
)
def test_a_block_that_does_not_run_is_reported(
    block: str, reported: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if reported == "no prompt":
        monkeypatch.setattr("tests.test_terminals.LIMIT", 1.0)
    monkeypatch.setattr("tests.test_terminals.STAYS", 30.0)
    page = tmp_path / "page.md"
    page.write_text(f"```sh\n{block}```\n")
    with pytest.raises(AssertionError, match=reported):
        run_terminals(page, tmp_path)
