"""`barewire sniff`: monitor a serial line or a CAN bus, or a recording of one."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import click

from barewire.cli.arguments import json_option
from barewire.cli.sniff_can import events_of, known_nodes, live, print_events
from barewire.errors import DecodeError, EncodeError, PortError
from barewire.explain.can_monitor.recording import is_can_recording, read_recording
from barewire.explain.capture.modbus_packets import MODBUS_PORTS, PacketBuilder
from barewire.explain.capture.modbus_replay import replay
from barewire.explain.capture.pcapng import file_header, packet_block
from barewire.explain.modbus.exchange_text import exchange_as_dict, exchange_line
from barewire.io.endpoint import Endpoint
from barewire.io.modbus.sniff import listen
from barewire.modbus.sniffer.sniffer import (
    WINDOW,
    AmbiguousFrame,
    NoiseSeen,
    RequestSeen,
    ResponseMissing,
    SnifferEvent,
)
from barewire.rtu import encode as rtu_frame
from barewire.tcp import encode as tcp_frame

FORMS = "a recording: pcapng, pcap, candump, ASC, BLF, or lines of bytes in hexadecimal"


@click.command()
@click.argument("source", metavar="ENDPOINT|FILE")
@json_option
@click.option(
    "--write", type=click.Path(dir_okay=False), metavar="FILE", help="Write every frame to a .pcapng (CAN: or .log)."
)
@click.option("--seconds", type=float, help="Stop after so many; until Ctrl-C if not given.")
@click.option("--window", type=float, default=WINDOW, show_default=True, help="Longest time to an answer, in seconds.")
@click.option("--port", "ports", type=int, multiple=True, help="TCP port of servers in a capture, besides 502.")
@click.option(
    "--device", "devices", multiple=True, metavar="NAME|EDS", help="CAN: the device of a node, for names and units."
)
@click.option("--node", "nodes", type=int, multiple=True, help="CAN: the node-ID of that --device, one for each.")
@click.option("--bus", help="CAN: only this bus of a recording that has several.")
@click.option("--only", multiple=True, metavar="KIND", help="CAN: only such events: sdo, pdo, violation, gap, ...")
@click.option(
    "--all", "everything", is_flag=True, help="CAN: also events without news: each heartbeat, SYNC, same PDO."
)
def sniff(
    source: str,
    as_json: bool,
    write: str | None,
    seconds: float | None,
    window: float,
    ports: tuple[int, ...],
    devices: tuple[str, ...],
    nodes: tuple[int, ...],
    bus: str | None,
    only: tuple[str, ...],
    everything: bool,
) -> None:
    """Decode the traffic of a line or a CAN bus without taking part in it, and report what is missing.

    Nothing is ever sent. A FILE is a pcapng or pcap capture, a log of lines such as "12.345678 01 03 00 00 ...",
    or a hex dump; of a CAN bus what candump prints or logs, Vector's ASC or BLF, or a capture.

    \b
    barewire sniff "rtu:///dev/ttyUSB0?baudrate=9600" --write bus.pcapng
    wireshark -o mbrtu.udp.port:5020 bus.pcapng
    barewire sniff bus.pcapng --json
    barewire sniff can://socketcan/can0 --device az3 --node 5 --write can.log
    """
    endpoint = Endpoint.parse(source) if "://" in source else None
    data = b"" if endpoint is not None else _content(source, seconds)
    if (endpoint is not None and endpoint.scheme == "can") or is_can_recording(data):
        known = known_nodes(devices, nodes)
        items: Iterator[Any] = read_recording(data) if endpoint is None else live(endpoint, seconds)
        with ExitStack() as stack:
            file = None if write is None else stack.enter_context(_opened(write))
            keep = None if file is None else partial(_keep, file)
            heard = events_of(items, known, bus, keep, write or "")
            print_events(heard, as_json=as_json, everything=everything, only=only)
        return
    for option, given in (("--device", devices), ("--node", nodes), ("--bus", bus), ("--only", only)):
        if given:
            raise EncodeError(f"{option} is for a CAN bus, which {source} is not")
    with ExitStack() as stack:
        if endpoint is None:
            events = _replayed(source, data, window, ports)
        else:
            events = listen(endpoint, threading.Event(), seconds=seconds, window=window)
        keeper = None if write is None else _Keeper(stack.enter_context(_opened(write)))
        try:
            for event in events:
                if keeper is not None:
                    keeper.put(event)
                line = json.dumps(exchange_as_dict(event), ensure_ascii=False) if as_json else exchange_line(event)
                if line is not None:
                    print(line, flush=True)
        except KeyboardInterrupt:
            return


def _replayed(source: str, data: bytes, window: float, ports: tuple[int, ...]) -> Iterator[SnifferEvent]:
    try:
        yield from replay(data, window=window, ports=MODBUS_PORTS | set(ports))
    except DecodeError as error:
        raise EncodeError(f"{source}: {error.text}; expected {FORMS}") from None


def _content(source: str, seconds: float | None) -> bytes:
    if seconds is not None:
        raise EncodeError("--seconds is for a line; a recording ends by itself")
    try:
        data = Path(source).read_bytes()
    except OSError as error:
        raise PortError(f"{source}: {error.strerror or error}") from None
    if not data:
        raise EncodeError(f"{source}: the file is empty; expected {FORMS}")
    return data


def _opened(write: str) -> BinaryIO:
    try:
        return Path(write).open("wb")
    except OSError as error:
        raise PortError(f"{write}: {error.strerror}") from None


def _keep(file: BinaryIO, data: bytes) -> None:
    file.write(data)
    file.flush()


class _Keeper:
    """Writes a capture, which is complete after every packet."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._packer = PacketBuilder()
        self._file.write(file_header())

    def put(self, event: SnifferEvent) -> None:
        """Write the frame of an event. Noise is written as a datagram that is not a frame; silence is not written."""
        if isinstance(event, ResponseMissing):
            return
        if isinstance(event, NoiseSeen):
            data = self._packer.rtu(event.noise.data, from_client=True)
        else:
            asks = isinstance(event, RequestSeen | AmbiguousFrame)
            number = None if isinstance(event, AmbiguousFrame) else event.transaction
            if number is None:
                data = self._packer.rtu(rtu_frame(event.unit, event.pdu), from_client=asks)
            else:
                data = self._packer.tcp(tcp_frame(event.unit, event.pdu, number), from_client=asks)
        self._file.write(packet_block(event.at, data))
        self._file.flush()
