"""Mistakes that implementations really make, put into the reference one at a time: a case must fail for each."""

from __future__ import annotations

import json
from typing import Any, NamedTuple

import pytest

from tests.helpers import every_case
from tests.workbench.vectors.loaded import VECTORS
from tools import vectors_mistakes, vectors_mutants
from tools.peers import PEERS, ROOT

TEXTS = vectors_mutants.sources()
CODE = vectors_mutants.compiled(TEXTS)
ASKED = vectors_mutants.asked_of_kinds()


class Mistake(NamedTuple):
    """A change of one file of the reference, and the kind whose cases must notice it."""

    kind: str
    file: str
    before: str
    after: str


RIGHT_CRC = "if crc16(frame[:-2]) != frame[-2] | frame[-1] << 8:"
LENGTH = 'transaction, protocol, length = (int.from_bytes(frame[at : at + 2], "big") for at in (0, 2, 4))'
INDEX = '"index": f"{data[1] | data[2] << 8:04X}"'

MISTAKES = {
    # Modbus
    "only the second byte of the CRC is compared": Mistake(
        "rtu-frame", "frames", RIGHT_CRC, "if crc16(frame[:-2]) >> 8 != frame[-1]:"
    ),
    "only the first byte of the CRC is compared": Mistake(
        "rtu-frame", "frames", RIGHT_CRC, "if crc16(frame[:-2]) & 0xFF != frame[-2]:"
    ),
    "the CRC has its high byte first": Mistake(
        "rtu-frame", "frames", RIGHT_CRC, "if crc16(frame[:-2]) != frame[-2] << 8 | frame[-1]:"
    ),
    "the LRC is not compared": Mistake("ascii-frame", "frames", "if lrc(body[:-1]) != body[-1]:", "if False:"),
    "the LRC counts the colon": Mistake("lrc", "checks", "return -sum(data) & 0xFF", "return -sum(data) - 58 & 0xFF"),
    "the LRC is the one's complement": Mistake("lrc", "checks", "-sum(data) & 0xFF", "~sum(data) & 0xFF"),
    "the digits are written small": Mistake("ascii-frame", "frames", ".hex().upper()", ".hex()"),
    "the high byte of the MBAP length is ignored": Mistake(
        "tcp-frame", "frames", LENGTH, LENGTH + "\n    length &= 0xFF"
    ),
    "the low byte of the MBAP protocol is ignored": Mistake(
        "tcp-frame", "frames", LENGTH, LENGTH + "\n    protocol &= 0xFF00"
    ),
    "the high byte of the MBAP protocol is ignored": Mistake(
        "tcp-frame", "frames", LENGTH, LENGTH + "\n    protocol &= 0xFF"
    ),
    "the transaction has eight bits": Mistake("tcp-frame", "frames", LENGTH, LENGTH + "\n    transaction &= 0xFF"),
    "the unit has a sign": Mistake(
        "tcp-frame", "frames", '"unit": frame[6]', '"unit": frame[6] - (frame[6] >> 7 << 8)'
    ),
    "the byte count of a response is ignored": Mistake("pdu", "pdu", "if count != len(rest):", "if False:"),
    "another number of registers is accepted": Mistake("exchange", "exchange", "if code in (3, 4):", "if code == 3:"),
    "an exception is not told from an answer": Mistake(
        "exchange", "exchange", "if response[0] == request[0] | 0x80:", "if response[0] & 0x80:"
    ),
    "true is 0001h": Mistake("pdu", "pdu", 'message["value"] == 0xFF00', 'message["value"] == 1'),
    # CANopen
    "the node has six bits": Mistake("sdo", "services", "return identifier - base", "return identifier - base & 0x3F"),
    "n counts although s is 0": Mistake(
        "sdo-talk", "sdo_server", "8 - (line[0] >> 2 & 3 if line[0] & 1 else 0)", "8 - (line[0] >> 2 & 3)"
    ),
    "n counts although s is 0, in a client": Mistake(
        "sdo-talk", "sdo_client", "8 - (answer[0] >> 2 & 3 if answer[0] & 1 else 0)", "8 - (answer[0] >> 2 & 3)"
    ),
    "the size is one too large": Mistake(
        "sdo", "sdo", "size = 4 - (command >> 2 & 3)", "size = 5 - (command >> 2 & 3)"
    ),
    "20h is taken for download-initiated": Mistake(
        "sdo", "sdo", '"answer": {2: "upload-initiated",', '"answer": {1: "download-initiated", 2: "upload-initiated",'
    ),
    "the sub-index is ignored": Mistake("sdo", "sdo", '"sub": f"{data[3]:02X}"', '"sub": "00"'),
    "the index has its high byte first": Mistake("sdo", "sdo", INDEX, '"index": f"{data[2] | data[1] << 8:04X}"'),
    "an extended identifier is taken for a base one": Mistake(
        "nmt", "can_frames", 'if len(given["cob_id"]) != 3:', "if False:"
    ),
    "an extended SDO is taken for a base one": Mistake(
        "sdo", "can_frames", 'if len(given["cob_id"]) != 3:', "if False:"
    ),
    "the server ignores the toggle bit of a download": Mistake(
        "sdo-talk", "sdo_server", "if line[0] >> 4 & 1 != toggle:", "if False:"
    ),
    "the server ignores the toggle bit of an upload": Mistake(
        "sdo-talk", "sdo_server", "if line[0] >> 4 & 1 != number & 1:", "if False:"
    ),
    "the client ignores the toggle bit of a segment": Mistake(
        "sdo-talk", "sdo_client", "if line[0] >> 4 & 1 != toggle:", "if False:"
    ),
    "the client ignores the toggle bit of a confirmation": Mistake(
        "sdo-talk", "sdo_client", "if answer[0] >> 4 & 1 != number & 1:", "if False:"
    ),
    "the CRC of blocks is not compared": Mistake("sdo-talk", "sdo_blocks", "if crc and crc16(value) !=", "if 0 !="),
    "the CRC of blocks is that of RTU": Mistake("sdo-talk", "sdo_blocks", "register = 0\n", "register = 0xFFFF\n"),
    "the announced size is not compared": Mistake(
        "sdo-talk", "sdo_blocks", "if size is not None and len(value) != size:", "if False:"
    ),
    "numbers of a PDO have no sign": Mistake("pdo", "pdo", "if negative else raw", "if False else raw"),
    "a PDO may be longer than its mapping": Mistake("pdo", "pdo", "exactly(data, ", "(lambda *_: 0)(data, "),
    "the error register is left out": Mistake("emcy", "services", '"register": f"{data[2]:02X}"', '"register": "00"'),
    "the error code has its high byte first": Mistake(
        "emcy", "services", "code = data[0] | data[1] << 8", "code = data[1] | data[0] << 8"
    ),
    "an LSS answer is taken for a request": Mistake("lss", "services", '"answer": 0x7E4}', '"answer": 0x7E5}'),
    "the toggle bit belongs to the state": Mistake(
        "node-state", "services", "state = data[0] & 0x7F", "state = data[0]"
    ),
    "the counter of SYNC begins with 0": Mistake(
        "sync", "services", "within(data[0], 1, 240)", "within(data[0], 0, 240)"
    ),
    # Values
    "not a number becomes 0": Mistake("number", "values", "float(text))", "float(text) if text != 'nan' else 0.0)"),
    "32 bits have no sign": Mistake(
        "number",
        "values",
        'str(int.from_bytes(data, "big", signed=kind[0] == "i"))',
        'str(int.from_bytes(data, "big"))',
    ),
    "quick stop counts as enabled": Mistake("drive-state", "devices", "(0x6F, 0x27)", "(0x4F, 0x07)"),
}


@every_case("name", MISTAKES)
def test_a_case_notices_the_mistake(name: str) -> None:
    mistake = MISTAKES[name]
    assert TEXTS[mistake.file].count(mistake.before) >= 1, "the reference has changed: change the mistake with it"
    changed = {mistake.file: TEXTS[mistake.file].replace(mistake.before, mistake.after)}
    reference = vectors_mutants.Reference({**CODE, **vectors_mutants.compiled(changed)})
    assert vectors_mutants.first_failure(reference, ASKED[mistake.kind])


# The catalogue: mistakes in three other stacks -------------------------------------------------------------------

CATALOGUE: list[dict[str, Any]] = json.loads(vectors_mistakes.CATALOGUE.read_text(encoding="utf-8"))
FIELDS = {"stack", "file", "class", "what", "kinds", "before", "after", "seen", "programs"}


def test_each_mistake_of_the_catalogue_has_a_case_or_a_reason() -> None:
    """`make vectors-mistakes` plants all of them, and writes the case."""
    ids = {case["id"] for cases in ASKED.values() for case, _ in cases}
    assert {one["case"] for one in CATALOGUE if "case" in one} <= ids
    assert [one["what"] for one in CATALOGUE if {*one} not in (FIELDS | {"case"}, FIELDS | {"why"})] == []
    assert vectors_mistakes.as_lines(CATALOGUE) == vectors_mistakes.CATALOGUE.read_text(encoding="utf-8")
    changes = [(one["stack"], one["file"], one["before"], one["after"]) for one in CATALOGUE]
    assert len(changes) == len({*changes}), "the same change twice"
    assert len(CATALOGUE) >= 300
    assert sum("why" in one for one in CATALOGUE) <= len(CATALOGUE) * 0.01


def test_the_page_of_the_reference_has_the_numbers() -> None:
    text = (ROOT / "vectors" / "reference" / "README.md").read_text(encoding="utf-8")
    assert f"a catalogue of {len(CATALOGUE)} mistakes" in text
    unnoticed = sum("why" in mistake for mistake in CATALOGUE)
    assert f"Two of the {len(CATALOGUE)} ({unnoticed / len(CATALOGUE):.1%}".replace("%", " %") in text


def test_where_a_mistake_was_seen_is_a_thread_or_a_program_and_a_case() -> None:
    assert all(url.startswith("https://github.com/") for one in CATALOGUE for url in one["seen"])
    named = {text.partition(" (")[0] for one in CATALOGUE for text in one["programs"]}
    assert named <= {peer.name for peer in PEERS}


def test_each_mistake_can_be_planted() -> None:
    assert {one["stack"] for one in CATALOGUE} == {"javascript", "canopen", "pymodbus"}
    assert [problem for one in CATALOGUE if (problem := vectors_mistakes.problem(one))] == []


@pytest.mark.needs("node")
def test_a_mistake_is_planted_and_noticed() -> None:
    (mistake,) = [
        one for one in CATALOGUE if (one["stack"], one["what"]) == ("javascript", "the LRC is the sum itself")
    ]
    known: dict[str, set[str]] = {"javascript": set()}
    case, wrong = vectors_mistakes.noticed(mistake, VECTORS, known)
    assert case == mistake["case"]
    question, answer = next(iter(wrong.items()))
    programs = {"same": {question: answer}, "other": {question: "{}"}}
    assert vectors_mistakes.making(wrong, programs) == [f"same ({question.partition('.')[0]})"]
