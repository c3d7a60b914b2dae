"""mbusd (C) as an adapter: a gateway from TCP to a pseudo-terminal, in real time.

barewire vectors check --timeout 30 --adapter "python vectors/peers mbusd"

It is built by peer.toml.
"""

from __future__ import annotations

import os
import pty
import select
import socket
import subprocess
import sys
import time
import tty
from typing import Any

from adapter import NotOffered, hexed, octets, serve

PROGRAM = sys.argv[1]
EFFECT = 0.02
"""Seconds after which what a step has caused has been sent; until its line has been silent, a frame is not whole."""


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


class Gateway:
    """mbusd between a pseudo-terminal and two clients, and what it has sent to whom."""

    def __init__(self, settings: dict[str, Any]) -> None:
        self.line, self.far = pty.openpty()
        tty.setraw(self.line)
        tty.setraw(self.far)
        port = free_port()
        words = [PROGRAM, "-d", "-L", "-", "-v", "0", "-p", os.ttyname(self.far), "-s", "19200", "-m", "8n1"]
        words += ["-A", "127.0.0.1", "-P", str(port), "-N", "0", "-R", "25", "-W", str(settings["timeout"] // 1000)]
        self.process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self.clients = {name: connected(port) for name in "12"}
        self.places: dict[Any, str] = {client: name for name, client in self.clients.items()}
        self.places[self.line] = "line"
        self.said: list[dict[str, str]] = []

    def send(self, name: str, data: bytes) -> None:
        if name == "line":
            os.write(self.line, data)
        else:
            self.clients[name].sendall(data)

    def listen(self, until: float) -> None:
        """Keep what is sent up to a time: what goes to the line or to one client without a pause is one message."""
        while (left := until - time.monotonic()) > 0:
            for place in select.select([*self.places], [], [], left)[0]:
                data = os.read(self.line, 1024) if place == self.line else place.recv(1024)
                name = self.places[place]
                if not data:
                    raise ConnectionError("it has closed the connection")
                for message in [data] if name == "line" else messages(data):
                    self.keep(name, message)

    def keep(self, name: str, data: bytes) -> None:
        recent = self.said and self.said[-1]["to"] == name == "line"
        if recent and time.monotonic() - self.last < EFFECT / 2:
            self.said[-1]["bytes"] += " " + hexed(data)
        else:
            self.said.append({"to": name, "bytes": hexed(data)})
        self.last = time.monotonic()

    def take(self) -> list[dict[str, str]]:
        said, self.said = self.said, []
        return said

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        for client in self.clients.values():
            client.close()
        os.close(self.line)
        os.close(self.far)


def connected(port: int) -> socket.socket:
    """Return a connection, as soon as the program listens."""
    end = time.monotonic() + 5
    while True:
        try:
            return socket.create_connection(("127.0.0.1", port))
        except ConnectionRefusedError:
            if time.monotonic() > end:
                raise
            time.sleep(0.01)


def messages(data: bytes) -> list[bytes]:
    """Return the messages of a piece of a TCP stream."""
    found = []
    while data:
        size = 6 + int.from_bytes(data[4:6], "big")
        found.append(data[:size])
        data = data[size:]
    return found


def run(question: dict[str, Any]) -> dict[str, Any]:
    settings, steps = question["gateway"], question["talk"]
    if any("port" in step for step in steps):
        raise NotOffered("a pseudo-terminal is not unplugged")
    if steps[-1]["at"] > 10_000_000:
        raise NotOffered("in real time this takes too long")
    if any(step.get("from") == "line" and step["at"] < 20_000 for step in steps):
        raise NotOffered("it opens the line with the first request")
    gateway = Gateway(settings)
    try:
        start, talk = time.monotonic(), []
        for step in steps:
            gateway.listen(start + step["at"] / 1e6)
            if "bytes" in step:
                gateway.send(step["from"], octets(step["bytes"]))
                gateway.listen(time.monotonic() + EFFECT)
            talk.append({"say": gateway.take()})
        return {"talk": talk}
    finally:
        gateway.close()


serve("mbusd", {"gateway": {"run": run}})
