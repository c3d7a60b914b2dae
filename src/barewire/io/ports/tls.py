"""Modbus/TCP Security: TLS 1.2 or later, both sides with a certificate, and the role in that of the client.

A client without `cert` and `key` shows no certificate, and a server with `client_cert=none` does not ask for one: this
is TLS as on the web, without roles. The standard requires both [MB-TLS R-06].

    client                                         server
    ------                                         ------
    server's name, signed by the CA?   <------>   signed by the CA? which role?
    Modbus TCP, inside TLS, port 802       ------>  permitted?  no: exception 01

The role is an extension of the certificate [MB-TLS R-21, R-22], which Python's library has no function for:
`modbus.server.authorization` reads it from the DER. The server takes a role only from a certificate that the TLS
library has checked against the CA.

A certificate that is wrong, expired or missing is an error of one line. In TLS 1.3 a client gets the refusal of its
certificate with the first data that it receives, not when it connects.
"""

from __future__ import annotations

import socket
import ssl
from collections.abc import Callable
from typing import TYPE_CHECKING

from barewire.errors import EncodeError, PortError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.network import CHUNK, CONNECT_TIMEOUT, LONGEST_WAIT, TcpPort, reason

if TYPE_CHECKING:
    from barewire.modbus.server.authorization import Authorization

_REASONS = {
    "PEER_DID_NOT_RETURN_A_CERTIFICATE": "the other side showed no certificate",
    "TLSV13_ALERT_CERTIFICATE_REQUIRED": "the other side requires a certificate and received none",
    "SSLV3_ALERT_HANDSHAKE_FAILURE": "the other side refuses us: no certificate was shown, or no cipher is common",
    "SSLV3_ALERT_CERTIFICATE_EXPIRED": "the other side refuses our certificate: it has expired",
    "SSLV3_ALERT_CERTIFICATE_UNKNOWN": "the other side refuses our certificate",
    "SSLV3_ALERT_BAD_CERTIFICATE": "the other side refuses our certificate",
    "SSLV3_ALERT_UNSUPPORTED_CERTIFICATE": "the other side refuses our certificate: it is not for this purpose",
    "TLSV1_ALERT_UNKNOWN_CA": "the other side refuses our certificate: it does not trust the CA that signed it",
    "TLSV1_ALERT_PROTOCOL_VERSION": "the other side does not support our versions of TLS: 1.2 or later",
    "UNSUPPORTED_PROTOCOL": "the other side does not support TLS 1.2 or later",
    "WRONG_VERSION_NUMBER": "the other side does not use TLS",
    "HTTP_REQUEST": "the other side uses HTTP, not TLS",
    "UNEXPECTED_EOF_WHILE_READING": "the other side ended the connection in the middle of TLS",
}


def client_context(endpoint: Endpoint) -> ssl.SSLContext:
    """Return the TLS settings of a client: the CA, and its certificate and key if it has them. The server's name is
    checked."""
    for key, other in (("cert", "key"), ("key", "cert")):
        if key in endpoint.options and other not in endpoint.options:
            raise EncodeError(f"endpoint {str(endpoint)!r}: {key} without {other}: a certificate of its own needs both")
    own = "cert" in endpoint.options
    return _context(endpoint, ssl.PROTOCOL_TLS_CLIENT, ("cert", "key", "ca") if own else ("ca",))


def server_name(endpoint: Endpoint) -> str:
    """Return the name that the certificate of the server must have. Raises EncodeError for an empty one: asyncio would
    accept the certificate of any server then."""
    name = endpoint.options.get("server_name", endpoint.host_and_port[0])
    if not name:
        text = "expected tls://HOST:PORT, or server_name=: the certificate must have this name"
        raise EncodeError(f"endpoint {str(endpoint)!r}: {text}", "server_name")
    return name


def server_context(endpoint: Endpoint) -> ssl.SSLContext:
    """Return the TLS settings of a server, which refuses clients without a certificate [MB-TLS R-06] unless the
    endpoint has `client_cert=none`."""
    if endpoint.choice("client_cert", "required") == "none":
        return _context(endpoint, ssl.PROTOCOL_TLS_SERVER, ("cert", "key"))
    context = _context(endpoint, ssl.PROTOCOL_TLS_SERVER, ("cert", "key", "ca"))
    if endpoint.ssl_context is None:
        context.verify_mode = ssl.CERT_REQUIRED
    return context


def _context(endpoint: Endpoint, side: ssl._SSLMethod, needed: tuple[str, ...]) -> ssl.SSLContext:
    """Return the settings of one side. `needed` are the options that name its files."""
    if endpoint.ssl_context is not None:
        return endpoint.ssl_context
    from pathlib import Path  # not at the top: every asyncio client loads this file, for `tls_reason`

    files = {}
    for key in needed:
        if key not in endpoint.options:
            others = "" if len(needed) == 1 else f": {', '.join(needed[:-1])} and {needed[-1]}"
            without = (
                "; or client_cert=none, to ask clients for no certificate"
                if (side, key) == (ssl.PROTOCOL_TLS_SERVER, "ca")
                else ""
            )
            raise EncodeError(f"endpoint {str(endpoint)!r}: TLS needs {key}=FILE{others}{without}")
        files[key] = Path(endpoint.options[key])
        if not files[key].is_file():
            raise EncodeError(f"endpoint {str(endpoint)!r}: {key}: there is no file {files[key]}")
    context = ssl.SSLContext(side)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.options |= ssl.OP_NO_RENEGOTIATION | ssl.OP_NO_COMPRESSION
    if "cert" in files:
        try:
            context.load_cert_chain(files["cert"], files["key"])
        except (OSError, ValueError) as error:
            text = "they do not belong together" if "MISMATCH" in str(error) else "no certificate and key in PEM"
            raise EncodeError(f"endpoint {str(endpoint)!r}: cert {files['cert']}, key {files['key']}: {text}") from None
    if "ca" in files:
        try:
            context.load_verify_locations(files["ca"])
        except OSError:
            raise EncodeError(f"endpoint {str(endpoint)!r}: ca {files['ca']}: no certificate in PEM") from None
    return context


def dialer(endpoint: Endpoint) -> Callable[[], TlsPort]:
    """Return the function that opens the port of an endpoint. Raises EncodeError for wrong certificates."""
    host, port = endpoint.host_and_port
    context, name = client_context(endpoint), server_name(endpoint)
    return lambda: TlsPort(host, port, context, name)


class TlsPort(TcpPort):
    """A TLS connection to a server, as a blocking port."""

    def __init__(self, host: str, port: int, context: ssl.SSLContext, server_name: str) -> None:
        self._context = context
        self._server_name = server_name
        super().__init__(host, port)

    def _connect(self, host: str, port: int, timeout: float) -> socket.socket:
        connection = super()._connect(host, port, timeout)
        try:
            return self._context.wrap_socket(connection, server_hostname=self._server_name)
        except (OSError, ValueError) as error:
            connection.close()
            raise PortError(f"{self.name}: {tls_reason(error)}") from None

    def send(self, item: bytes) -> None:
        """Send bytes inside TLS."""
        try:
            self._socket.settimeout(CONNECT_TIMEOUT)
            self._socket.sendall(item)
        except (OSError, ValueError) as error:
            raise PortError(f"{self.name}: {self._why(error)}") from None

    def receive(self, timeout: float) -> bytes | None:
        """Return received bytes, or None after `timeout` seconds. TLS may hold bytes, so it is read without `poll`."""
        try:
            self._socket.settimeout(min(timeout, LONGEST_WAIT))
            data = self._socket.recv(CHUNK)
        except (TimeoutError, ssl.SSLWantReadError):
            return None
        except (OSError, ValueError) as error:
            raise PortError(f"{self.name}: {self._why(error)}") from None
        if not data:
            raise PortError(f"{self.name}: {self._why()}")
        return data

    def _why(self, error: Exception | None = None) -> str:
        return super()._why() if error is None or self._is_closed else tls_reason(error)


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
                if certificate is not None:
                    from barewire.modbus.server.authorization import role_of

                    self.role = role_of(certificate)
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


def tls_reason(error: Exception) -> str:
    """Return why a connection failed, in one line: a reason of TLS, or of the system."""
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"the other side's certificate is refused: {error.verify_message.rstrip('.')}"
    if isinstance(error, (ssl.SSLEOFError, ssl.SSLZeroReturnError)):
        return _REASONS["UNEXPECTED_EOF_WHILE_READING"]
    if isinstance(error, ssl.SSLError):
        # Python does not know the reasons of an OpenSSL newer than itself; the text in `args` names them all the same.
        text = getattr(error, "reason", None) or str(error.args[-1]).removeprefix("[SSL] ").partition(" (_ssl.c")[0]
        text = _REASONS.get(text, text).replace("_", " ")
        return text if "TLS" in text or "the other side" in text else f"TLS failed: {text.lower()}"
    return reason(error)


# The roles and their permissions ------------------------------------------------------------------------------------


def roles_of(endpoint: Endpoint) -> Authorization | None:
    """Return the table of roles that an endpoint names; None for `any`, which permits everything to every client that
    the server accepts.

    Raises EncodeError without `roles`: permissions have no default.
    """
    name = endpoint.options.get("roles")
    if name is None:
        text = "roles=FILE is the table of the rights of each role; roles=any permits all to all clients"
        raise EncodeError(f"endpoint {str(endpoint)!r}: {text}", "roles")
    if name == "any":
        return None
    from pathlib import Path

    from barewire.modbus.server.authorization import Authorization

    try:
        return Authorization.parse(Path(name).read_text(encoding="utf-8"))
    except UnicodeDecodeError as error:
        text = f"roles {name}: not UTF-8 at byte {error.start}"
        raise EncodeError(f"endpoint {str(endpoint)!r}: {text}", "roles") from None
    except OSError as error:
        raise EncodeError(f"endpoint {str(endpoint)!r}: roles {name}: {reason(error)}", "roles") from None
