"""`barewire canopen-gateway`: a simulated device, the gateway and a client on a socket."""

from __future__ import annotations

import signal
import socket
import subprocess

from tests.helpers import free_port
from tests.workbench.cli.helpers import (
    COMMAND,
    error_of,
    simulated_at,
)


def test_a_client_reads_and_resets_a_node() -> None:
    with simulated_at("az3", f"can://socketcand/127.0.0.1:{free_port()}/can0?node=5") as endpoint:
        options = ["--listen", "127.0.0.1:0", "--node-id", "1", "--indications"]
        command = [*COMMAND, "canopen-gateway", endpoint.partition("?")[0], *options]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as gateway:
            assert gateway.stdout is not None
            try:
                word, _, address = gateway.stdout.readline().rstrip().partition(" ")
                assert word == "ready"
                host, _, port = address.partition(":")
                with socket.create_connection((host, int(port)), timeout=60) as client, client.makefile("r") as lines:
                    client.sendall(b"[1] 5 read 0x1017 0 u16\n[2] 5 reset node\n")
                    assert [next(lines) for _ in range(3)] == ["[1] 1000\n", "[2] OK\n", "1 5 BOOT_UP\n"]
                    client.sendall(b"[3] 1 read 0x1008 0 vs\n")
                    assert next(lines) == '[3] "barewire gateway"\n'
            finally:
                gateway.send_signal(signal.SIGTERM)
            assert gateway.wait(timeout=60) == 0


def test_an_address_of_ipv6_is_printed_as_it_is_typed() -> None:
    command = [*COMMAND, "canopen-gateway", "can://memory/ipv6", "--listen", "[::1]:0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as gateway:
        assert gateway.stdout is not None
        try:
            assert gateway.stdout.readline().startswith("ready [::1]:")
        finally:
            gateway.send_signal(signal.SIGTERM)
        assert gateway.wait(timeout=60) == 0


def test_an_eds_without_a_node_id_is_refused() -> None:
    assert "expected --node-id too" in error_of("canopen-gateway", "can://virtual/x", "--eds", "a.eds", status=2)
    refusal = error_of("canopen-gateway", "can://virtual/x", "--node-id", "1", "--eds", "no-such.eds", status=2)
    assert "no-such.eds" in refusal


def test_wrong_endpoints_are_refused() -> None:
    assert "the gateway is for CANopen: expected can://" in error_of("canopen-gateway", "tcp://127.0.0.1:502", status=2)
    assert "expected HOST:PORT" in error_of("canopen-gateway", "can://virtual/x", "--listen", "here", status=2)
