"""A log ends with "nothing wrong" only if all is good: a hundred logs are, and in 114 one thing is not.

client   01 03 00 10 00 02                             05 06 00 01 00 03
unit                         01 03 04 00 17 00 07                          05 06 00 01 00 03        good
client   01 03 00 10 00 02                             05 06 00 01 00 03
unit                         01 83 02                                      05 06 00 01 00 03        refused
"""

from __future__ import annotations

from random import Random

import pytest

from barewire.ascii import encode as ascii_frame
from barewire.canopen import CanFrame
from barewire.rtu import encode as rtu_frame
from barewire.tcp import encode as tcp_frame
from barewire_workbench.api import explain_exchange
from tests.helpers import every_case
from tests.workbench.diagnosis.can_cases import Frames, diagnosed as can_diagnosed
from tests.workbench.diagnosis.modbus_cases import Sent, Traffic, diagnosed, log_of

FORM = {"rtu": "times", "ascii": "times", "tcp": "capture"}
Exchange = tuple[int, bytes, bytes]
"""The unit, and the PDUs of the request and its response."""
Answers = dict[int, list[tuple[float, int, bytes]]]
"""By the place of an exchange: the time after its request, the unit and the PDU of what is sent instead."""


def exchanges(random: Random) -> list[Exchange]:
    """Return six requests to three units, each with its response, as PDUs; the last two are of one unit."""
    made: list[Exchange] = []
    for unit in (1, 2, 3, 1, 2, 2):
        address = random.randrange(1, 500)
        if random.random() < 0.3:
            write = bytes((6, *address.to_bytes(2, "big"), *random.randbytes(2)))
            made.append((unit, write, write))
        else:
            count = random.randint(1, 8)
            values = bytes(random.randrange(1, 100) for _ in range(2 * count))
            made.append((unit, bytes((3, *address.to_bytes(2, "big"), 0, count)), bytes((3, 2 * count)) + values))
    return made


def frame_of(framing: str, unit: int, pdu: bytes, transaction: int) -> bytes:
    if framing == "tcp":
        return tcp_frame(unit, pdu, transaction)
    return (rtu_frame if framing == "rtu" else ascii_frame)(unit, pdu)


def traffic_of(framing: str, pairs: list[Exchange], answers: Answers) -> Traffic:
    """Return the frames: a request each 2 s, its response after 20 ms, unless `answers` replaces it."""
    traffic: Traffic = []
    for place, (unit, request, response) in enumerate(pairs):
        at = 10.0 + 2.0 * place
        traffic.append(Sent(at, frame_of(framing, unit, request, place), True))
        for seconds, sender, pdu in answers.get(place, [(0.02, unit, response)]):
            traffic.append(Sent(at + seconds, frame_of(framing, sender, pdu, place), False))
    return sorted(traffic, key=lambda sent: sent.at)


def verdicts_of(framing: str, pairs: list[Exchange], answers: Answers) -> list[str]:
    return [verdict.code for verdict in diagnosed(log_of(traffic_of(framing, pairs, answers), FORM[framing]))[1]]


READ, VALUES = bytes.fromhex("03 0010 0002"), bytes.fromhex("03 04 0017 0007")
WRITE = bytes.fromhex("06 0001 0003")
FLAWS: dict[str, tuple[bytes, list[tuple[float, int, bytes]]]] = {
    "an exception": (READ, [(0.02, 2, bytes.fromhex("83 02"))]),
    "no response": (READ, []),
    "a late response": (READ, [(2.5, 2, VALUES)]),
    "the response of another unit": (READ, [(0.02, 3, VALUES)]),
    "the response to another function": (READ, [(0.02, 2, bytes.fromhex("04 04 0017 0007"))]),
    "a response of another length": (READ, [(0.02, 2, bytes.fromhex("03 06 0017 0007 0009"))]),
    "a response without values": (READ, [(0.02, 2, bytes.fromhex("03 00"))]),
    "the response to another function without values": (READ, [(0.02, 2, bytes.fromhex("04 00"))]),
    "an exception of three bytes": (READ, [(0.02, 2, bytes.fromhex("83 02 00"))]),
    "the echo of another address": (WRITE, [(0.02, 2, bytes.fromhex("06 0002 0003"))]),
}


@every_case(
    ("flaw", "place"),
    [(flaw, place) for flaw in FLAWS for place in (2, 4, 5) if (flaw, place) != ("a late response", 5)],
)
@every_case("framing", ["rtu", "ascii", "tcp"])
def test_one_flaw_is_not_nothing_wrong(framing: str, flaw: str, place: int) -> None:
    pairs = exchanges(Random(place))
    request, answers = FLAWS[flaw]
    pairs[place] = (2, request, b"")
    codes = verdicts_of(framing, pairs, {place: answers})
    assert "nothing-wrong" not in codes
    if flaw == "an exception":
        assert codes == ["refused"]
    if flaw == "no response" and place == 5:
        assert codes == ["open"]


@every_case("framing", ["rtu", "ascii", "tcp"])
@every_case("flaw", [flaw for flaw, (_, answers) in FLAWS.items() if answers and flaw != "a late response"])
def test_what_is_wrong_in_a_log_is_wrong_in_explain(framing: str, flaw: str) -> None:
    request, ((_, unit, response),) = FLAWS[flaw]
    frames = [frame_of(framing, *sent, 7) for sent in ((2, request), (unit, response))]
    texts = [frame.decode() if framing == "ascii" else frame.hex(" ") for frame in frames]
    explained = explain_exchange(framing, *texts)
    assert bool(explained.diagnosis) is (flaw != "an exception")


@pytest.mark.parametrize(("framing", "check"), [("rtu", "CRC ok"), ("ascii", "LRC ok"), ("tcp", "transaction 2")])
def test_the_proof_of_a_wrong_answer_names_what_its_framing_has(framing: str, check: str) -> None:
    pairs = exchanges(Random(2))
    request, answers = FLAWS["the response of another unit"]
    pairs[2] = (2, request, b"")
    findings, _ = diagnosed(log_of(traffic_of(framing, pairs, {2: answers}), FORM[framing]))
    (proof,) = [found.finding.proof for found in findings if found.finding.code == "wrong-answer"]
    assert proof.endswith(f"; {check}")


@every_case("seed", range(25))
@every_case("framing", ["rtu", "ascii", "tcp"])
def test_a_good_log_has_nothing_wrong(framing: str, seed: int) -> None:
    assert verdicts_of(framing, exchanges(Random(seed)), {}) == ["nothing-wrong"]


def can_log(random: Random) -> Frames:
    """Return six uploads of two nodes, each with its response."""
    frames: Frames = []
    for place in range(6):
        node, sub = random.choice((5, 6)), random.randrange(1, 9)
        at = 1.0 + 0.2 * place
        frames += [
            (at, CanFrame(0x600 + node, bytes((0x40, 0x00, 0x20, sub, 0, 0, 0, 0)))),
            (at + 0.005, CanFrame(0x580 + node, bytes((0x43, 0x00, 0x20, sub, *random.randbytes(4))))),
        ]
    return frames


@every_case("seed", range(25))
def test_a_good_can_log_has_nothing_wrong(seed: int) -> None:
    assert [verdict.code for verdict in can_diagnosed(can_log(Random(seed)))[1]] == ["nothing-wrong"]


@every_case("place", range(6))
@every_case("flaw", ["an abort", "an emergency", "no response", "the response about another object"])
def test_one_flaw_of_a_can_log_is_not_nothing_wrong(flaw: str, place: int) -> None:
    frames = can_log(Random(place))
    at, response = frames[2 * place + 1]
    if flaw == "an abort":
        frames[2 * place + 1] = (at, CanFrame(response.id, b"\x80" + response.data[1:4] + bytes.fromhex("00000206")))
    elif flaw == "an emergency":
        frames.insert(
            2 * place + 1, (at - 0.001, CanFrame(0x80 + (response.id & 0x7F), bytes.fromhex("3081010000000000")))
        )
    elif flaw == "no response":
        del frames[2 * place + 1]
    else:
        frames[2 * place + 1] = (at, CanFrame(response.id, response.data[:1] + b"\x01\x21" + response.data[3:]))
    codes = [verdict.code for verdict in can_diagnosed(frames)[1]]
    assert "nothing-wrong" not in codes
    if flaw in ("an abort", "an emergency"):
        assert codes == ["refused"]


def test_one_frame_alone_is_not_nothing_wrong() -> None:
    for frame, code in (("585#8041600000000206", "refused"), ("585#4300100091010F00", "open")):
        assert [verdict.code for verdict in can_diagnosed([(1.0, CanFrame.parse(frame))])[1]] == [code]
    for log, codes in (
        (b"Rx: 01 83 02 C0 F1\n", ["refused", "open"]),
        (b"Rx: 01 03 02 00 17 F8 4A\n", ["open"]),
    ):
        assert [verdict.code for verdict in diagnosed(log)[1]] == codes


def test_requests_of_a_log_without_times_are_one_side_of_it_if_nobody_answers() -> None:
    frames: Frames = [(0.0, CanFrame(0x605, bytes((0x40, place, 0x20, 0, 0, 0, 0, 0)))) for place in range(26)]
    (verdict,) = can_diagnosed(frames)[1]
    assert (verdict.code, verdict.text) == ("open", "this log shows one side only")
