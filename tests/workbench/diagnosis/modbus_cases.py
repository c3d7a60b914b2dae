"""Recordings of Modbus lines: made in virtual time by seed, written in many forms of logs, and damaged on request."""

from __future__ import annotations

from collections.abc import Callable
from random import Random
from typing import Any, NamedTuple

from barewire.ascii import AsciiLine
from barewire.conversation import play
from barewire.devices.parameter import Parameter
from barewire.errors import BarewireError
from barewire.io.fault_injection.faults import Faults, ModbusWire as FaultyModbus
from barewire.modbus import Bus, Server, Table
from barewire.modbus.framing import Line
from barewire.modbus.messages import coils, combined, registers
from barewire.rtu import RtuLine, Timing
from barewire.tcp import TcpLine
from barewire_workbench.diagnosis.modbus_log import ModbusLogDiagnosis
from barewire_workbench.diagnosis.verdict import LineVerdict, LogFinding
from barewire_workbench.recordings.capture import PacketBuilder, file_header, packet_block
from barewire_workbench.recordings.modbus_log import read_modbus_log
from barewire_workbench.wire import UartLine
from tests.devices.sim.wires import ModbusWire, ascii, rtu, tcp
from tests.helpers import Peer, serving

DEVICES: dict[str, tuple[str, ...]] = {"rtu": ("adxl", "az3"), "ascii": ("adxl",), "tcp": ("adxl", "csd-mt")}
_WIRES = {"rtu": rtu, "ascii": ascii, "tcp": tcp}
UNITS = (1, 2, 17, 247)


class Sent(NamedTuple):
    """A frame on the line: when its last byte was sent, its bytes, and whether the client sent it."""

    at: float
    data: bytes
    from_client: bool


Traffic = list[Sent]


def recorded_by(peer: Peer, traffic: Traffic) -> Peer:
    """Return a peer that also records what passes."""

    def recording(item: bytes, now: float) -> list[tuple[float, bytes]]:
        answers = list(peer(item, now))
        traffic.append(Sent(now, item, True))
        traffic.extend(Sent(at, data, False) for at, data in answers)
        return answers

    return recording


def of_device(framing: str, device: str, seed: int) -> Traffic:
    """Return reads and writes by name of a simulated device."""
    random, traffic = Random(seed), list[Sent]()
    wire = _WIRES[framing](device)
    assert isinstance(wire, ModbusWire)
    wire.peer = recorded_by(wire.peer, traffic)
    wire.now = random.uniform(0.0, 100_000.0)
    parameters: list[Parameter] = [parameter for parameter in wire.machine.device.parameters if wire.has(parameter)]
    for _ in range(random.randint(4, 15)):
        parameter = random.choice(parameters)
        try:
            value = wire.read(parameter)
            if random.random() < 0.2:
                wire.write({parameter: value})
        except BarewireError:  # write-only, read-only, or refused by the device: an exception on the line
            pass
        wire.now += random.choice((0.002, 0.05, 0.5))
    return traffic


def of_tables(framing: str, seed: int, count: int | None = None, units: tuple[int, ...] = UNITS) -> Traffic:
    """Return random requests to several tables, and their responses."""
    random, traffic = Random(seed), list[Sent]()
    timing = Timing.of(random.choice((9600, 19200, 115200)))
    lines: dict[str, Callable[[], tuple[Line, Line]]] = {
        "rtu": lambda: (RtuLine(timing), RtuLine(timing, role="server", units=set(units))),
        "ascii": lambda: (AsciiLine(), AsciiLine()),
        "tcp": lambda: (TcpLine(), TcpLine()),
    }
    client, server = lines[framing]()
    table = Table(size=500)
    serial = framing != "tcp"
    served = Server(server, dict.fromkeys(units, table), serial=serial)
    peer = recorded_by(serving(served, timing if serial else None), traffic)
    bus, now = Bus(client), random.uniform(0.0, 1000.0)
    for _ in range(count or random.randint(5, 40)):
        try:
            _, now = play(bus.ask(random.choice(units), random_request(random)), peer, start=now)
        except BarewireError:
            now += 0.001
        now += random.choice((0.004, 0.03, 0.2))
    return traffic


def random_request(random: Random) -> Any:
    """Return a request that a table may refuse with an exception."""
    address, quantity = random.randint(0, 520), random.randint(1, 100)
    words = tuple(random.randint(0, 0xFFFF) for _ in range(random.randint(1, 20)))
    return random.choice(
        (
            registers.ReadHoldingRegisters(address, quantity),
            registers.ReadInputRegisters(address, quantity),
            coils.ReadCoils(address, quantity),
            coils.ReadDiscreteInputs(address, quantity),
            registers.WriteSingleRegister(address, words[0]),
            coils.WriteSingleCoil(address, random.random() < 0.5),
            registers.WriteMultipleRegisters(address, words),
            coils.WriteMultipleCoils(address, tuple(random.random() < 0.5 for _ in range(quantity))),
            combined.ReadWriteMultipleRegisters(address, quantity, write_address=address, registers=words),
        )
    )


# Logs


def log_of(traffic: Traffic, form: str, seed: int = 0) -> bytes:
    """Return the traffic as a log in one of FORMS."""
    random = Random(seed)
    if form == "capture":
        return _capture(traffic, "tcp" if traffic and is_tcp(traffic[0].data) else "rtu")
    lines = []
    for number, (at, data, from_client) in enumerate(traffic):
        digits = data.hex(" ").upper()
        match form:
            case "times":
                lines.append(f"{at:.6f} {digits}")
            case "plain":
                lines.append(digits)
            case "marks":
                lines.append(f"({at:.6f}) {'>' if from_client else '<'} {digits}")
            case "words":
                clock = f"{int(at) // 3600 % 24:02}:{int(at) // 60 % 60:02}:{at % 60:06.3f}"
                lines.append(f"[2024-05-01 {clock}] {'Send' if from_client else 'Recv'}: {digits}")
            case "poll":
                lines.append(f"{'Tx' if from_client else 'Rx'}:{number:06}-{digits}")
            case _:
                cut = random.randrange(len(data)) if len(data) > 1 else 0
                start = at - 0.002
                lines += [f"{start:.6f} {data[:cut].hex(' ')}"] if cut else []
                lines.append(f"{at:.6f} {data[cut:].hex(' ')}")
    return "\n".join(lines).encode() + b"\n"


FORMS = ("times", "plain", "marks", "words", "poll", "pieces", "capture")


def is_tcp(data: bytes) -> bool:
    """Return whether these bytes have the header of Modbus TCP."""
    return data[2:4] == b"\0\0" and len(data) == 6 + int.from_bytes(data[4:6], "big")


def _capture(traffic: Traffic, framing: str) -> bytes:
    packets, content = PacketBuilder(), file_header()
    build = packets.tcp if framing == "tcp" else packets.rtu
    for at, data, from_client in traffic:
        content += packet_block(at, build(data, from_client=from_client))
    return content


def diagnosed(data: bytes) -> tuple[list[LogFinding], list[LineVerdict]]:
    """Return the findings of a log, and its verdicts."""
    diagnosis = ModbusLogDiagnosis(read_modbus_log(data))
    findings = list(diagnosis.findings())
    return findings, [verdict for _, verdict in diagnosis.verdicts()]


# Faults


def misread(traffic: Traffic, line: UartLine) -> Traffic:
    """Return the frames as a receiver reads them that is set otherwise than the sender."""
    return [Sent(at, line.read(data), from_client) for at, data, from_client in traffic]


def noisy(traffic: Traffic, random: Random, share: float = 0.7, where: str = "responses") -> Traffic:
    """Return the traffic with one or two bytes of noise before frames."""
    done = []
    for sent in traffic:
        hit = random.random() < share and (where == "all" or sent.from_client is (where == "requests"))
        noise = random.choice((b"\x00", b"\xff", b"\x00\x00", b"\xfc\x00")) if hit else b""
        done.append(sent._replace(data=noise + sent.data))
    return done


def flipped(traffic: Traffic, random: Random, share: float, unit: int | None = None) -> Traffic:
    """Return the traffic with one bit inverted in a share of the frames, or of the responses of one unit."""
    done = []
    for sent in traffic:
        data = bytearray(sent.data)
        if random.random() < share and (unit is None or (not sent.from_client and data[0] == unit)):
            data[random.randrange(2, len(data))] ^= 1 << random.randrange(8)
        done.append(sent._replace(data=bytes(data)))
    return done


def without_responses(traffic: Traffic, unit: int | None = None, after: int = 0) -> Traffic:
    """Return the traffic without the responses of a unit, or of all units, behind the first `after` of them."""
    done, left = [], after
    for sent in traffic:
        if not sent.from_client and unit in (None, sent.data[0]):
            left -= 1
            if left < 0:
                continue
        done.append(sent)
    return done


def spaced(traffic: Traffic, seconds: float = 1.2) -> Traffic:
    """Return the traffic with a pause before each request, as a client makes it that waits for a time-out."""
    done, added = [], 0.0
    for sent in traffic:
        added += seconds if sent.from_client else 0.0
        done.append(sent._replace(at=sent.at + added))
    return done


def injected(faults: str, seed: int) -> Traffic:
    """Return the traffic of two units with faults of the simulators in the responses; the client waits 1.3 s."""
    model, done, added, request = Faults(FaultyModbus("rtu"), faults, Random(seed)), list[Sent](), 0.0, b""
    for sent in of_tables("rtu", seed, 40, (1, 2)):
        if sent.from_client:
            added += 1.3
            request = sent.data
            done.append(sent._replace(at=sent.at + added))
        else:
            passed = model.pass_on(sent.data, sent.at + added, request[1:-2])
            done += [Sent(at, data, False) for at, data in passed]
    return sorted(done, key=lambda sent: sent.at)
