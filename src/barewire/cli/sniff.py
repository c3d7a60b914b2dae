"""`barewire sniff`: listen in on a line, or on a recording of one."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import BinaryIO

import click

from barewire.cli.arguments import json_option
from barewire.errors import EncodeError, PortError
from barewire.explain.overheard import as_dict, in_words
from barewire.explain.packets import MODBUS_PORTS, Packer
from barewire.explain.pcapng import header, packet
from barewire.explain.replay import replay
from barewire.modbus.sniff import WINDOW, Asked, Disturbance, Half, Overheard, Unanswered
from barewire.rtu import encode as rtu_frame
from barewire.shells.endpoint import Endpoint
from barewire.shells.listen import listen
from barewire.tcp import encode as tcp_frame


@click.command()
@click.argument("source", metavar="ENDPOINT|FILE")
@json_option
@click.option("--write", type=click.Path(dir_okay=False), metavar="FILE.pcapng", help="Write every frame there too.")
@click.option("--seconds", type=float, help="Stop after so many; until Ctrl-C if not given.")
@click.option("--window", type=float, default=WINDOW, show_default=True, help="Longest time to an answer, in seconds.")
@click.option("--port", "ports", type=int, multiple=True, help="TCP port of servers in a capture, besides 502.")
def sniff(
    source: str, as_json: bool, write: str | None, seconds: float | None, window: float, ports: tuple[int, ...]
) -> None:
    """Decode both directions of a line that we take no part in: each request with its answer, and what went missing.

    Nothing is ever sent. A FILE is a pcapng or pcap capture, a log of lines such as "12.345678 01 03 00 00 ...",
    or a hex dump.

    \b
    barewire sniff "rtu:///dev/ttyUSB0?baudrate=9600" --write bus.pcapng
    wireshark -o mbrtu.udp.port:5020 bus.pcapng
    barewire sniff bus.pcapng --json
    """
    with ExitStack() as stack:
        events = _events(source, seconds, window, ports)
        keep = None
        if write is not None:
            try:
                keep = _Keeper(stack.enter_context(Path(write).open("wb")))
            except OSError as error:
                raise PortError(f"{write}: {error.strerror}") from None
        try:
            for event in events:
                if keep is not None:
                    keep.put(event)
                line = json.dumps(as_dict(event), ensure_ascii=False) if as_json else in_words(event)
                if line is not None:
                    print(line, flush=True)
        except KeyboardInterrupt:
            return


def _events(source: str, seconds: float | None, window: float, ports: tuple[int, ...]) -> Iterator[Overheard]:
    if "://" in source:
        return listen(Endpoint.parse(source), threading.Event(), seconds=seconds, window=window)
    if seconds is not None:
        raise EncodeError("--seconds is for a line; a recording ends by itself")
    try:
        data = Path(source).read_bytes()
    except OSError as error:
        raise PortError(f"{source}: {error.strerror}") from None
    return replay(data, window=window, ports=MODBUS_PORTS | set(ports))


class _Keeper:
    """A capture that grows: whole after every packet."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._packer = Packer()
        self._file.write(header())

    def put(self, event: Overheard) -> None:
        """The frame of an event. What was not heard is not written; noise is, as a datagram that is no frame."""
        if isinstance(event, Unanswered):
            return
        if isinstance(event, Disturbance):
            data = self._packer.rtu(event.noise.data, from_client=True)
        else:
            asks = isinstance(event, Asked | Half)
            number = None if isinstance(event, Half) else event.transaction
            if number is None:
                data = self._packer.rtu(rtu_frame(event.unit, event.pdu), from_client=asks)
            else:
                data = self._packer.tcp(tcp_frame(event.unit, event.pdu, number), from_client=asks)
        self._file.write(packet(event.at, data))
        self._file.flush()
