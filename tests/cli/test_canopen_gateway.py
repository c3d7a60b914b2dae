"""`barewire canopen-gateway`, as a person with netcat has it: three programs."""

from __future__ import annotations

import signal
import socket
import subprocess

from tests.cli.test_command import COMMAND, failing, free_port, simulated


def test_a_node_is_read_and_reset_through_a_socket() -> None:
    with simulated("az3", f"can://socketcand/127.0.0.1:{free_port()}/can0?node=5") as endpoint:
        command = [*COMMAND, "canopen-gateway", endpoint.partition("?")[0], "--listen", "127.0.0.1:0"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as gateway:
            assert gateway.stdout is not None
            try:
                word, _, where = gateway.stdout.readline().rstrip().partition(" ")
                assert word == "ready"
                host, _, port = where.partition(":")
                with socket.create_connection((host, int(port)), timeout=10) as person, person.makefile("r") as heard:
                    person.sendall(b"[1] 5 read 0x1017 0 u16\n[2] 5 reset node\n")
                    assert [next(heard), next(heard), next(heard)] == ["[1] 1000\n", "[2] OK\n", "1 5 BOOT_UP\n"]
            finally:
                gateway.send_signal(signal.SIGTERM)
            assert gateway.wait(timeout=10) == 0


def test_what_it_cannot_serve() -> None:
    assert "goes over can://" in failing("canopen-gateway", "tcp://127.0.0.1:502")
    assert "expected HOST:PORT" in failing("canopen-gateway", "can://virtual/x", "--listen", "here")
