"""A CAN bus between processes without CAN hardware: a small server of the socketcand protocol.

    client                      hub
    ------                      ---
                     <-  < hi >
    < open can0 >    ->
                     <-  < ok >
    < rawmode >      ->
                     <-  < ok >
    < send 605 8 40 41 60 0 0 0 0 0 >   ->   to all others:  < frame 605 1764000000.000001 4041600000000000 >

python-can's `socketcand` interface uses this protocol, so any program with python-can can join. Buses have names; a
frame of one client goes to all others on the same bus, as on a cable.
"""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time

from barewire.canopen.frame import BASE_MAX, DATA_MAX, EXTENDED_MAX
from barewire.errors import PortError
from barewire.io.ports.network import reason

_BACKLOG = 0x10000
"""Bytes that may wait for one client; further frames are dropped."""

_LONGEST = 4096
"""Characters without a complete message after which the connection is closed: it is another protocol."""


class SocketcandHub:
    """A server of the socketcand protocol, in a thread of its own. Raises PortError if the port is taken."""

    def __init__(self, host: str, port: int) -> None:
        self._loop = asyncio.new_event_loop()
        self._buses: dict[str, set[asyncio.StreamWriter]] = {}
        try:
            self._server = self._loop.run_until_complete(asyncio.start_server(self._client, host, port))
        except OSError as error:
            self._loop.close()
            raise PortError(f"{host}:{port}: {reason(error)}") from None
        self._thread = threading.Thread(target=self._loop.run_forever, name="socketcand", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Close all connections and the port."""
        asyncio.run_coroutine_threadsafe(self._end(), self._loop).result(timeout=5.0)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(timeout=5.0)
        self._loop.close()

    async def _end(self) -> None:
        self._server.close()
        tasks = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _client(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        name = text = ""
        writer.write(b"< hi >")
        try:
            while (data := await reader.read(_LONGEST)) and len(text) < _LONGEST:
                text += data.decode("latin-1")
                while ">" in text:
                    message, _, text = text.partition(">")
                    words = message.partition("<")[2].split()
                    if words[:1] == ["open"] and len(words) == 2:
                        self._leave(name, writer)
                        name = words[1]
                        writer.write(b"< ok >")
                    elif words == ["rawmode"] and name:
                        self._buses.setdefault(name, set()).add(writer)
                        writer.write(b"< ok >")
                    elif words == ["echo"]:
                        writer.write(b"< echo >")
                    elif words[:1] != ["send"] or not self._pass_on(words[1:], self._buses.get(name, set()) - {writer}):
                        writer.write(b"< error unknown command >")
                    else:
                        continue
                    await writer.drain()  # a client that does not read its answers is not read either
        except ConnectionError:
            pass
        except asyncio.CancelledError:
            writer.transport.abort()  # what a client did not read is not waited for
        finally:
            self._leave(name, writer)
            writer.close()
            with contextlib.suppress(ConnectionError, asyncio.CancelledError):
                await writer.wait_closed()

    def _leave(self, name: str, writer: asyncio.StreamWriter) -> None:
        """Remove a client from a bus, and the bus if it was the last."""
        members = self._buses.get(name, set())
        members.discard(writer)
        if not members:
            self._buses.pop(name, None)

    def _pass_on(self, words: list[str], others: set[asyncio.StreamWriter]) -> bool:
        """Pass a frame, IDENTIFIER LENGTH BYTE..., on to all others. Return False if the text is not a frame."""
        try:
            identifier, length, *data = (int(word, 16) for word in words)
            frame = bytes(data)
        except ValueError:
            return False
        base = len(words[0]) == 3  # three digits are a base identifier, even if the number would fit an extended one
        limit = BASE_MAX if base else EXTENDED_MAX
        if not 0 <= identifier <= limit or length != len(frame) or length > DATA_MAX:
            return False
        written = f"{identifier:03X}" if base else f"{identifier:08X}"
        message = f"< frame {written} {time.time():.6f} {frame.hex().upper()} >".encode()
        for other in others:
            # A client that does not read loses frames, as with a full controller: memory is limited, others never wait.
            if other.transport.get_write_buffer_size() < _BACKLOG:
                other.write(message)
        return True
