"""Every command, and every option and argument with a restricted form: what cannot be understood is one line and exit
status 2, before anything is opened, and the nearest name is suggested."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from barewire_workbench.cli.app import COMMANDS, barewire_command, run_command_line
from tests.helpers import every_case
from tests.workbench.cli.wrong_steps import LONG_STEPS, WRONG_PICTURES, WRONG_STEPS

TCP = "tcp://127.0.0.1:1"  # nothing listens there: a command that connects fails with exit status 1
CAN = "can://socketcand/127.0.0.1:1/can0?node=5"
READ, WATCH, WRITE = ("read", TCP, "adxl"), ("watch", TCP, "adxl", "Status"), ("write", TCP, "adxl")
SIMULATE, SNIFF, EXPLAIN = (
    ("simulate", "adxl", "tcp://127.0.0.1:0"),
    ("sniff", "rtu:///dev/null"),
    ("explain", "rtu", "01"),
)
MOVE = ("drive", TCP, "az3", "move", "100")

WRONG: list[tuple[tuple[str, ...], str]] = [
    # Endpoints, devices, names and values, which many commands have
    (("reed", TCP), "did you mean 'read'"),
    (("read", "tpc://127.0.0.1", "adxl", "Status"), "did you mean 'tcp'?"),
    (("read", "127.0.0.1", "adxl", "Status"), "expected tcp://HOST:PORT"),
    (("read", "tcp://127.0.0.1?unti=1", "adxl", "Status"), "did you mean 'unit'?"),
    (("read", "rtu:///dev/x?recovery=prob", "adxl", "Status"), "did you mean 'probe'?"),
    (("read", "rtu:///dev/x?latency=usbb", "adxl", "Status"), "did you mean 'usb'?"),
    (("read", "can://socketcna/can0", "az3", "STATUS WORD"), "did you mean 'socketcan'"),
    (("read", "can://socketcan/can0?node=0", "az3", "STATUS WORD"), "expected 1..127"),
    (("read", CAN, "adxl", "Status"), "adxl has no CANopen"),
    (("read", TCP, "adlx", "Status"), "did you mean 'adxl'?"),
    (("read", TCP, "csd-mt?order=ABCE", "Status Word"), "did you mean 'ABCD'"),
    (READ, "expected names, --group or --all"),
    ((*READ, "--all", "Status"), "expected no NAME and no --group beside it"),
    ((*READ, "--all", "--csv", "--json"), "--csv and --json: give one of them"),
    ((*READ, "--group", "Measure"), "adxl has no group 'Measure'"),
    ((*READ, "--access", "wo", "--all"), "expected one of ro, rw"),
    ((*READ, "*nothing*"), "no readable parameter of adxl"),
    ((*READ, "Status", "--access", "rw"), "no such value that can be read"),
    ((*READ, "Statsu"), "did you mean 'Status'?"),
    (("read", TCP, "raw", "holdng:1"), "did you mean 'holding'?"),
    (("read", TCP, "raw", "objekt:1018:u32"), "did you mean 'object'?"),
    (("read", TCP, "raw", "Status"), "'Status' is not an address"),
    (("read", TCP, "raw", "holding:0G"), "'0G' is not a number in 0..65535"),
    (("read", TCP, "raw", "holding:3-1"), "'3-1': expected the lower address first"),
    (("read", TCP, "raw", "holding:0-2:f32"), "'0-2' has 3 registers, a f32 has 2"),
    (("read", TCP, "raw", "holding:0-9:text4"), "expected a type with a size of its own"),
    (
        ("read", "az3", TCP, "STATUS WORD"),
        "'az3' is a device: expected barewire read [OPTIONS] ENDPOINT DEVICE NAME...",
    ),
    (("simulate", TCP, "az3"), "'az3' is a device: expected barewire simulate [OPTIONS] DEVICE ENDPOINT..."),
    (("read", "/dev/ttyUSB0", "adxl", "Status"), "did you mean 'rtu:///dev/ttyUSB0'?"),
    (("read", "COM3?baudrate=9600", "adxl", "Status"), "did you mean 'rtu://COM3?baudrate=9600'?"),
    (("read", "127.0.0.1:1502", "adxl", "Status"), "did you mean 'tcp://127.0.0.1:1502'?"),
    (("read", "vcan0", "az3", "STATUS WORD"), "did you mean 'can://socketcan/vcan0'?"),
    (("read", "can://can0", "az3", "STATUS WORD"), "did you mean 'can://socketcan/can0'?"),
    (("read", "rtu://dev/ttyUSB0", "adxl", "Status"), "did you mean 'rtu:///dev/ttyUSB0', with three slashes?"),
    (("read", "rtu://pty", "adxl", "Status"), "rtu://pty is for servers"),
    (("read", *READ[1:], "Status", "-v"), "'-v' stands before the command: barewire -v read ..."),
    (("read", *READ[1:], "Status", "--verbose"), "'--verbose' stands before the command: barewire --verbose read ..."),
    (("read",), "Missing argument 'ENDPOINT'; see barewire read --help"),
    (("read", TCP, "raw", "holding:65536"), "is not a number in 0..65535"),
    (("read", TCP, "raw", "holding:1:f33"), "did you mean 'f32'"),
    (("read", TCP, "raw", "holding:1:u32:ABCE"), "did you mean 'ABCD'"),
    (("read", TCP, "raw", "coil:1:u16"), "a coil is a bool"),
    (("read", TCP, "raw", "holding:1:text0"), "expected text1..text125"),
    (("read", CAN, "raw", "object:6041:u33"), "did you mean 'u32'"),
    (("read", CAN, "--timing", "az3", "STATUS WORD"), "Modbus goes over tcp://"),
    ((*WRITE, "Status"), "expected NAME=VALUE"),
    ((*WRITE, "Motor strat command=1"), "did you mean 'Motor start command'"),
    ((*WRITE, "Motor start command=exceute"), "did you mean 'execute'?"),
    ((*WRITE, "Motor start command=700000"), "expected 1"),
    ((*WRITE, "Status=1"), "read only"),
    (("write", CAN, "--timing", "az3", "TARGET VELOCITY=1"), "Modbus goes over tcp://"),
    ((*WRITE[:2], "raw", "holding:0-1=5"), "a range of addresses can only be read"),
    # watch
    (("watch",), "Missing argument 'ENDPOINT'; see barewire watch --help"),
    (("watch", TCP, "adxl", "Statsu"), "did you mean 'Status'?"),
    *(((*WATCH, "--period", text), "--period") for text in ("0", "-1", "nan", "inf", "soon")),
    *(((*WATCH, "--count", text), "--count") for text in ("0", "many")),
    *(((*WATCH, "--plot", text), "expected a name that ends in .svg, .png, .pdf") for text in ("x.bmp", "x", "x.svgz")),
    ((*WATCH, "--plot", "/"), "--plot /"),
    ((*WATCH, "--json", "--csv"), "expected only one of them"),
    ((*WATCH, "--and", TCP, "adxl"), f"--and {TCP} adxl: expected ENDPOINT DEVICE NAME..."),
    ((*WATCH, "--and", "tcp:/127.0.0.1", "adxl", "Status"), "expected tcp://HOST:PORT"),
    *(((*WATCH, "--for", text), "expected seconds, above 0") for text in ("0", "12 hours", "1w", "h")),
    *(((*WATCH, "--until", text), "expected a time such as 06:00") for text in ("24:00", "six", "6")),
    ((*WATCH, "--until", "2020-01-01T00:00"), "that is over"),
    *(((*WATCH, "--to", text), "expected a name that ends in .csv") for text in ("x", "x.parquet")),
    ((*WATCH, "--to", "/tmp/x.csv", "--rotate", "week"), "expected day, or a size"),
    ((*WATCH, "--to", "/tmp/x.csv", "--keep", "0"), "--keep"),
    ((*WATCH, "--keep", "2"), "are for the file of --to FILE"),
    ((*WATCH, "--when", "Status"), "expected NAME[.BIT] OPERATOR VALUE"),
    ((*WATCH, "--when", "Statsu == 1"), "did you mean 'Status'?"),
    *(((*WATCH, "--every", text), "--every") for text in ("0", "x")),
    *(((*WATCH, "--change", text), "--change") for text in ("-1", "nan", "x")),
    ((*WATCH, "--at-least", "1h"), "--at-least is for rows that --change leaves out"),
    ((*WATCH, "out.csv", "--csv"), "barewire watch ... --to out.csv"),
    # plot
    (("plot",), "Missing argument 'FILE...'"),
    (("plot", "--connect"), "Missing argument 'FILE...'"),
    (("plot", "x.csv", "--name", "Speed", "--to", "x.bmp"), "expected a name that ends in .svg, .png, .pdf"),
    # simulate
    (("simulate", "adlx", "tcp://127.0.0.1:0"), "did you mean 'adxl'?"),
    (("simulate", "nosuch.toml", "tcp://127.0.0.1:0"), "nosuch.toml: no such file: expected a recording"),
    (("simulate", __file__, "tcp://127.0.0.1:0"), "expected a file that `barewire record` wrote, or the directory of"),
    (("simulate", "adxl", "can://virtual/x"), "use can://socketcand"),
    (("simulate", "adxl", CAN), "adxl has no CANopen"),
    (("simulate", "table", CAN), "Modbus goes over tcp://"),
    (("simulate", "table", "rtu://pty?unit=255"), "from 1 to 247"),
    (("simulate", "csd-mt?order=ABCD", "tcp://127.0.0.1:0"), "a simulated device has its own byte order"),
    ((*SIMULATE, "--fault", "drp"), "did you mean 'drop'?"),
    *(((*SIMULATE, "--fault", f"drop:{text}"), "expected a probability") for text in ("2", "x", "nan")),
    ((*SIMULATE, "--seed", "x"), "--seed"),
    *(((*SIMULATE, "--late", text), "--late") for text in ("-1", "nan", "inf", "soon")),
    ((*SIMULATE, "--set", "Frequency"), "expected NAME=VALUE"),
    ((*SIMULATE, "--set", "Frequenzy=49"), "did you mean 'Frequency'?"),
    ((*SIMULATE, "--world", "lien=0"), "did you mean 'line'?"),
    *(
        ((*SIMULATE, "--world", text), "expected on or off behind =")
        for text in ("line", "line=x", "line=-1", "line=nan")
    ),
    (("simulate", "csd-mt", "tcp://127.0.0.1:0", "--world", "wals=-1:1"), "did you mean 'walls'?"),
    (("simulate", "table", "tcp://127.0.0.1:0", "--world", "line=0"), "a table has no environment"),
    (("simulate", "table", "tcp://127.0.0.1:0", "--set", "a=0"), "a table has no named values"),
    # explain
    (("explain", "rtx", "01"), "did you mean 'rtu'"),
    (("explain", "01", "03"), 'expected one of rtu, ascii, tcp, can before it: explain rtu "01 04 0F B1 00 02 22 F8"'),
    (("explain", "rtu", "0G"), "'G' at 1 is not a hexadecimal digit"),
    (("explain", "can", "6G5#40"), "'G' is not a hexadecimal digit"),
    ((*EXPLAIN, "--role", "requst"), "did you mean 'request'?"),
    ((*EXPLAIN, "--device", "az3"), "--device is for can, or for a response with its --request"),
    ((*EXPLAIN, "--request", "0G"), "'G' at 1 is not a hexadecimal digit"),
    ((*EXPLAIN, "--request", "01", "--floats", "f16"), "did you mean"),
    (("explain", "can", "605#40", "--device", "az4"), "did you mean 'az3'?"),
    *((("explain", "can", "605#40", "--device", "az3", "--node", text), "--node") for text in ("0", "128", "x")),
    (("explain", "can", "605#40", "--node", "5"), "give a --device for each --node"),
    # send
    (("ports", "--jsn"), "--json"),
    (("vendor", "nothing"), "expected one of modbus-rtu-client"),
    (("vendor", "modbus-rtu-client", "--with", "coil"), "'coil': expected one of coils"),
    (("vendor", "--check", __file__), "its head names no command"),
    (("vendor", "--update", __file__), "its head names no command"),
    (("vendor", "modbus-rtu-client", "--update", __file__), "give one of NAME, --update FILE and --check FILE"),
    (("vendor", "--check", __file__, "--python", "python3"), "its head names no command"),
    (("scan", TCP, "--nodes", "1"), "--nodes has no meaning for tcp://"),
    (("scan", TCP, "--listen", "1"), "--listen has no meaning for tcp://"),
    (("scan", TCP, "--listen", "-1"), "expected seconds, 0 or more"),
    (("scan", CAN, "--units", "1"), "--units has no meaning for can://"),
    (("scan", CAN, "--addresses", "holding"), "--addresses is for Modbus"),
    (("scan", CAN, "--bitrates", "125000"), "has the bit rate that the system gave it"),
    (("scan", CAN, "--bitrates", "0"), "expected rates in bit/s"),
    (("scan", CAN, "--nodes", "0-3"), "expected nodes in 1..127"),
    (("scan", TCP, "--baudrates", "9600"), "it has no baud rate"),
    (("scan", TCP, "--units", "7-5"), "from the smaller number"),
    (("scan", TCP, "--units", "256"), "expected units in 0..255"),
    (("scan", TCP, "--units", "1", "--addresses", "holding"), "--units has no meaning with --addresses"),
    (("scan", TCP, "--addresses", "register:1"), "tables: holding, input, coil, discrete"),
    (("scan", TCP, "--addresses", "holding:9-1"), "the smaller one first"),
    (("scan", TCP, "--device", "nothing"), "nothing"),
    (("save", TCP, "az4", "-"), "did you mean 'az3'?"),
    (("save", TCP, "az3", "a.dcf"), "a DCF is made of an EDS"),
    (("restore", "a.toml", TCP, "--device", "az4"), "did you mean 'az3'?"),
    (("restore", "a.toml", "tcp:/x"), "expected"),
    (("restore", "a.dcf", CAN, "--device", "az3"), "--device has no meaning for a DCF"),
    (("restore", "a.dcf", CAN, "--no-check"), "--no-check has no meaning for a DCF"),
    (("restore", "a.dcf", CAN, "--no-verify"), "--no-verify has no meaning for a DCF"),
    (("restore", "a.dcf", CAN, "--communication"), "--communication has no meaning for a DCF"),
    (("diff", TCP, TCP, "--device", "az4"), "did you mean 'az3'?"),
    (("scan", "rtu:///dev/null", "--baudrates", "fast"), "expected rates in bit/s"),
    (("scan", "rtu:///dev/null", "--formats", "9N1"), "such as 8E1"),
    (("send",), "Missing argument 'ENDPOINT'; see barewire send --help"),
    (("send", "tpc://127.0.0.1", "01"), "did you mean 'tcp'?"),
    (("send", TCP, "01 0G"), "'G' at 4 is not a hexadecimal digit"),
    (("send", TCP, " "), "has no bytes"),
    (("send", TCP, "01", "--crc"), "a frame of Modbus TCP has no CRC"),
    (("send", CAN, "605#4G"), "'G' is not a hexadecimal digit"),
    (("send", CAN, "605#40", "--crc"), "a CAN controller adds the CRC itself"),
    # panel
    (("panel", TCP, "adxl", "--port", "70000"), "70000 is not in the range 0<=x<=65535"),
    (("panel", TCP, "adxl", "--period", "0"), "0.0 is not in the range 0.05<=x<=3600"),
    (("panel", TCP, "adxl", "--terminal", "--port", "8510"), "expected no --terminal beside it"),
    # lab
    (("lab", "12"), "'12': expected the number of a lab, 1 to 11"),
    (("lab", "one"), "'one': expected the number of a lab"),
    (("lab", "3.9"), "lab 3 has the exercises 3.1, 3.2, 3.3, 3.4"),
    (("lab", "3", "chek"), "did you mean 'check'?"),
    (("lab", "3", "check"), "no answer: expected barewire lab 3 check 3.1 ANSWER"),
    (("lab", "3", "check", "3.2"), "no answer behind 3.2"),
    (("lab", "3", "check", "--jsno", "1"), "No such option"),
    (("lab", "3", "start"), "start is for lab 10: barewire simulate adxl rtu:///tmp/adxl"),
    (("lab", "1", "recordings"), "recordings is for labs 10 and 11; lab 1 needs no device"),
    (("lab", "10", "start"), "expected barewire lab 10 start ENDPOINT"),
    (("lab", "10", "start", TCP), "expected rtu:// without a unit"),
    *WRONG_PICTURES,
    *WRONG_STEPS,
    # diagnose
    (("diagnose",), "Missing argument 'ENDPOINT|FILE|-'; see barewire diagnose --help"),
    (("diagnose", "tpc://127.0.0.1"), "did you mean 'tcp'?"),
    (("diagnose", TCP), "listening in needs a line"),
    (("diagnose", "rtu:///dev/null", "--format", "jsno"), "did you mean 'json'?"),
    (("diagnose", "rtu:///dev/null", "--protocol", "asci"), "did you mean 'ascii'?"),
    (("diagnose", "rtu:///dev/null", "--format", "text", "--json"), "--json and --format text: give one of them"),
    (("diagnose", "rtu:///dev/null", "--port", "1502"), "--port is for a recording, which rtu:///dev/null is not"),
    (("diagnose", "rtu:///dev/null", "--complete"), "--complete is for a CAN bus, which rtu:///dev/null is not"),
    *((("diagnose", "rtu:///dev/null", "--seconds", text), "--seconds") for text in ("0", "-1", "nan", "x")),
    *((("diagnose", "rtu:///dev/null", "--window", text), "--window") for text in ("0", "-1", "nan", "x")),
    (("diagnose", CAN, "--window", "1"), "--window is for Modbus, which"),
    (("diagnose", CAN, "--device", "az4"), "did you mean 'az3'?"),
    *((("diagnose", CAN, "--device", "az3", "--node", text), "--node") for text in ("0", "128", "x")),
    # sniff
    (("sniff", "tpc://127.0.0.1"), "did you mean 'tcp'?"),
    (("sniff", TCP), "listening in needs a line"),
    *(
        ((*SNIFF, option, text), option)
        for option in ("--seconds", "--window")
        for text in ("0", "-1", "nan", "inf", "x")
    ),
    *(((*SNIFF, "--port", text), "--port") for text in ("0", "65536", "x")),
    *(((*SNIFF, *option), "is for a CAN bus") for option in (("--node", "5"), ("--bus", "can0"), ("--all",))),
    ((*SNIFF, "--protocol", "asci"), "did you mean 'ascii'?"),
    *(((*SNIFF, "--device", "adxl", "--unit", text), "--unit") for text in ("-1", "256", "x")),
    ((*SNIFF, "--device", "adlx"), "did you mean 'adxl'?"),
    ((*SNIFF, "--unit", "1"), "--unit without --device"),
    ((*SNIFF, "--device", "adxl", "--device", "az3"), "give a --unit for each"),
    ((*SNIFF, "--only", "sdo"), "--only is for a CAN bus"),
    ((*SNIFF, "--protocol", "rtu"), "--protocol is for a recording, which rtu:///dev/null is not"),
    ((*SNIFF, "--port", "1502"), "--port is for a recording, which rtu:///dev/null is not"),
    *(
        (("sniff", CAN, *option), f"{option[0]} is for Modbus, which {CAN} is not")
        for option in (("--window", "1"), ("--port", "1502"), ("--protocol", "rtu"))
    ),
    (("sniff", CAN, "--only", "emyc"), "did you mean 'emcy'?"),
    (("sniff", CAN, "--device", "az4"), "did you mean 'az3'?"),
    *((("sniff", CAN, "--device", "az3", "--node", text), "--node") for text in ("0", "128", "x")),
    ((*SNIFF, "--write", "x.txt"), "--write x.txt: expected a name that ends in .pcapng"),
    ((*SNIFF, "--live", "--json"), "expected no --json, --format or --picture beside it"),
    (("sniff", CAN, "--write", "x.asc"), "--write x.asc: expected a name that ends in .pcapng, .log, .txt or .candump"),
    # record
    (("record",), "Missing argument 'ENDPOINT|FILE'; see barewire record --help"),
    (("record", "tpc://127.0.0.1"), "did you mean 'tcp'?"),
    (("record", TCP), "listening in needs a line"),
    *((("record", "rtu:///dev/null", "--unit", text), "--unit") for text in ("-1", "256", "x")),
    *((("record", "rtu:///dev/null", "--limit", text), "--limit") for text in ("0", "x")),
    *((("record", "rtu:///dev/null", "--seconds", text), "--seconds") for text in ("0", "nan", "x")),
    *((("record", "rtu:///dev/null", "--window", text), "--window") for text in ("0", "nan", "x")),
    *((("record", "rtu:///dev/null", "--port", text), "--port") for text in ("0", "65536", "x")),
    (("record", "rtu:///dev/null", "--protocol", "asci"), "did you mean 'ascii'?"),
    (("record", "rtu:///dev/null", "--port", "1502"), "--port is for a recording, which rtu:///dev/null is not"),
    (("record", "rtu:///dev/null", "--protocol", "rtu"), "--protocol is for a recording, which rtu:///dev/null is not"),
    # replay
    (("replay", "x.log"), "Missing option '--against'"),
    (("replay", "x.log", "--against", "az4"), "did you mean 'az3'?"),
    (("replay", "x.log", "--against", "adxl"), "adxl has no CANopen"),
    (("replay", "x.log", "--against", "az3", "--values"), "--values is for an EDS"),
    (("replay", "x.log", "--against", "az3", "--only", "sod"), "did you mean 'sdo'?"),
    *((("replay", "x.log", "--against", "az3", "--node", text), "--node") for text in ("0", "128", "x")),
    *((("replay", "x.log", "--against", "az3", "--window", text), "--window") for text in ("0", "nan", "x")),
    # conform
    (("conform", CAN, "--only", "NOPE"), "--only NOPE: no case has a name that begins so; expected BLK-"),
    (("conform", CAN, "--only", "sdo-0,sdo-9"), "--only SDO-9: no case has a name that begins so"),
    *(
        (("conform", TCP, *option), "are for can://")
        for option in (("--gentle",), ("--only", "SDO"), ("--large", "2000:0"))
    ),
    *((("conform", CAN, "--large", text), "expected INDEX:SUB") for text in ("1:0", "xx", "2000:100")),
    (("conform", CAN, "--eds", __file__), "describes no objects: expected sections like [1000]"),
    (("conform", CAN, "--timing"), "Modbus goes over tcp://"),
    # canopen
    (("canopen", "difff"), "did you mean 'diff'?"),
    (("canopen", "diff", TCP, "pump.dcf"), "a DCF is for CANopen: expected can://"),
    (("canopen", "configure", TCP, "pump.dcf"), "a DCF is for CANopen: expected can://"),
    (("canopen", "boot", TCP, "pump.dcf"), "a DCF is for CANopen: expected can://"),
    (("canopen", "boot", "can://virtual/x", "pump.dcf", "--boot-time", "-1"), "is not in the range x>=0"),
    (("canopen", "emcy", "can://memory/x", "--for", "-1"), "expected seconds, above 0"),
    (("canopen", "pdo", "can://memory/x", "--count", "0"), "0 is not in the range x>=1"),
    (("canopen", "nmt", "can://memory/x", "start", "5", "--wait", "x"), "--wait"),
    (("canopen", "nmt", TCP, "start", "5", "--verify"), "expected can://"),
    (("canopen", "heartbeat", "can://memory/x", "--for", "0"), "expected seconds, above 0"),
    (("canopen", "heartbeat", "can://memory/x", "--count", "0"), "0 is not in the range x>=1"),
    (("canopen", "sync", "can://memory/x", "--every", "0"), "expected seconds, above 0"),
    (("canopen", "sync", "can://memory/x", "--count", "3"), "--count: expected --every"),
    (
        ("canopen", "lss", "assign", "can://memory/x", "5", "--address", "1-2"),
        "expected VENDOR-PRODUCT-REVISION-SERIAL",
    ),
    # canopen-gateway
    (("gateway",), "expected CONFIG; --example prints one"),
    (("gateway", "--exampel"), "Did you mean '--example'?"),
    (("canopen-gateway", TCP), "expected can://"),
    (("canopen-gateway", CAN, "--node-id", "128"), "not in the range 1<=x<=127"),
    (("canopen-gateway", CAN, "--eds", "x.eds"), "expected --node-id too"),
    *(
        (("canopen-gateway", CAN, "--listen", text), text)
        for text in ("here", "127.0.0.1:99999", "a..b:80", "127.0.0.1:")
    ),
    *((("canopen-gateway", CAN, "--net", text), "--net") for text in ("0", "128", "x")),
    # eds, devices, demo
    (("eds", "exprot"), "did you mean 'export'?"),
    (("eds", "export", "az4"), "did you mean 'az3'?"),
    (("eds", "export", "adxl"), "adxl has no CANopen"),
    (("eds", "lint"), "Missing argument 'FILE'; see barewire eds lint --help"),
    (("-v",), "no command given: expected one of demo, devices, simulate,"),
    (("devices", "az4"), "did you mean 'az3'?"),
    (("demo", "az3"), "az3"),
    # drive
    (("drive", "tpc://127.0.0.1", "az3", "status"), "did you mean 'tcp'?"),
    (("drive", TCP, "az4", "status"), "did you mean 'az3'?"),
    (("drive", TCP, "adxl", "status"), "adxl is not a drive"),
    (("drive", TCP, "az3", "mvoe", "1"), "did you mean 'move'?"),
    (("drive", TCP, "az3", "move", "far"), "expected a number"),
    (("drive", TCP), "Missing argument 'DEVICE'; see barewire drive --help"),
    (("drive", TCP, "az3", "move"), "'TARGET'; see barewire drive ENDPOINT DEVICE move --help"),
    (("drive", TCP, "az3"), "no command given: expected one of disable, enable, home,"),
    ((*MOVE, "--velocty", "4"), "Did you mean '--velocity'?"),
    ((*MOVE[:-1], "--velocty=4", "100"), "Did you mean '--velocity'?"),
    ((*MOVE, "-v"), "'-v' stands before the command: barewire -v drive ..."),
    (("drive", TCP, "az3", "home"), "home: az3 cannot be homed by this command"),
    *(
        ((*MOVE, option, text), option)
        for option in ("--velocity", "--acceleration", "--deceleration")
        for text in ("nan", "inf", "fast")
    ),
    *(
        ((*MOVE, option, text), option)
        for option in ("--timeout", "--within")
        for text in ("0", "-1", "nan", "inf", "x")
    ),
    *((("drive", TCP, "az3", "home", text), "METHOD") for text in ("x", "128", "-129")),
    # vectors
    (("vectors", "chekc"), "did you mean 'check'"),
    (("vectors", "check", "--kind", "crc"), "did you mean 'crc16'"),
    (("vectors", "check", "--only", "no-such"), "no case fits 'no-such'"),
    (("vectors", "list", "--flag", "no-such"), "flag 'no-such': expected one of broadcast, delimiter, "),
    (("vectors", "check", "--endpoint", TCP, "--kind", "lrc"), "--endpoint: a running server is asked server-conf"),
    (("vectors", "check", "--endpoint", "can://memory/x"), "can://memory is inside one process"),
    (("vectors", "list", "--profile", "no-such"), "profile 'no-such': expected one of modbus-core, modbus-full, "),
    (("vectors", "check", "--badge", "x.txt", "--profile", "minimal"), "a name that ends with .svg or .json"),
    (("vectors", "list", "--cases", "/no/such"), "folder /no/such: no vectors"),
    (("vectors", "check", "--adapter", ""), "--adapter: the command is empty"),
    (("vectors", "check", "--endpoint", "http://x"), "expected tcp://HOST:PORT"),
    (("vectors", "check", "--endpoint", TCP, "--adapter", "x"), "give one of them"),
    (("vectors", "check", "--timeout", "0"), "expected seconds, above 0"),
    (("vectors", "show", "crc16"), "no case has the id 'crc16'; `barewire vectors list --only \"crc16*\"`"),
    (("vectors", "show", "ascii/lrc"), "`barewire vectors list --only ascii/lrc` shows the cases of this file"),
]


LONG = "9" * 5000
TOO_LONG: list[tuple[str, ...]] = [
    *(
        ("read", f"{TCP}?{query}", "adxl", "Status")
        for query in (
            f"timeout={LONG}",
            f"unit={LONG}",
            f"parity={LONG}",
            f"{LONG}=1",
            "?" * 5000,
            "&".join(f"a{number}=1" for number in range(10_000)),
            "&".join(f"unit={number}" for number in range(10_000)),
        )
    ),
    *(
        ("read", url, "az3", "STATUS WORD")
        for url in (
            LONG,
            f"tcp://127.0.0.1:{LONG}",
            f"rtu:///dev/x?baudrate={LONG}",
            f"rtu:///dev/x?latency={LONG}",
            f"can://{LONG}",
            f"can://{LONG}/x",
            f"can://socketcand/1:{LONG}/x",
            f"can://socketcan/can0?node={LONG}",
        )
    ),
    ("read", TCP, LONG, "Status"),
    (*READ, LONG),
    *(("read", TCP, "raw", text) for text in (LONG, f"holding:{LONG}", f"holding:1:{LONG}", f"holding:1:u32:{LONG}")),
    *((*WRITE, text) for text in (LONG, f"{LONG}=1", f"Motor start command={LONG}")),
    *((*WATCH, option, LONG) for option in ("--period", "--plot")),
    (*WATCH, "--count", f"-{LONG}"),
    *(
        (*SIMULATE, "--fault", text)
        for text in (
            LONG,
            f"drop:{LONG}",
            f"drop@{LONG}",
            f"drop@0-{LONG[:4300]}",
            f"drop@0x{LONG}",
            f"drop@{LONG}:1",
            f"drop@{LONG}=1",
            f"drop@every=x{LONG}",
            f"exception={LONG[:4300]}",
            f"late={LONG[:4300]}",
            ",".join(["drop"] * 5000 + ["drp"]),
        )
    ),
    *((*SIMULATE, option, LONG) for option in ("--late", "--set", "--world")),
    ("explain", LONG, "01"),
    ("explain", "can", "605#40", "--device", LONG),
    *LONG_STEPS,
    (*SNIFF, "--protocol", LONG),
    (*SNIFF, "--only", LONG),
    ("record", "rtu:///dev/null", "--unit", LONG),
    ("conform", CAN, "--only", LONG),
    ("conform", CAN, "--large", LONG),
    ("canopen-gateway", CAN, "--listen", LONG),
    ("eds", "export", LONG),
    ("devices", "az3", LONG),
    (LONG,),
    (*MOVE[:-1], f"x{LONG}"),
]


@every_case("arguments", TOO_LONG)
def test_a_very_long_argument_is_not_repeated_in_full(
    arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(list(arguments)) == 2
    output = capsys.readouterr().err
    assert output.count("\n") == 1
    assert len(output) < 1000


@every_case(("arguments", "text"), WRONG)
def test_what_cannot_be_understood_is_one_line_and_exit_status_2(
    arguments: tuple[str, ...],
    text: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    status = run_command_line(list(arguments))
    output = capsys.readouterr()
    assert (status, output.out) == (2, ""), output
    assert text in output.err
    assert output.err.startswith("barewire: ")
    assert output.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def commands(group: click.Group, name: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    context = click.Context(group)
    for word in group.list_commands(context):
        command = group.get_command(context, word)
        assert command is not None
        yield (*name, word), command
        if isinstance(command, click.Group):
            yield from commands(command, (*name, word))


ANY_TEXT = {"--write", "--to", "--bus", "--junit"}
"""Options whose values have no form: names of files and buses."""


def test_every_option_with_a_restricted_form_is_in_the_table() -> None:
    missing = []
    for name, command in commands(barewire_command):
        tried = {word for arguments, _ in WRONG if arguments[0] == name[0] for word in arguments}
        for parameter in command.params:
            if isinstance(parameter, click.Option) and not parameter.is_flag:
                missing += [f"{' '.join(name)} {option}" for option in {*parameter.opts} - ANY_TEXT - tried]
    assert not missing
    assert {arguments[0] for arguments, _ in WRONG} >= set(COMMANDS)
