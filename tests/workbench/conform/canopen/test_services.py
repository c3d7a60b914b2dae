"""Exchanges of a conformance test for NMT, error control, EMCY, SYNC and PDO: one row is one case.

A case is a script against a fresh device, node 5, pre-operational at 0 s. A line of it:

        at 1.5   605#4017100000000000  ->  585#4B171000........      sent, and the required answer; a dot is any digit
        at 2.0   -                     ->  705#7F                    nothing is sent; time passes
        at 2.0   000#0105              ->  -                         no answer is allowed

Several answers are separated by a comma, accepted alternatives by a bar.
"""

from __future__ import annotations

import re

from barewire.canopen import (
    CanFrame,
    Entry,
    LocalNode,
    LssAddress,
    LssSlave,
    ObjectDictionary,
    PdoConfig,
    standard_objects,
)
from tests.helpers import every_case

OK = "585#60.............."
READ, VALUE = "605#4000100000000000", "585#4300100000000000"
BAD_VALUE = "585#80......30000906"


def write(index: int, sub: int, value: int, size: int) -> str:
    """Return the SDO that writes a number."""
    command = {1: 0x2F, 2: 0x2B, 4: 0x23}[size]
    place = index.to_bytes(2, "little") + bytes([sub])
    return f"605#{(bytes([command]) + place + value.to_bytes(4, 'little')).hex().upper()}"


CASES: dict[str, str] = {
    # NMT: states and transitions
    "start": f"000#0105 -> -; 080# -> 185#3706; {READ} -> {VALUE}",
    "start for all": "000#0100 -> -; 080# -> 185#3706",
    "stop: no SDO, no PDO": f"000#0205 -> -; {READ} -> -; 080# -> -; 205#0100 -> -",
    "stop, then pre-operational": f"000#0205 -> -; 000#8005 -> -; {READ} -> {VALUE}; 080# -> -",
    "stop, then start": f"000#0205 -> -; 000#0105 -> -; {READ} -> {VALUE}; 080# -> 185#3706",
    "operational, then pre-operational": "000#0105 -> -; 000#8005 -> -; 080# -> -",
    "start twice": "000#0105 -> -; 000#0105 -> -; 080# -> 185#3706",
    "reset node from operational": f"000#0105 -> -; 000#8105 -> 705#00; 080# -> -; {READ} -> {VALUE}",
    "reset node from stopped": "000#0205 -> -; 000#8105 -> 705#00",
    "reset communication from pre-operational": "000#8205 -> 705#00",
    "reset communication for all": "000#8200 -> 705#00",
    "a command to another node": "000#0106 -> -; 080# -> -",
    "an unknown command": f"000#0305 -> -; 080# -> -; {READ} -> {VALUE}",
    "a command of one byte": "000#01 -> -; 080# -> -",
    "a command of three bytes": "000#010500 -> -; 080# -> -",
    "an extended command": "00000000#0105 -> -; 080# -> -",
    "a remote command": "000#R2 -> -; 080# -> -",
    "reset communication restores 1000h to 1FFFh": f"{write(0x1017, 0, 500, 2)} -> {OK}, 705#7F; "
    "000#8205 -> 705#00; 605#4017100000000000 -> 585#4B17100000000000",
    "reset communication leaves the application": f"{write(0x6040, 0, 9, 2)} -> {OK}; 000#8205 -> 705#00; "
    "605#4040600000000000 -> 585#4B40600009000000",
    "reset node restores the application": f"{write(0x6040, 0, 9, 2)} -> {OK}; 000#8105 -> 705#00; "
    "605#4040600000000000 -> 585#4B40600000000000",
    # error control
    "heartbeat": f"{write(0x1017, 0, 1000, 2)} -> {OK}, 705#7F; at 0.9 - -> -; at 1.0 - -> 705#7F; at 2.0 - -> 705#7F",
    "heartbeat with the state": f"{write(0x1017, 0, 1000, 2)} -> {OK}, 705#7F; at 0.5 000#0105 -> -; "
    "at 1.0 - -> 705#05; at 1.5 000#0205 -> -; at 2.0 - -> 705#04",
    "heartbeat off": f"{write(0x1017, 0, 1000, 2)} -> {OK}, 705#7F; {write(0x1017, 0, 0, 2)} -> {OK}; at 9.0 - -> -",
    "guarding toggles": "705#R1 -> 705#7F; 705#R1 -> 705#FF; 705#R1 -> 705#7F",
    "guarding begins with 0 after a reset": "705#R1 -> 705#7F; 000#8205 -> 705#00; 705#R1 -> 705#7F",
    "guarding in stopped": "000#0205 -> -; 705#R1 -> 705#04",
    "guarding asks for no byte": "705#R -> 705#7F",
    "heartbeat or guarding: not both": f"{write(0x1017, 0, 1000, 2)} -> {OK}, 705#7F; at 0.5 705#R1 -> -",
    "guarding when heartbeat is off again": f"{write(0x1017, 0, 1000, 2)} -> {OK}, 705#7F; "
    f"{write(0x1017, 0, 0, 2)} -> {OK}; 705#R1 -> 705#7F",
    "consumer: node lost": f"{write(0x1016, 1, 0x00020064, 4)} -> {OK}; 702#05 -> -; at 0.09 - -> -; "
    "at 0.1 - -> 085#3081110200000000; at 5.0 - -> -",
    "consumer: node returns": f"{write(0x1016, 1, 0x00020064, 4)} -> {OK}; 702#05 -> -; "
    "at 0.1 - -> 085#3081110200000000; at 1.0 702#05 -> 085#00000002........|085#0000000200000000",
    "consumer: boot-up message only": f"{write(0x1016, 1, 0x00020064, 4)} -> {OK}; 702#00 -> -; at 9.0 - -> -",
    "consumer: no heartbeat yet": f"{write(0x1016, 1, 0x00020064, 4)} -> {OK}; at 9.0 - -> -",
    "consumer: the same node twice": f"{write(0x1016, 1, 0x00020064, 4)} -> {OK}; "
    f"{write(0x1016, 2, 0x00020064, 4)} -> 585#8016100243000406",
    "consumer: two unused entries": f"{write(0x1016, 1, 0, 4)} -> {OK}; {write(0x1016, 2, 0, 4)} -> {OK}",
    "consumer: lost while operational": f"{write(0x1016, 1, 0x00020064, 4)} -> {OK}; 000#0105 -> -; 702#05 -> -; "
    "at 0.1 - -> 085#3081110200000000; 080# -> -",
    "error behaviour: no change": f"{write(0x1029, 1, 1, 1)} -> {OK}; {write(0x1016, 1, 0x00020064, 4)} -> {OK}; "
    "000#0105 -> -; 702#05 -> -; at 0.1 - -> 085#3081110200000000; 080# -> 185#3706",
    "error behaviour: stopped": f"{write(0x1029, 1, 2, 1)} -> {OK}; {write(0x1016, 1, 0x00020064, 4)} -> {OK}; "
    f"000#0105 -> -; 702#05 -> -; at 0.1 - -> 085#3081110200000000; {READ} -> -",
    # EMCY objects
    "1003h: 0 clears": f"{write(0x1003, 0, 0, 1)} -> {OK}",
    "1003h: another number": f"{write(0x1003, 0, 1, 1)} -> {BAD_VALUE}",
    "1003h: no entry yet": "605#4003100100000000 -> 585#8003100124000008|585#8003100111000906",
    "1003h: an entry": "000#0105 -> -; 205#01 -> 085#1082110102000000; 605#4003100000000000 -> 585#4F03100001000000; "
    "605#4003100100000000 -> 585#4303100110820102",
    "1001h": "000#0105 -> -; 205#01 -> 085#1082110102000000; 605#4001100000000000 -> 585#4F01100011000000",
    "1014h while valid": f"{write(0x1014, 0, 0x181, 4)} -> {BAD_VALUE}",
    # SYNC
    "1005h: start producing": f"{write(0x1006, 0, 100_000, 4)} -> {OK}; {write(0x1005, 0, 0x40000080, 4)} -> {OK}; "
    "at 0.1 - -> 080#; at 0.2 - -> 080#",
    "1005h: another identifier while producing": f"{write(0x1005, 0, 0x40000080, 4)} -> {OK}; "
    f"{write(0x1005, 0, 0x40000081, 4)} -> {BAD_VALUE}",
    "1019h: 1": f"{write(0x1019, 0, 1, 1)} -> {BAD_VALUE}",
    "1019h: 241": f"{write(0x1019, 0, 241, 1)} -> {BAD_VALUE}",
    "1019h: with a period": f"{write(0x1006, 0, 1000, 4)} -> {OK}; {write(0x1019, 0, 10, 1)} -> 585#8019100022000008",
    "an unexpected counter": "000#0105 -> -; 080#01 -> 085#4082110100000000; 080# -> 085#0000000000000000, 185#3706",
    "a counter is missing": f"{write(0x1019, 0, 10, 1)} -> {OK}; 000#0105 -> -; 080# -> 085#4082110000000000; "
    "080#01 -> 085#0000000000000000, 185#3706",
    "SYNC in pre-operational": "080# -> -",
    # PDO
    "RPDO too short": "000#0105 -> -; 205#01 -> 085#1082110102000000; 605#4040600000000000 -> 585#4B40600000000000",
    "RPDO too long": "000#0105 -> -; 205#010203 -> 085#2082110302000000; 605#4040600000000000 -> 585#4B40600001020000",
    "RPDO exactly": "000#0105 -> -; 205#0102 -> -; 605#4040600000000000 -> 585#4B40600001020000",
    "RPDO, remote": "000#0105 -> -; 205#R2 -> -",
    "TPDO of every second SYNC": f"{write(0x1800, 2, 2, 1)} -> {OK}; 000#0105 -> -; 080# -> -; 080# -> 185#3706",
    "TPDO type 0": f"{write(0x1800, 2, 0, 1)} -> {OK}; 000#0105 -> -; 080# -> 185#3706; 080# -> -",
    "TPDO type 253": f"{write(0x1800, 2, 253, 1)} -> {OK}; 000#0105 -> -; 080# -> -; 185#R2 -> 185#3706",
    "TPDO type 255": f"{write(0x1800, 2, 255, 1)} -> {OK}; 000#0105 -> 185#3706; at 1.0 - -> -",
    "TPDO event timer": f"{write(0x1800, 2, 255, 1)} -> {OK}; {write(0x1800, 5, 100, 2)} -> {OK}; "
    "000#0105 -> 185#3706; at 0.1 - -> 185#3706; at 0.2 - -> 185#3706",
    "TPDO off": f"{write(0x1800, 1, 0x80000185, 4)} -> {OK}; 000#0105 -> -; 080# -> -",
    "TPDO type 245": f"{write(0x1800, 2, 245, 1)} -> {BAD_VALUE}",
    "RPDO type 253": f"{write(0x1400, 2, 253, 1)} -> {BAD_VALUE}",
    "COB-ID of an SDO": f"{write(0x1800, 1, 0x80000185, 4)} -> {OK}; {write(0x1800, 1, 0x585, 4)} -> {BAD_VALUE}",
    "another COB-ID while on": f"{write(0x1800, 1, 0x186, 4)} -> {BAD_VALUE}",
    "inhibit time while on": f"{write(0x1800, 3, 100, 2)} -> {BAD_VALUE}",
    "event timer while on": f"{write(0x1800, 5, 100, 2)} -> {OK}",
    "mapping while on": f"{write(0x1A00, 0, 0, 1)} -> 585#80001A0000000106",
    "mapping of nothing": f"{write(0x1800, 1, 0x80000185, 4)} -> {OK}; {write(0x1A00, 0, 0, 1)} -> {OK}; "
    f"{write(0x1A00, 1, 0x2FFF0010, 4)} -> 585#80001A0141000406",
    "mapping too long": f"{write(0x1800, 1, 0x80000185, 4)} -> {OK}; {write(0x1A00, 0, 0, 1)} -> {OK}; "
    + "; ".join(f"{write(0x1A00, sub, 0x60640020, 4)} -> {OK}" for sub in (1, 2, 3))
    + f"; {write(0x1A00, 0, 3, 1)} -> 585#80001A0042000406",
    # LSS, in every state
    "LSS in stopped": "000#0205 -> -; 7E5#0401000000000000 -> -; 7E5#5E00000000000000 -> 7E4#5E05000000000000",
    "LSS in waiting": "7E5#5E00000000000000 -> -; 7E5#1106000000000000 -> -",
    "LSS: a node-ID out of range": "7E5#0401000000000000 -> -; 7E5#1180000000000000 -> 7E4#1101000000000000",
    "LSS: fastscan of a configured device": "7E5#5100000000800000 -> -; 7E5#4C00000000000000 -> -",
}


def device() -> LocalNode:
    objects = [
        *standard_objects(),
        Entry(0x6040, 0, "controlword", "u16", "rw", 0),
        Entry(0x6041, 0, "statusword", "u16", "ro", 0x0637),
        Entry(0x6064, 0, "position", "i32", "ro", -2),
    ]
    pdos = [PdoConfig("RPDO", 1, (0x60400010,)), PdoConfig("TPDO", 1, (0x60410010,), type=1)]
    device = LocalNode(5, ObjectDictionary(objects), pdos, lss=LssSlave(LssAddress(1, 2, 3, 4)))
    assert [str(frame) for frame in device.start(0.0)] == ["705#00"]
    return device


def fits(answers: str, received: list[str]) -> bool:
    """Return whether the received frames are one of the accepted answers."""
    wanted = [] if answers == "-" else [answer.strip() for answer in answers.split(",")]
    if len(wanted) != len(received):
        return False
    return all(any(re.fullmatch(form, text) for form in answer.split("|")) for answer, text in zip(wanted, received))


@every_case("script", CASES.values())
def test_exchange(script: str) -> None:
    node, now = device(), 0.0
    for line in script.split(";"):
        sent, _, answers = line.partition("->")
        time, _, frame = sent.strip().rpartition(" ")
        now = float(time.removeprefix("at ")) if time else now
        received = node.feed(None if frame == "-" else CanFrame.parse(frame), now)
        assert fits(answers.strip(), [str(answer) for answer in received]), (line, [str(answer) for answer in received])
