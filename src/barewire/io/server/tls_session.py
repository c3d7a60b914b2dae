"""The TLS state of a connection of an asyncio server."""

from __future__ import annotations

import ssl

from barewire.errors import PortError
from barewire.io.ports.network import CHUNK
from barewire.io.ports.tls import tls_reason
from barewire.modbus.server.authorization import role_of


class TlsSession:
    """The TLS state of one connection, without a socket. `role` is that of the certificate, after the handshake.

    The TLS of asyncio drops the alert with the reason why a client's certificate was refused; this one sends it.
    """

    def __init__(self, context: ssl.SSLContext) -> None:
        self.is_established = False
        self.role: str | None = None
        self.ended = False
        """Whether the client ended the session."""
        self._in, self._out = ssl.MemoryBIO(), ssl.MemoryBIO()
        self._tls = context.wrap_bio(self._in, self._out, server_side=True)

    def feed(self, data: bytes) -> list[bytes]:
        """Feed bytes from the wire, and return the data of the client.

        Raises PortError when the handshake fails, DecodeError for a role that cannot be read.
        """
        self._in.write(data)
        received: list[bytes] = []
        try:
            if not self.is_established:
                self._tls.do_handshake()
                certificate = self._tls.getpeercert(True)  # None: the server does not ask for one
                self.role = None if certificate is None else role_of(certificate)
                self.is_established = True
            while chunk := self._tls.read(CHUNK):
                received.append(chunk)
            self.ended = True
        except ssl.SSLWantReadError:
            pass
        except ssl.SSLZeroReturnError:
            self.ended = True
        except ssl.SSLError as error:
            raise PortError(tls_reason(error)) from None
        return received

    def send(self, data: bytes) -> None:
        """Encrypt bytes for the client."""
        self._tls.write(data)

    def outgoing(self) -> bytes:
        """Return the bytes for the wire. Call it after every `feed`, also one that raised, and after every `send`."""
        return self._out.read()
