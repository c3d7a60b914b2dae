"""Links of pseudo-terminals that outlived their program: no terminal of another program is opened, and the error says
how to go on."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from barewire import AsyncModbusClient, AsyncModbusServer, ModbusClient, ModbusServer
from barewire.errors import PortError
from barewire.io.ports.pty import PseudoTerminal
from barewire.modbus import Table
from tests.helpers import refused
from tests.workbench.cli.helpers import error_of

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the device numbers of /dev/pts on Linux")


def open_async_client(url: str) -> None:
    asyncio.run(AsyncModbusClient(url).open())


def start_async_server(url: str) -> None:
    asyncio.run(AsyncModbusServer(url, {1: Table()}).start())


OPENED: list[Callable[[str], object]] = [
    ModbusClient,
    lambda url: ModbusServer(url, {1: Table()}),
    open_async_client,
    start_async_server,
]


@pytest.fixture
def another() -> Iterator[str]:
    """The path of a terminal of another program. It must stay as it is."""
    ours, theirs = os.openpty()
    settings = termios.tcgetattr(theirs)
    os.set_blocking(ours, False)
    yield os.ttyname(theirs)
    assert termios.tcgetattr(theirs) == settings
    with pytest.raises(BlockingIOError):
        os.read(ours, 1)
    os.close(ours)
    os.close(theirs)


def made_before(link: Path, terminal: str) -> None:
    """Make a link that is older than the terminal to which it leads."""
    link.symlink_to(terminal)
    os.utime(link, (time.time(), os.stat(terminal).st_ctime - 10), follow_symlinks=False)


@pytest.mark.parametrize("use", OPENED)
def test_a_link_that_is_older_than_its_terminal_is_refused(
    use: Callable[[str], object], another: str, tmp_path: Path
) -> None:
    link = tmp_path / "a line"
    made_before(link, another)
    text = (
        f"{link}: left over from a program that has ended: {another} was made after this link, by another program; "
        f"remove the link: rm '{link}'"
    )
    with refused(PortError, text):
        use(f"rtu://{link}")
    assert link.is_symlink()


def test_the_command_says_how_to_go_on(another: str, tmp_path: Path) -> None:
    link = tmp_path / "line"
    made_before(link, another)
    for command in (("simulate", "adxl", f"rtu://{link}"), ("read", f"rtu://{link}", "adxl", "Status")):
        assert f"remove the link: rm {link}\n" in error_of(*command)


def test_a_link_whose_terminal_got_other_permissions_is_opened(tmp_path: Path) -> None:
    """chmod changes the time of a terminal as well; a new one has the permissions 600 or 620."""
    link = tmp_path / "line"
    with ModbusServer(f"rtu://{link}", {1: Table()}) as server:
        link.chmod(0o666)
        os.utime(link, (0, 0), follow_symlinks=False)
        with ModbusClient(server.url, timeout=30) as client:
            assert client.read_holding_registers(0, 1) == (0,)


@pytest.mark.parametrize("use", OPENED)
def test_the_terminal_in_which_a_program_runs_is_refused(use: Callable[[str], object], tmp_path: Path) -> None:
    code = (
        "import fcntl, os, pty, sys, termios; ours, theirs = os.openpty(); os.setsid();"
        "fcntl.ioctl(theirs, termios.TIOCSCTTY, 0); print(os.ttyname(theirs), flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        terminal = process.stdout.readline().strip()
        link = tmp_path / "line"
        link.symlink_to(terminal)
        for path in (terminal, str(link)):
            with refused(PortError, f"{path}: the terminal in which process {process.pid} runs"):
                use(f"rtu://{path}")
        process.communicate("")


def test_a_link_to_the_number_that_the_next_terminal_gets_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A number that was free could be given to a test in another process, so the link gets that of the new terminal."""
    link = tmp_path / "line"
    link.symlink_to("/dev/pts/4194303")
    make = os.openpty

    def make_with_the_number_of_the_link() -> tuple[int, int]:
        ours, theirs = make()
        if link.is_symlink():
            link.unlink()
            link.symlink_to(os.ttyname(theirs))
        return ours, theirs

    monkeypatch.setattr(os, "openpty", make_with_the_number_of_the_link)
    with ModbusServer(f"rtu://{link}", {1: Table()}) as server, ModbusClient(server.url, timeout=30) as client:
        assert client.read_holding_registers(0, 1) == (0,)


def test_a_link_whose_terminal_is_gone(tmp_path: Path) -> None:
    """A client is told so; a server makes a new terminal."""
    link = tmp_path / "line"
    link.symlink_to("/dev/pts/4194303")
    for use in (ModbusClient, open_async_client):
        with refused(PortError, f"{link}: the program that made this link has ended: there is no /dev/pts/4194303"):
            use(f"rtu://{link}")
    (tmp_path / "meter").symlink_to("/dev/tty-meter")
    with refused(PortError, "meter: the link is broken: there is no /dev/tty-meter"):
        ModbusClient(f"rtu://{tmp_path}/meter")
    with ModbusServer(f"rtu://{link}", {1: Table()}) as server, ModbusClient(server.url, timeout=30) as client:
        assert client.read_holding_registers(0, 1) == (0,)


@pytest.mark.parametrize("target", ["/mnt/disk/photos", "photos", "/dev/pts/x", "/dev/pts/7/8", "/dev/tty-meter"])
def test_a_broken_link_to_anything_else_is_not_replaced(target: str, tmp_path: Path) -> None:
    link = tmp_path / "a line"
    link.symlink_to(target)
    text = f"the link is broken: there is no {target}; remove it for a new pseudo-terminal: rm '{link}'"
    with refused(PortError, f"{link}: {text}"):
        ModbusServer(f"rtu://{link}", {1: Table()})
    assert os.readlink(link) == target


def test_a_server_removes_only_its_own_link(tmp_path: Path) -> None:
    """A user may have put something else at the path meanwhile; it stays, and closing raises nothing."""
    link = tmp_path / "line"

    def opened() -> ModbusServer:
        server = ModbusServer(f"rtu://{link}", {1: Table()})
        link.unlink()
        return server

    server = opened()
    link.write_text("a thesis")
    server.close()
    assert link.read_text() == "a thesis"
    link.unlink()

    server = opened()
    link.mkdir()
    server.close()
    assert link.is_dir()
    link.rmdir()

    server = opened()
    with ModbusServer(f"rtu://{link}", {1: Table()}) as second:
        server.close()
        with ModbusClient(second.url, timeout=30) as client:
            assert client.read_holding_registers(0, 1) == (0,)
    assert not os.path.lexists(link)

    folder = tmp_path / "folder"
    folder.mkdir()
    server = ModbusServer(f"rtu://{folder}/line", {1: Table()})
    (folder / "line").unlink()
    folder.rmdir()
    folder.write_text("no folder")
    server.close()


def test_to_close_a_pseudo_terminal_twice_closes_no_file_of_another() -> None:
    terminal = PseudoTerminal()
    terminal.close()
    ours, theirs = os.pipe()  # these get the freed numbers
    terminal.close()
    os.fstat(ours)
    os.close(ours)
    os.close(theirs)
