"""The files of `barewire vendor` on real ports: with our servers, and with units that answer late and wrongly."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from barewire import ModbusClient, ModbusException, ModbusServer, Table
from barewire.ascii import frame as ascii_frame
from barewire.canopen import CanFrame, Entry, ObjectDictionary
from barewire.canopen.sdo import SdoServer
from barewire.io.ports.pty import PseudoTerminal
from barewire.rtu import frame as rtu_frame
from tests.workbench.vendor.made import ALONE, imported, run_alone, written

pytestmark = pytest.mark.long


def served(scheme: str) -> ModbusServer:
    return ModbusServer(scheme, units={7: Table(holding_registers={107: [555, 0, 100]}, coils=[True, False])})


@pytest.mark.parametrize("framing", ["rtu", "ascii"])
def test_a_serial_client_alone(framing: str, tmp_path: Path) -> None:
    """Without pyserial: the file opens the port by itself."""
    path = written(tmp_path, f"modbus-{framing}-client", "coils")
    with served(f"{framing}://pty") as server:
        port = server.url.partition("://")[2].partition("?")[0]
        done = run_alone(tmp_path, f"from {path.stem} import *\n" + EXCHANGES.format(
            client=f"Modbus{framing.title()}Client({port!r}, unit=7, timeout=20)"
        ))  # fmt: skip
    assert (done.stdout, done.stderr) == (EXCHANGED, "")


def test_a_serial_client_opens_a_pseudo_terminal_again(tmp_path: Path) -> None:
    """It has no parity, and the second attempt to set one would fail."""
    path = written(tmp_path, "modbus-rtu-client", "coils")
    with served("rtu://pty") as server:
        port = server.url.partition("://")[2].partition("?")[0]
        read = f"ModbusRtuClient({port!r}, unit=7, timeout=20).read_holding_registers(107, 1)"
        done = [run_alone(tmp_path, f"from {path.stem} import *\nprint({read})") for _ in range(2)]
    assert [(run.stdout, run.stderr) for run in done] == [("(555,)\n", "")] * 2


def test_a_tcp_client_alone(tmp_path: Path) -> None:
    path = written(tmp_path, "modbus-tcp-client", "coils")
    with served("tcp://127.0.0.1:0") as server:
        port = server.url.rpartition(":")[2]
        done = run_alone(tmp_path, f"from {path.stem} import *\n" + EXCHANGES.format(
            client=f"ModbusTcpClient('127.0.0.1', {port}, unit=7, timeout=20)"
        ))  # fmt: skip
    assert (done.stdout, done.stderr) == (EXCHANGED, "")


EXCHANGES = """
with {client} as client:
    print(client.read_holding_registers(107, 3))
    client.write_multiple_registers(107, [1, 65535])
    client.write_single_register(109, 7)
    print(client.read_holding_registers(107, 3))
    client.write_single_coil(1, True)
    print(client.read_coils(0, 2))
    try:
        client.read_input_registers(65535, 2)
    except ModbusException as error:
        print(error)
    print(client.bus.counters.asked, client.bus.counters.strays)
"""
EXCHANGED = """\
(555, 0, 100)
(1, 65535, 7)
(True, True)
unit 7, address 65535: exception 02 (illegal data address) to function 04
7 0
"""


class Unit:
    """A unit at the other end of a pseudo-terminal: it answers each frame with what `answer` returns for it."""

    def __init__(self, end_of: Callable[[bytes], int], answer: Callable[[bytes], bytes]) -> None:
        self._end_of, self._answer = end_of, answer
        self.ours, other = os.openpty()
        tty.setraw(other)
        self.path = os.ttyname(other)
        self._other = other
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        held = b""
        while True:
            try:
                held += os.read(self.ours, 256)
            except OSError:
                return  # closed
            while end := self._end_of(held):
                frame, held = held[:end], held[end:]
                os.write(self.ours, self._answer(frame))

    @contextmanager
    def running(self) -> Iterator[str]:
        self._thread.start()
        try:
            yield self.path
        finally:
            os.close(self._other)
            self._thread.join(10)
            os.close(self.ours)


def rtu_end(held: bytes) -> int:
    """Return the end of a request of eight bytes: reads, and the probe."""
    return 8 if len(held) >= 8 else 0


class Late:
    """A unit that keeps its first answer until it gets the next request."""

    def __init__(self, framing: Any) -> None:
        self.framing = framing
        self.kept: bytes | None = None
        self.probes = 0

    def __call__(self, frame: bytes) -> bytes:
        unit, pdu, _ = self.framing.decode(frame)
        if pdu[0] == 8:
            self.probes += 1
            answer = frame
        else:
            answer = self.framing.encode(unit, bytes([3, 2]) + pdu[1:3])  # the register has its own address
        if self.kept is None:
            self.kept = answer
            return b""
        late, self.kept = self.kept, b""
        return late + answer


@pytest.mark.parametrize("framing", ["rtu", "ascii"])
def test_a_late_answer_is_not_given_to_the_next_request(framing: str, tmp_path: Path) -> None:
    """The answer to register 5 comes when register 6 is asked: a probe tells it apart."""
    module = imported(tmp_path, f"modbus-{framing}-client", "coils")
    frames: Any = rtu_frame if framing == "rtu" else ascii_frame
    late = Late(frames)
    end = rtu_end if framing == "rtu" else lambda held: held.find(b"\n") + 1
    client_class = getattr(module, f"Modbus{framing.title()}Client")
    with Unit(end, late).running() as path, client_class(path, timeout=20.0) as client:
        with pytest.raises(module.NoAnswer, match="did not answer Read Holding Registers within"):
            client.ask(module.ReadHoldingRegisters(5, 1), timeout=0.05)
        assert client.read_holding_registers(6, 1) == (6,)
        assert late.probes == 1
        assert client.bus.counters.late == 1
        assert [reply.request for reply in client.bus.counters.replies] == [module.ReadHoldingRegisters(5, 1)]


def test_damaged_bytes_are_not_an_answer(tmp_path: Path) -> None:
    """A frame with a wrong CRC comes before the answer, a bit of it is wrong; and a write whose answer is damaged."""
    module = imported(tmp_path, "modbus-rtu-client", "coils")

    def answer(frame: bytes) -> bytes:
        unit, pdu, _ = rtu_frame.decode(frame)
        if pdu[0] == 8:
            return frame
        good = rtu_frame.encode(unit, bytes([3, 2]) + pdu[1:3] if pdu[0] == 3 else pdu)
        return bytes([good[0], good[1] ^ 0x10, *good[2:]])

    with Unit(rtu_end, answer).running() as path, module.ModbusRtuClient(path, timeout=0.3) as client:
        with pytest.raises(module.NoAnswer, match=r"received instead: .*CRC is 38 46, should be 3C 86"):
            client.read_holding_registers(6, 1)
        with pytest.raises(module.WriteOutcomeUnknown):
            client.write_single_register(6, 1)


def test_a_port_that_fails_is_opened_again(tmp_path: Path) -> None:
    module = imported(tmp_path, "modbus-tcp-client", "coils")
    with served("tcp://127.0.0.1:0") as server:
        port = int(server.url.rpartition(":")[2])
        client = module.ModbusTcpClient("127.0.0.1", port, unit=7, timeout=20)
        assert client.read_holding_registers(107, 1) == (555,)
    with pytest.raises(module.PortError):
        client.read_holding_registers(107, 1)
    with ModbusServer(f"tcp://127.0.0.1:{port}", units={7: Table(holding_registers={107: [556]})}):
        assert client.read_holding_registers(107, 1) == (556,)
        client.close()


def test_ports_that_cannot_be_opened(tmp_path: Path) -> None:
    module = imported(tmp_path, "modbus-rtu-client", "coils")
    plain = tmp_path / "a_file"
    plain.touch()
    for path, text in (("/dev/nowhere", "no such file or directory"), (str(plain), "not a serial port with 19200 8E1")):
        with pytest.raises(module.PortError, match=text), module.ModbusRtuClient(path):
            pass
    with pytest.raises(module.EncodeError, match="no such speed"), module.ModbusRtuClient(str(plain), baudrate=12345):
        pass
    with served("rtu://pty") as server:
        path = server.url.partition("://")[2].partition("?")[0]
        with (
            module.ModbusRtuClient(path, unit=7),
            pytest.raises(module.PortError, match="another program has it open"),
            module.ModbusRtuClient(path),
        ):
            pass


# Servers


SERVED = "{{1: Table(holding_registers={{107: [555, 0, 100]}}), 2: Table(100, on_write=print)}}"


@contextmanager
def serving(folder: Path, name: str, opened: str) -> Iterator[str]:
    """Run a server alone, until the block ends. Yields its first line."""
    path = written(folder, name)
    code = f"{ALONE.format(str(folder))}from {path.stem} import *; server = {opened.replace('{}', SERVED.format())}; "
    code += "print(getattr(server, 'port', 'ready'), flush=True); server.serve()"
    command = [sys.executable, "-I", "-S", "-c", code]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip()
        finally:
            process.kill()


def test_a_serial_server_alone(tmp_path: Path) -> None:
    """It opens one end of a pseudo-terminal by itself; the client of another file is at the other end."""
    module = imported(tmp_path, "modbus-rtu-client", "coils")
    terminal = PseudoTerminal()
    opened = f"ModbusRtuServer({terminal.path!r}, {{}})"
    with (
        serving(tmp_path, "modbus-rtu-server", opened),
        module.ModbusRtuClient(terminal, timeout=5.0, retries=3) as client,
    ):
        assert client.read_holding_registers(107, 3) == (555, 0, 100)
        client.ask(module.WriteMultipleRegisters(7, [1, 2]), unit=2)
        assert client.ask(module.ReadHoldingRegisters(7, 2), unit=2).registers == (1, 2)
        with pytest.raises(module.ModbusException, match="unit 1, address 110: exception 02"):
            client.read_holding_registers(110, 1)
        terminal.send(rtu_frame.encode(1, bytes.fromhex("03006B0003"))[:-1] + b"\0")  # a wrong CRC
        assert terminal.receive(0.3) is None
        assert client.read_holding_registers(107, 1) == (555,)
    terminal.close()


def test_a_tcp_server_alone(tmp_path: Path) -> None:
    opened = "ModbusTcpServer('127.0.0.1', 0, {}, connections=2)"
    with serving(tmp_path, "modbus-tcp-server", opened) as port, ExitStack() as stack:
        clients = [
            stack.enter_context(ModbusClient(f"tcp://127.0.0.1:{port}", unit=1, timeout=20, lazy=True))
            for _ in range(3)
        ]
        for client in (*clients, *clients):  # a third connection ends the one that was silent longest
            assert client.read_holding_registers(107, 3) == (555, 0, 100)
        clients[0].at(unit=2).write_multiple_coils(0, [True, False, True])
        assert clients[1].at(unit=2).read_coils(0, 3) == (True, False, True)
        with pytest.raises(ModbusException) as caught:
            clients[2].at(unit=9).read_coils(0, 3)
        assert caught.value.code == 0x0B


def test_a_client_that_sends_no_modbus_is_disconnected(tmp_path: Path) -> None:
    with serving(tmp_path, "modbus-tcp-server", "ModbusTcpServer('127.0.0.1', 0, {})") as port:
        with socket.create_connection(("127.0.0.1", int(port)), 20) as browser:
            browser.sendall(b"GET / HTTP/1.1\r\n\r\n")
            assert browser.recv(100) == b""
        with ModbusClient(f"tcp://127.0.0.1:{port}", unit=1, timeout=20) as client:
            assert client.read_holding_registers(107, 1) == (555,)


# SDO


class Bus:
    """A CAN bus with one node, as a port: it answers each request with the frames that `answer` returns."""

    def __init__(self, answer: Callable[[Any], list[Any]]) -> None:
        self._answer = answer
        self.coming: list[Any] = []

    def send(self, frame: Any) -> None:
        self.coming += self._answer(frame)

    def receive(self, timeout: float) -> Any:
        if self.coming:
            return self.coming.pop(0)
        time.sleep(min(timeout, 0.01))
        return None

    def close(self) -> None: ...


def test_a_late_answer_is_not_taken_for_that_of_the_next_transfer(tmp_path: Path) -> None:
    """6041h is read twice: the answer to the first request, 1, comes when the second one is about to be sent."""
    module = imported(tmp_path, "sdo-client")
    values = iter([None, 2])

    def answer(frame: Any) -> list[Any]:
        if frame.data[0] != 0x40:  # the abort after the time-out
            return []
        value = next(values)
        return [] if value is None else [module.CanFrame(0x585, bytes([0x4B, 0x41, 0x60, 0, value, 0, 0, 0]))]

    bus = Bus(answer)
    with module.SdoClient(bus, 5, timeout=0.2) as client:
        with pytest.raises(module.NoAnswer, match=r"node 5 did not answer the upload of 6041h:00 within 0\.2 s"):
            client.upload(0x6041)
        bus.coming.append(module.CanFrame(0x585, bytes([0x4B, 0x41, 0x60, 0, 1, 0, 0, 0])))
        client.timeout = 20
        assert client.read_number(0x6041, "u16") == 2
        assert client.late_responses == 1


def test_numbers_and_texts_over_sdo(tmp_path: Path) -> None:
    module = imported(tmp_path, "sdo-client")
    objects = ObjectDictionary(
        [
            Entry(0x1008, 0, "name", "domain", "ro", b"a device with a long name"),
            Entry(0x60FF, 0, "speed", "i32", "rw", 0),
            Entry(0x2100, 0, "text", "domain", "rw", b""),
        ]
    )
    server = SdoServer(5, objects)
    bus = Bus(lambda frame: [module.CanFrame(*reply) for reply in server.feed(CanFrame(*frame), 0.0)])
    with module.SdoClient(bus, 5, timeout=20) as client:
        assert client.upload(0x1008) == b"a device with a long name"
        client.write_number(0x60FF, "i32", -1500)
        assert objects.read(0x60FF, 0) == bytes.fromhex("24FAFFFF")
        assert client.read_number(0x60FF, "i32") == -1500
        client.download(0x2100, 0, bytes(range(20)))
        assert client.upload(0x2100) == bytes(range(20))
        with pytest.raises(module.SdoAbort) as caught:
            client.upload(0x5FFF)
        assert caught.value.code == 0x0602_0000
        with pytest.raises(module.DecodeError, match="1008h:00 has 25 bytes, u16 takes 2"):
            client.read_number(0x1008, "u16")
        with pytest.raises(module.EncodeError, match="300 as u8"):
            client.write_number(0x60FF, "u8", 300)
        with pytest.raises(module.EncodeError, match="expected one of u8, u16"):
            client.write_number(0x60FF, "word", 300)
