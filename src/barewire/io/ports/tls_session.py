"""TLS of a server's connection, as a machine: what came goes in, what was said and what is to be sent come out.

    feed(from the wire) -> [what the client says]         say(to the client)         outgoing() -> for the wire

It is done here and not left to asyncio because asyncio throws away the alert that tells a client why it was refused.
"""

from __future__ import annotations

import ssl

from barewire.io.ports.tcp import CHUNK
from barewire.io.ports.tls import role_of


class TlsSession:
    """One connection. `role` is that of the client's certificate, once `stands`."""

    def __init__(self, context: ssl.SSLContext) -> None:
        self.stands = False
        self.role: str | None = None
        self.ended = False
        """Whether the client said that it has nothing more to say."""
        self._in, self._out = ssl.MemoryBIO(), ssl.MemoryBIO()
        self._tls = context.wrap_bio(self._in, self._out, server_side=True)

    def feed(self, data: bytes) -> list[bytes]:
        """Bytes from the wire. Raises ssl.SSLError when TLS cannot stand, DecodeError for a role that is none."""
        self._in.write(data)
        said: list[bytes] = []
        try:
            if not self.stands:
                self._tls.do_handshake()
                self.role = role_of(self._tls.getpeercert(True) or b"")
                self.stands = True
            while chunk := self._tls.read(CHUNK):
                said.append(chunk)
            self.ended = True
        except ssl.SSLWantReadError:
            pass
        except ssl.SSLZeroReturnError:
            self.ended = True
        return said

    def say(self, data: bytes) -> None:
        """Bytes for the client."""
        self._tls.write(data)

    def outgoing(self) -> bytes:
        """Bytes for the wire: after every `feed`, also one that raised, and after every `say`."""
        return self._out.read()
