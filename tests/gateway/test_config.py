"""The configuration: its faults with line and column, its schema, its example, and the program that prints them."""

from __future__ import annotations

import asyncio
import json
import re
import tomllib
from pathlib import Path

import jsonschema
import pytest

from barewire.devices import load
from barewire.gateway.__main__ import run_program
from barewire.gateway.config import OPTIONS, ConfigError, config_schema, example, read_config
from barewire.gateway.dispatch import UnitConfig
from barewire.modbus import UnitOptions
from tests.helpers import every_case
from tools import gateway_clients

GOOD = """\
drain = 1
[[listen]]
url = "tcp://127.0.0.1:1502"
[[backend]]
name = "hall"
url = "rtu:///dev/ttyUSB0?baudrate=19200"
units = "1-3,20"
timeout = 0.5
merge = 4
  [backend.unit.20]
  as = 7
  gap = 0.1
[[backend]]
name = "far"
url = "tcp://192.0.2.1"
units = "30"
in_flight = 4
[policy]
read_only = true
[[policy.allow]]
clients = ["192.0.2.0/24", "127.0.0.1"]
functions = [3, 4]
addresses = "0-99,200"
"""


def test_a_good_configuration() -> None:
    config = read_config(GOOD)
    hall, far = config.backends
    assert config.listeners == ("tcp://127.0.0.1:1502",)
    assert (config.drain, config.policy.read_only, len(config.policy.rules or ())) == (1.0, True, 1)
    assert hall.units == {1: 1, 2: 2, 3: 3, 20: 7}
    assert hall.default == UnitConfig(UnitOptions(0.5, dead_after=2), merge=4)
    assert hall.of_units == {7: UnitConfig(UnitOptions(0.5, gap=0.1, dead_after=2), merge=4)}
    assert (far.options.in_flight, far.default.asking.timeout) == (4, 1.0)


def test_how_units_are_asked_may_stand_in_the_url_and_the_tables_go_before_it() -> None:
    url = "rtu:///dev/ttyUSB0?timeout=2&gap=0.3&gap.2=0.4&dead_after.3=5&longest_pause.3=9"
    text = GOOD.replace("rtu:///dev/ttyUSB0?baudrate=19200", url) + "\n"
    hall = read_config(text).backends[0]
    assert hall.default.asking == UnitOptions(timeout=0.5, gap=0.3, dead_after=2)
    assert {unit: config.asking for unit, config in hall.of_units.items()} == {
        2: UnitOptions(0.5, 0.4, 2),
        3: UnitOptions(0.5, 0.3, 5, 9.0),
        7: UnitOptions(0.5, 0.1, 2),
    }
    assert all(config.merge == 4 for config in hall.of_units.values())


@pytest.mark.parametrize(
    ("query", "text"),
    [
        ("gap.9=1", "option of a unit that is not in units"),
        ("timeout.2=0", "timeout=0: expected more"),
        ("retries=3", "retries=3: the gateway sends a request once, and its client repeats it"),
        ("unit=9", "unit=9: units says what is behind the line"),
    ],
)
def test_a_url_of_a_backend_with_a_wrong_option_of_a_unit(query: str, text: str) -> None:
    with pytest.raises(ConfigError, match=f"^6:1: .*{text}"):
        read_config(GOOD.replace("baudrate=19200", query))


@every_case(
    ("old", "new", "faults"),
    [
        ("drain = 1", "drain = -1", ["1:1: drain = -1: expected 0 or more seconds"]),
        ("drain = 1", "drain = true", ["1:1: drain = True: expected 0 or more seconds"]),
        ("drain = 1", "dran = 1", ["1:1: unknown 'dran', expected drain, listen, backend, status, publish, policy"]),
        ("1502", "99999", ["3:1: endpoint 'tcp://127.0.0.1:99999': port '99999' is not a number in 0..65535"]),
        ("tcp://127.0.0.1:1502", "rtu:///dev/ttyS0",
         ["3:1: clients connect over a network: tcp, tls, udp, rtu+tcp or ascii+tcp"]),
        ('name = "hall"\n', "", ["4:1: [[backend]] has no name: how the log calls it"]),
        ('name = "hall"', 'name = "far"', ["14:1: name = 'far': another backend has this name"]),
        ("baudrate", "baud", ["6:1: endpoint 'rtu:///dev/ttyUSB0?baud=19200': unknown option 'baud'"]),
        ('"1-3,20"', '"3-1"', ["7:1: units = '3-1': expected unit addresses and ranges, 0 to 255, such as",
                               "10:3: unit 20: expected a unit that is in units"]),
        ('"1-3,20"', '"0-3,20"', ["7:1: a serial line has no unit 0: broadcast = true sends broadcasts"]),
        ("timeout = 0.5", 'timeout = "0.5"', ["8:1: timeout = '0.5': expected more than 0 seconds"]),
        ("timeout = 0.5", "timeout = 0", ["8:1: timeout = 0: expected more than 0 seconds"]),
        ("timeout = 0.5", "queue = 0", ["8:1: queue = 0: expected a whole number, 1 or more"]),
        ("timeout = 0.5", "patience = 0", ["8:1: patience = 0: expected more than 0 seconds"]),
        ("gap = 0.1", "timeout = 0", ["12:3: timeout = 0: expected more than 0 seconds"]),
        ("as = 7", "as = 300", ["11:3: as = 300: expected a unit address, 0..255"]),
        ("gap = 0.1", "gapp = 0.1", ["12:3: unknown 'gapp', expected as, timeout, gap"]),
        ("units = \"30\"", "units = \"3-30\"", ["16:1: unit 3 is behind 'hall' already"]),
        ("in_flight = 4", "in_flight = 17", ["17:1: in_flight = 17: expected 1 to 16 requests"]),
        ("merge = 4", "in_flight = 2", ["9:1: in_flight = 2: expected 1: a serial line has one at a time"]),
        ("in_flight = 4", "broadcast = true", ["17:1: broadcast: only a serial line has broadcasts"]),
        ("read_only = true", "readonly = true", ["19:1: unknown 'readonly', expected read_only, allow"]),
        ('"127.0.0.1"]', '"localhost"]', ["21:1: clients = ['192.0.2.0/24', 'localhost']: expected a list"]),
        ("192.0.2.0/24", "192.0.2.5/24",
         ["21:1: clients: '192.0.2.5/24' has host bits: expected 192.0.2.0/24, or the address alone"]),
        ("[3, 4]", "[3, 200]", ["22:1: functions = [3, 200]: expected a list of function codes, 1 to 127"]),
        ("0-99,200", "0-99,x", ["23:1: addresses = '0-99,x': expected numbers and ranges"]),
        ("gap = 0.1", 'device = "az3"', ["12:3: device: only for units on CAN, where objects become registers"]),
        ("tcp://192.0.2.1", "tls://192.0.2.1?ca=/none.crt",
         ["15:1: endpoint 'tls://192.0.2.1?ca=/none.crt': ca: there is no file /none.crt"]),
        ("tcp://192.0.2.1", "tcp://192.0.2.1?idle=5", ["15:1: idle=5: only servers have it"]),
        ("1502", "1502?gap=3", ["3:1: gap=3: only clients have it, and each backend"]),
        ("1502", "1502?timeout.7=3", ["3:1: timeout.7=3: only clients have it, and each backend"]),
        ("1502", "1502?unit=3", ["3:1: unit=3: only clients have it, and each backend"]),
        ("backend.unit.20", "backend.unit." + "9" * 5000, ["10:3: unit '9999999999"]),
        ("backend.unit.20", 'backend.unit."\u0662"', ["10:3: unit '\u0662': expected"]),
        ("tcp://192.0.2.1", "tls://192.0.2.1", ["15:1: endpoint 'tls://192.0.2.1': TLS needs ca=FILE"]),
        ("rtu:///dev/ttyUSB0?baudrate=19200", "rtu://pty", ["6:1: endpoint 'rtu://pty': rtu://pty is for servers"]),
        ("tcp://192.0.2.1\"\nunits = \"30\"\nin_flight = 4", "can://nosuch/x\"\nunits = \"30\"",
         ["15:1: endpoint 'can://nosuch/x': unknown interface 'nosuch', expected "]),
        ("tcp://192.0.2.1", "can://memory", ["15:1: endpoint 'can://memory': expected can://INTERFACE/CHANNEL",
                                             ]),
        ("[policy]", "[status]\nurl = 'https://x'\n[policy]", ["19:1: url = 'https://x': expected http://HOST:PORT"]),
        ("[policy]", "[status]\nurl = 'http://me:s3cret@x:80'\n[policy]", ["19:1: url: expected http://HOST:PORT"]),
        ("tcp://192.0.2.1", "tcp://127.0.0.1:1502", ["15:1: 127.0.0.1:1502 is a listener of this gateway: "]),
        ("[policy]", "[policy", ["18:8: Expected ']' at the end of a table declaration"]),
        ("[[policy.allow]]", "[policy.allow]", ["20:1: allow: expected [[policy.allow]], a table for each"]),
    ],
)  # fmt: skip
def test_each_fault_has_its_line_and_column(old: str, new: str, faults: list[str]) -> None:
    assert old in GOOD
    with pytest.raises(ConfigError) as wrong:
        read_config(GOOD.replace(old, new))
    texts = list(map(str, wrong.value.faults))
    assert len(texts) == len(faults)
    for text, beginning in zip(texts, faults):
        assert text.startswith(beginning)


def lines(
    listeners: tuple[str, ...], backends: tuple[str, ...], status: str = "", machines: tuple[str, ...] = ()
) -> str:
    """A configuration: each listener is a line of it, each backend three."""
    text = "".join(f'[[listen]]\nurl = "{url}"\n' for url in listeners)
    for number, url in enumerate(backends, 1):
        text += f'[[backend]]\nname = "{number}"\nunits = {number}\nurl = "{url}"\n'
    if status:
        text += f'[status]\nurl = "{status}"\n'
    if machines:
        text += '[publish]\nbroker = "mqtt://127.0.0.1"\nsite = "x"\n'
    for number, url in enumerate(machines):
        text += f'[[publish.machine]]\nname = "{number}"\ndevice = "adxl"\nparameters = ["{NAME}"]\nurl = "{url}"\n'
    return text


NAME = next(row.name for row in load("adxl").parameters if row.readable and row.modbus)
TCP, USB, FAR = "tcp://127.0.0.1:1502", "rtu:///dev/ttyUSB0", "tcp://192.0.2.1"


@every_case(
    ("listeners", "backends", "status", "machines", "fault"),
    [
        ((TCP,), (USB, "rtu:///dev/ttyUSB0?baudrate=9600"), "", (), "10:1: /dev/ttyUSB0 is the line of the backend"),
        ((TCP,), (USB, "ascii:///dev/../dev/ttyUSB0"), "", (), "10:1: /dev/../dev/ttyUSB0 is the line of the backend"),
        ((TCP,), (FAR,), "", (USB, "ascii:///dev/ttyUSB0"), "19:1: /dev/ttyUSB0 is the line of the machine '0'"),
        ((TCP,), (USB,), "", ("ascii:///dev/ttyUSB0?unit=3",), "14:1: /dev/ttyUSB0 is the line of the backend '1'"),
        ((TCP,), (FAR,), "", (USB, f"{USB}?unit=3"), None),
        ((TCP, f"{TCP}?idle=5"), (FAR,), "", (), "4:1: port 1502 is that of another listener"),
        ((TCP, "rtu+tcp://0.0.0.0:1502"), (FAR,), "", (), "4:1: port 1502 is that of another listener"),
        ((TCP, "tcp://localhost:1502"), (FAR,), "", (), "4:1: port 1502 is that of another listener"),
        ((TCP, "udp://127.0.0.1:1502", "tcp://[::1]:1502", "tcp://127.0.0.2:1502"), (FAR,), "", (), None),
        (("tcp://127.0.0.1:0", "tcp://127.0.0.1:0"), (FAR,), "", (), None),
        ((TCP,), (FAR,), "http://0.0.0.0:1502", (), "8:1: port 1502 is that of a listener"),
        ((TCP,), (FAR,), "http://[::]:1502", (), None),
        (("tcp://127.0.0.1",), ("tcp://127.0.0.1",), "", (), "6:1: 127.0.0.1 is a listener of this gateway"),
        (("tcp://0.0.0.0:1502",), ("tcp://127.0.0.9:1502",), "", (), "6:1: 127.0.0.9:1502 is a listener of this"),
        (("tcp://192.0.2.7:1502",), ("rtu+tcp://192.0.2.7:1502",), "", (), "6:1: 192.0.2.7:1502 is a listener of this"),
        (("tcp://0.0.0.0:1502",), ("tcp://192.0.2.1:1502",), "", (), None),
        (("udp://127.0.0.1:1502",), (TCP,), "", (), None),
    ],
)  # fmt: skip
def test_what_two_would_open_is_found_however_it_is_written(
    listeners: tuple[str, ...], backends: tuple[str, ...], status: str, machines: tuple[str, ...], fault: str | None
) -> None:
    text = lines(listeners, backends, status, machines)
    if fault is None:
        read_config(text)
        return
    with pytest.raises(ConfigError) as wrong:
        read_config(text)
    (found,) = map(str, wrong.value.faults)
    assert found.startswith(fault)


def test_an_empty_file_says_what_is_missing() -> None:
    with pytest.raises(ConfigError) as wrong:
        read_config("")
    assert [fault.text.partition(":")[0] for fault in wrong.value.faults] == ["no [[backend]]", "no [[listen]]"]


def test_two_units_may_be_the_same_one_unless_they_have_options_of_their_own() -> None:
    text = 'name = "x"\nurl = "tcp://192.0.2.1"\nunits = "1-2"\n[backend.unit.2]\nas = 1\n'
    text = f'[[listen]]\nurl = "tcp://127.0.0.1:1502"\n[[backend]]\n{text}'
    assert read_config(text).backends[0].units == {1: 1, 2: 1}
    with pytest.raises(ConfigError, match="another unit has this address too"):
        read_config(text + "gap = 0.1\n")


def test_the_example_is_valid_also_with_everything_that_is_commented_out() -> None:
    read_config(example())
    everything = "\n".join(line.removeprefix("# ") for line in example().splitlines()[1:])
    everything = everything.replace("broadcast = false", "broadcast = true").replace("/var/lib/barewire/", "")
    of_can = re.compile('^(device = "az3"|eds|registers).*\n', re.MULTILINE)
    config = read_config(of_can.sub("", everything))
    jsonschema.validate(tomllib.loads(everything), config_schema())
    names = {option.name for options in OPTIONS.values() for option in options}
    assert all(f"\n{name} = " in f"\n{everything}" for name in names)
    assert config.policy.rules is not None


@pytest.mark.parametrize(
    ("old", "new"),
    [("drain = 1", "dran = 1"), ('name = "hall"\n', ""), ("timeout = 0.5", "timeout = 0"), ("[3, 4]", "[3, 200]")],
)
def test_the_schema_refuses_what_the_check_refuses(old: str, new: str) -> None:
    form = config_schema()
    jsonschema.Draft202012Validator.check_schema(form)
    jsonschema.validate(tomllib.loads(GOOD), form)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(tomllib.loads(GOOD.replace(old, new)), form)


def test_the_program_prints_example_and_schema(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_program(["--example"]) == 0
    assert capsys.readouterr().out == example()
    assert run_program(["--schema"]) == 0
    assert json.loads(capsys.readouterr().out) == config_schema()


def test_the_program_checks_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "gateway.toml"
    file.write_text(GOOD)
    assert run_program(["--check", str(file)]) == 0
    assert capsys.readouterr().out == f"{file}: 1 listener, 2 backends: nothing wrong\n"
    file.write_text(GOOD.replace("drain = 1", "dran = 1").replace("gap = 0.1", "gapp = 0.1"))
    assert run_program(["--check", str(file)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert [line.partition(": ")[0] for line in lines] == [f"{file}:1:1", f"{file}:12:3"]


def test_the_check_says_which_units_on_can_have_no_registers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "gateway.toml"
    backend = '[[backend]]\nname = "bus"\nurl = "can://memory/check"\nunits = "5-7"\n[backend.unit.6]\ndevice = "az3"'
    file.write_text(f'[[listen]]\nurl = "tcp://127.0.0.1:0"\n{backend}\n')
    assert run_program(["--check", str(file)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        f"{file}: 1 listener, 1 backend: nothing wrong",
        f"{file}: backend 'bus', unit 5, 7: no registers without [backend.unit.N] device or eds: "
        "only function 2B/0D reaches it",
    ]


@pytest.mark.parametrize("content", [None, b"\xff\xfe"])
def test_a_file_that_cannot_be_read_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: bytes | None
) -> None:
    file = tmp_path / "gateway.toml"
    if content is not None:
        file.write_bytes(content)
    assert run_program([str(file)]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith(f"{file}: ")


def test_the_files_of_the_documentation_are_valid() -> None:
    page = Path(__file__).parents[2] / "docs" / "how-to" / "gateway.md"
    blocks = re.findall(r"```toml\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    shortest, trial, *rest = blocks
    read_config(trial)
    with pytest.raises(ConfigError) as wrong:
        read_config("\n".join([shortest, *rest]))
    assert [fault.text.partition(":")[0] for fault in wrong.value.faults] == ["eds 'node.eds'"]


@pytest.mark.parametrize("name", ["home-assistant", "node-red", "telegraf", "esphome"])
def test_the_gateways_for_other_programs_are_valid(name: str) -> None:
    page = Path(__file__).parents[2] / "docs" / "how-to" / f"{name}.md"
    blocks = re.findall(r"```toml\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    ours = [block for block in blocks if "[[listen]]" in block]
    assert ours
    for block in ours:
        read_config(block)


def test_the_configurations_of_other_programs_hold_together(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TELEGRAF", raising=False)
    assert "every option is one of its plugin" in asyncio.run(gateway_clients.telegraf())
    (flow,) = gateway_clients.blocks("node-red", "json")
    nodes = {node["id"]: node for node in json.loads(flow)}
    for node in nodes.values():
        named = {node.get("z"), node.get("server"), *(other for wire in node.get("wires", []) for other in wire)}
        assert named - {None} <= nodes.keys(), node["id"]


def test_the_publisher_of_the_documentation_is_valid() -> None:
    page = Path(__file__).parents[2] / "docs" / "how-to" / "publish.md"
    (block,) = re.findall(r"```toml\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    config = read_config(block.replace("?ca=/etc/barewire/ca.crt", "").replace("/var/lib/barewire/", ""))
    assert config.publish is not None
    assert [machine.name for machine in config.publish.machines] == ["press", "pump"]
