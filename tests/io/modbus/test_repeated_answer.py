"""An answer that comes twice: the second copy is received before the next request, and is not taken for its answer.

Where answers have no transaction numbers, everything received is read before a request is sent. For an asyncio client
this includes what the system has received while the program kept the loop busy.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
from collections.abc import Callable, Iterator

import pytest

from barewire import AsyncModbusClient, ModbusClient, ascii, rtu

FRAMINGS: dict[str, Callable[[int, bytes], bytes]] = {"rtu+tcp": rtu.encode, "ascii+tcp": ascii.encode}


class Echoing:
    """A serial server that sends its first answer twice; `again` is set when the copy has been sent."""

    def __init__(self, encode: Callable[[int, bytes], bytes]) -> None:
        self.again = threading.Event()
        self._encode = encode
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        with contextlib.suppress(OSError), self._listener.accept()[0] as talker:
            for value in (1, 2, 3):
                if not talker.recv(100):
                    return
                answer = self._encode(1, bytes((3, 2, 0, value)))
                talker.sendall(answer)
                if not self.again.is_set():
                    self.taken.wait(10)
                    talker.sendall(answer)
                    # Loopback delivers before it returns: the copy is in the client's buffer.
                    self.again.set()

    taken = threading.Event()

    def close(self) -> None:
        self._listener.close()
        self._thread.join(10)


@pytest.fixture(params=FRAMINGS)
def peer(request: pytest.FixtureRequest) -> Iterator[tuple[str, Echoing]]:
    there = Echoing(FRAMINGS[request.param])
    there.taken = threading.Event()
    yield f"{request.param}://127.0.0.1:{there.port}?unit=1&timeout=10", there
    there.close()


def test_a_repeated_answer_is_not_taken_for_the_next_one(peer: tuple[str, Echoing]) -> None:
    url, there = peer
    with ModbusClient(url) as client:
        assert client.read_holding_registers(10, 1) == (1,)
        there.taken.set()
        assert there.again.wait(10)
        assert client.read_holding_registers(20, 1) == (2,)
        assert client.bus.counters.strays == 1


def test_a_repeated_answer_while_an_asyncio_program_was_busy(peer: tuple[str, Echoing]) -> None:
    url, there = peer

    async def main() -> None:
        async with AsyncModbusClient(url) as client:
            assert await client.read_holding_registers(10, 1) == (1,)
            there.taken.set()
            assert there.again.wait(10)  # not awaited: the loop stands still, like a program in a hurry
            assert await client.read_holding_registers(20, 1) == (2,)
            assert client.bus.counters.strays == 1

    asyncio.run(main())
