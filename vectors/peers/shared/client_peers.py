"""For the adapters of Modbus clients in Python: their answers for kind `client`.

barewire vectors check --kind client --adapter "python vectors/peers pymodbus"

The libraries are not changed. They get a serial port or a socket on the line of the peer, which is
../reference/modbus/client_peer.py, and the clock that they import is replaced by the time of this line, so nothing is
waited for. A library that has no such line, no retries, no broadcast or no way to ask this function says that the case
is not offered.
"""

import importlib
import logging
import socket
import sys
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "reference" / "modbus"))

from adapter import NotOffered
from adapter_client import ExceptionAnswer
from client_peer import ClientPeer

BEGIN = 1000.0
"""The time at the beginning, in seconds: some libraries compare with a time 0."""


class Line:
    """The line to the peer, as a serial port and as a socket; and the `time` module of a library."""

    port = name = "virtual"
    bytesize, stopbits, parity, is_open = 8, 1, "N", True

    def __init__(self, case):
        self.peer = ClientPeer(case)
        self.setup = case["line"]
        self.is_serial = self.setup["framing"] != "tcp"
        self.baudrate = self.setup.get("baud", 19200)
        self.timeout = self.setup["timeout"] / 1e6
        self.now = BEGIN
        self.received = b""

    def microseconds(self):
        """The time of the peer."""
        return round((self.now - BEGIN) * 1e6)

    def due(self):
        """The time of the next piece; None if nothing is under way."""
        return BEGIN + self.peer.coming[0][0] / 1e6 if self.peer.coming else None

    def take(self):
        """Receive what has come."""
        while self.peer.coming and self.peer.coming[0][0] <= self.microseconds():
            self.received += self.peer.coming.pop(0)[1]

    def wait(self, until, size):
        """Let time pass until so many bytes have come, or this time is over."""
        self.take()
        while len(self.received) < size and (due := self.due()) is not None and due <= until:
            self.now = max(self.now, due)
            self.take()
        if len(self.received) < size:
            self.now = max(self.now, until)

    def cut(self, size):
        data, self.received = self.received[:size], self.received[size:]
        return data

    # The time module

    def time(self):
        return self.now

    monotonic = perf_counter = time

    def sleep(self, seconds):
        self.now += max(0.0, seconds)

    # A serial port

    def write(self, data):
        if self.is_serial:
            self.now += len(data) * 11 / self.baudrate
        self.peer.hear(bytes(data), self.microseconds())
        return len(data)

    def read(self, size=1):
        self.wait(self.now + (self.timeout or 0.0), size)
        return self.cut(size)

    @property
    def in_waiting(self):
        self.take()
        return len(self.received)

    def inWaiting(self):
        return self.in_waiting

    def reset_input_buffer(self):
        self.take()
        self.received = b""

    flushInput = reset_input_buffer

    def flush(self):
        """Requests are sent at once."""

    reset_output_buffer = flushOutput = open = flush

    def isOpen(self):
        return True

    # A socket

    send = sendall = write

    def recv(self, size):
        self.wait(self.now + self.timeout, 1)
        if not self.received:
            raise TimeoutError("timed out")
        return self.cut(size)

    def close(self):
        """Close a connection: what is under way is lost. A serial port receives on."""
        if not self.is_serial:
            self.received = b""
            self.peer.coming.clear()

    def fileno(self):
        return 3

    def getsockname(self):
        return ("virtual", 502)

    def connect(self, *_):
        """It is connected."""

    setblocking = settimeout = setsockopt = connect

    def select(self, reading, writing=(), failing=(), timeout=0.0):
        """The function select.select, with this line as the only socket."""
        self.wait(self.now + max(0.0, timeout or 0.0), 1)
        return (list(reading) if self.received else [], [], [])


NAMES = {
    1: "read_coils",
    2: "read_discrete_inputs",
    3: "read_holding_registers",
    4: "read_input_registers",
    5: "write_single_coil",
    6: "write_single_register",
    15: "write_multiple_coils",
    16: "write_multiple_registers",
}


# The libraries: each function returns ask(unit, function, address, count, values) -> values, or None for a write


def needs(line, *framings, retries=False, echo=False):
    if line.setup["framing"] not in framings:
        raise NotOffered(f"no line like this: {line.setup['framing']}")
    if line.setup["retries"] and not retries:
        raise NotOffered("no retries")
    if line.setup.get("echo") and not echo:
        raise NotOffered("no option for a line with an echo")
    if line.setup.get("at_once"):
        raise NotOffered("one question at a time")


def pymodbus(line, patches):
    needs(line, "rtu", "ascii", "tcp", retries=True, echo=True)
    library = importlib.import_module("pymodbus.client")
    framer = importlib.import_module("pymodbus").FramerType
    settings = {"timeout": line.timeout, "retries": line.setup["retries"]}
    patches.enter_context(patch("pymodbus.transaction.transaction.monotonic", line.monotonic))
    if line.is_serial:
        patches.enter_context(patch("pymodbus.client.serial.time", line))
        settings["handle_local_echo"] = "echo" in line.setup
        kind = framer.RTU if line.setup["framing"] == "rtu" else framer.ASCII
        client = library.ModbusSerialClient("virtual", framer=kind, baudrate=line.baudrate, **settings)
        patches.enter_context(patch("serial.serial_for_url", lambda *_, **__: line))
    else:
        patches.enter_context(patch("pymodbus.client.tcp.time", line))
        patches.enter_context(patch("pymodbus.client.tcp.select", line))
        patches.enter_context(patch("socket.create_connection", lambda *_, **__: line))
        client = library.ModbusTcpClient("virtual", **settings)
    client.connect()

    def ask(unit, function, address, count, values):
        method = getattr(client, NAMES[function].replace("write_single", "write").replace("write_multiple", "write"))
        if function <= 4:
            response = method(address, count=count, device_id=unit)
        else:
            value = values[0] if function in (5, 6) else values
            response = method(address, value, device_id=unit, no_response_expected=unit == 0 and line.is_serial)
        if response is None:
            return None
        if response.isError():
            raise ExceptionAnswer(response.exception_code)
        return response.bits[:count] if function in (1, 2) else response.registers if function <= 4 else None

    return ask


def minimalmodbus(line, patches):
    needs(line, "rtu", "ascii", echo=True)
    library = importlib.import_module("minimalmodbus")
    patches.enter_context(patch.object(library, "time", line))
    patches.enter_context(patch.dict(library._latest_read_times, clear=True))
    client = library.Instrument(line, 1, mode=line.setup["framing"])
    client.handle_local_echo = "echo" in line.setup
    texts = {"illegal function": 1, "data address": 2, "data value": 3, "device failure": 4, "busy": 6, "path": 10}
    texts |= {"negative": 7, "parity": 8, "target": 11}

    def ask(unit, function, address, count, values):
        client.address = unit
        try:
            if function in (1, 2):
                return client.read_bits(address, count, functioncode=function)
            if function in (3, 4):
                return client.read_registers(address, count, functioncode=function)
            if function == 5:
                return client.write_bit(address, values[0], functioncode=5)
            if function == 6:
                return client.write_register(address, values[0], functioncode=6)
            return (client.write_bits if function == 15 else client.write_registers)(address, values)
        except library.SlaveReportedException as error:
            text = str(error)
            code = next((code for part, code in texts.items() if part in text), None)
            raise ExceptionAnswer(int(text.split()[-1]) if code is None else code) from None

    return ask


def modbus_tk(line, patches):
    needs(line, "rtu", "tcp")
    library = importlib.import_module("modbus_tk.modbus_rtu" if line.is_serial else "modbus_tk.modbus_tcp")
    error_class = importlib.import_module("modbus_tk.modbus").ModbusError
    timeout = line.timeout
    if line.is_serial:
        patches.enter_context(patch.object(library, "time", line))
        client = library.RtuMaster(line)
    else:
        patches.enter_context(patch("modbus_tk.utils.select", line))
        patches.enter_context(patch("socket.socket", lambda *_: line))
        client = library.TcpMaster("virtual", timeout_in_sec=timeout)
    client.set_timeout(timeout)

    def ask(unit, function, address, count, values):
        try:
            value = values[0] if function in (5, 6) else values
            found = client.execute(unit, function, address, count if function <= 4 else 0, value or 0)
        except error_class as error:
            raise ExceptionAnswer(error.get_exception_code()) from None
        return list(found) if function <= 4 else None

    return ask


def umodbus(line, patches):
    needs(line, "rtu", "tcp")
    library = importlib.import_module("umodbus.client.serial.rtu" if line.is_serial else "umodbus.client.tcp")
    error_class = importlib.import_module("umodbus.exceptions").ModbusError

    def ask(unit, function, address, count, values):
        if unit == 0 and line.is_serial:
            raise NotOffered("no broadcasts")
        what = count if function <= 4 else values[0] if function in (5, 6) else values
        adu = getattr(library, NAMES[function])(unit, address, what)
        try:
            found = library.send_message(adu, line)
        except error_class as error:
            raise ExceptionAnswer(error.error_code) from None
        return found if function <= 4 else None

    return ask


def pymodbustcp(line, patches):
    needs(line, "tcp")
    library = importlib.import_module("pyModbusTCP.client")
    constants = {"AF_UNSPEC": 0, "SOCK_STREAM": 1, "IPPROTO_TCP": 6, "TCP_NODELAY": 1, "SOL_SOCKET": 1}
    found = SimpleNamespace(
        socket=lambda *_: line,
        getaddrinfo=lambda *_, **__: [(2, 1, 6, "", ("virtual", 502))],
        timeout=socket.timeout,
        error=socket.error,
        **constants,
    )
    patches.enter_context(patch.object(library, "socket", found))
    client = library.ModbusClient(host="localhost", timeout=line.timeout, auto_open=True)

    def ask(unit, function, address, count, values):
        client.unit_id = unit
        what = count if function <= 4 else values[0] if function in (5, 6) else values
        result = getattr(client, NAMES[function])(address, what)
        if not result:
            if client.last_except:
                raise ExceptionAnswer(client.last_except)
            raise TimeoutError(client.last_error_as_txt)
        return result if function <= 4 else None

    return ask


LIBRARIES = {
    "pymodbus": pymodbus,
    "minimalmodbus": minimalmodbus,
    "modbus-tk": modbus_tk,
    "uModbus": umodbus,
    "pyModbusTCP": pymodbustcp,
}


def asked(pdu):
    """Function, address, count and values of a request."""
    function, address, second = pdu[0], int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")
    if function in (1, 2, 3, 4):
        return function, address, second, []
    if function == 5:
        return function, address, 1, [1 if second == 0xFF00 else 0]
    if function == 6:
        return function, address, 1, [second]
    if function == 15:
        return function, address, second, [pdu[6 + n // 8] >> n % 8 & 1 for n in range(second)]
    if function == 16:
        return function, address, second, [int.from_bytes(pdu[6 + 2 * n : 8 + 2 * n], "big") for n in range(second)]
    raise NotOffered(f"function {function:02X}")


def outcome(ask, question, is_serial):
    """Ask one question, and return the text of its outcome."""
    function, address, count, values = asked(bytes.fromhex(question["pdu"]))
    try:
        found = ask(question["unit"], function, address, count, values)
    except NotOffered:
        raise
    except ExceptionAnswer as refused:
        found = refused
    except Exception:
        return "no answer"
    return told(function, count, found, question, is_serial)


def told(function, count, found, question, is_serial):
    """The text of an outcome: values, None for a write, or an exception response."""
    if isinstance(found, ExceptionAnswer):
        return f"exception {found.args[0]:02X}"
    if found is None:
        return "sent" if question["unit"] == 0 and is_serial else "done"
    if function in (1, 2):
        return "bits " + "".join("1" if bit else "0" for bit in found)
    return "registers " + " ".join(f"{register:04X}" for register in found)


def client_runner(library):
    """Return the function that answers client.run with this library."""
    logging.disable(logging.CRITICAL)

    def run(case):
        line = Line(case)
        outcomes = []
        with ExitStack() as patches:
            ask = LIBRARIES[library](line, patches)
            for place, question in enumerate(case["ask"]):
                line.now = max(line.now, BEGIN + question["at"] / 1e6)
                line.peer.begin(place)
                outcomes.append(outcome(ask, question, line.is_serial))
                line.peer.end(place)
        return {"ask": [{"outcome": one, "seen": seen} for one, seen in zip(outcomes, line.peer.seen)]}

    return run
