"""Every case of vectors/, answered by barewire, and the judge: a change of any field is noticed."""

from __future__ import annotations

import itertools
import json
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from barewire.errors import EncodeError
from barewire_workbench.vectors.answers.table import own_answer
from barewire_workbench.vectors.files import VectorFile, Vectors, digest, load_vectors
from barewire_workbench.vectors.questions import DESCRIPTION, Case, Question
from barewire_workbench.vectors.run import CheckedCase, run_cases
from tests.helpers import every_case, part_or_whole
from tests.workbench.vectors.loaded import VECTORS

ROOT = Path(__file__).parents[3] / "vectors"
CASES = [(file, case) for file in VECTORS.files for case in file.cases]
DESCRIBES = {*DESCRIPTION, "id", "result", "reason", "fails", "flags", "side", "do"}
"""Fields that describe a case; the others are given or expected. `side` is given, but not every message needs it."""


def own(question: Question) -> dict[str, Any]:
    return own_answer(json.loads(json.dumps(question.as_json())))


def checked(file: VectorFile, case: Case) -> CheckedCase:
    """The case, with the digest that fits it: a change of it is noticed by the answers alone."""
    digests = {case["id"]: digest(case)}
    (found,) = run_cases(Vectors((file._replace(cases=(case,)),), VECTORS.kinds, digests), own, exact=True)
    return found


@pytest.mark.parametrize("step", part_or_whole(5, 1))
@every_case("file", VECTORS.files)
def test_barewire_passes(file: VectorFile, step: int) -> None:
    """A part is all, and of the cases that test a device, each of which starts one, every fifth."""
    cases = file.cases[::step] if file.kind == "device-conformance" else file.cases
    checks = [(case["id"], checked(file, case).verdict) for case in cases]
    assert [(case_id, verdict.text) for case_id, verdict in checks if verdict.state != "passed"] == []


def altered(value: Any) -> Iterator[Any]:
    """Yield the same value with one change in it."""
    if isinstance(value, bool):
        yield not value
    elif isinstance(value, (int, float)):
        yield from (value + 1, value - 1)
    elif isinstance(value, str):
        yield from (value[:-1] + ("0" if value.endswith("1") else "1"), value + "0")
    elif isinstance(value, list):
        yield from (value[:place] + value[place + 1 :] for place in range(len(value)))
        for place, item in enumerate(value):
            yield from ([*value[:place], other, *value[place + 1 :]] for other in altered(item))
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from ({**value, key: other} for other in altered(item))


def is_noticed(file: VectorFile, case: Case) -> bool:
    """Whether a changed case fails, or cannot be read any more."""
    try:
        return checked(file, case).verdict.state == "failed"
    except Exception:
        return True


@every_case("kind", VECTORS.kinds)
def test_a_change_in_any_field_of_a_kind_is_noticed(kind: str) -> None:
    """A judge that did not compare a field would pass every change of it."""
    cases = [(file, case) for file, case in CASES if file.kind == kind and case["result"] != "invalid"]
    fields = {field for _, case in cases for field in case if list(altered(case[field]))} - DESCRIBES
    if kind == "sdo-talk":
        fields.discard("node")  # its frames are written without an identifier, so every node is right
        fields.discard("never")  # what no answer of ours is
    if kind == "client":
        fields.discard("probes")  # what a client sends of its own accord: no accepted outcome may depend on it
    noticed = set[str]()
    for (file, case), field in itertools.product(cases, fields):
        if field not in noticed and any(is_noticed(file, {**case, field: one}) for one in altered(case.get(field))):
            noticed.add(field)
    assert noticed == fields


def test_a_thousand_random_changes_of_a_byte_are_noticed() -> None:
    """Each change is one character of the JSON of one case; the digest notices what no answer depends on."""
    dice = random.Random(1)
    missed = []
    for _ in range(1000):
        _, case = dice.choice(CASES)
        text = json.dumps(case, ensure_ascii=False)
        at = dice.randrange(len(text))
        try:
            changed = json.loads(text[:at] + dice.choice("0123456789ABCDEF x") + text[at + 1 :])
        except ValueError:
            continue
        if changed != case and not VECTORS.damage(changed):
            missed.append(f"{case['id']} at {at}")
    assert missed == []


def test_a_damaged_case_fails() -> None:
    file, case = CASES[0]
    damaged = VECTORS._replace(files=(file._replace(cases=({**case, "comment": "changed"},)),))
    (found,) = run_cases(damaged, own)
    assert found.verdict.state == "failed"
    assert "has been changed" in found.verdict.text


def test_a_case_that_asks_nothing_fails() -> None:
    """A file whose kind has become another one that exists."""
    file = next(file for file in VECTORS.files if file.kind == "sdo")
    damaged = VECTORS._replace(files=(file._replace(kind="pdo", cases=file.cases[:1]),))
    (found,) = run_cases(damaged, own)
    assert found.verdict.state == "failed"
    assert "asks no question" in found.verdict.text


@pytest.mark.parametrize(
    ("before", "after", "text"),
    [
        ('"barewire-vectors/1"', '"barewire-vectorS/1"', "vectors ascii/lrc: it is no file of vectors"),
        ('"subject":', '"subjeCt":', "vectors ascii/lrc: it has no subject"),
        ('"cases":', '"cAses":', "vectors ascii/lrc: it has no cases"),
    ],
)
def test_a_damaged_head_of_a_file_is_noticed(tmp_path: Path, before: str, after: str, text: str) -> None:
    whole, damaged = (root / "cases" / "ascii" / "lrc.json" for root in (ROOT, tmp_path))
    damaged.parent.mkdir(parents=True)
    damaged.write_text(whole.read_text(encoding="utf-8").replace(before, after))
    digests = {case_id: found for case_id, found in VECTORS.digests.items() if case_id.startswith("lrc-")}
    (tmp_path / "index.json").write_text(json.dumps(digests))
    for name in ("kinds.json", "profiles.json", "VERSION"):
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    with pytest.raises(EncodeError, match=text):
        load_vectors(tmp_path)


MAY_BE_INDIFFERENT = {
    ("client", "pdu"),  # of a request or an answer that is lost or refused
    ("client", "bytes"),  # noise
    ("client", "registers"),  # those that nobody reads
    ("client", "coils"),
    ("client", "changes"),
    ("cob-restricted", "cob_id"),  # the next identifier is restricted, too
    *[("boot-slave", name) for name in ("device_type", "vendor", "product", "revision", "serial")],  # another wrong one
    ("boot-slave", "bytes"),  # of a node that is not configured
    ("device", "value"),  # the object is overwritten, or only its address matters
    ("device", "low"),
    ("device", "high"),
    ("device", "error"),  # that nobody is told, while the device is stopped
    ("device", "clear"),  # an error that is not there
    ("device-conformance", "in"),  # another number that is restricted, too, or that the device does not have
    ("device-conformance", "value"),  # other bytes, which are read back
    ("drive-path", "before"),  # of which only bit 7 matters, and only to a fault
    ("drive-path", "words"),  # bits of the mode and of the manufacturer
    ("drive-path", "seen"),
    ("drive-command", "word"),  # bits of the manufacturer
    ("heartbeat-consumer", "value"),  # several numbers say that an entry is unused
    ("heartbeat-consumer", "bytes"),
    ("exchange", "request"),  # many requests have the same response
    ("node-talk", "address"),  # the LSS address of a device that is not found by it
    ("parameter", "index"),  # which object it is does not change its bytes
    ("parameter", "sub"),
    ("parameter", "order"),  # of a value of one register
    ("parameter", "old"),  # the half of the register that is replaced
    ("pdo", "entry"),
    ("register-part", "register"),
    ("device", "clear"),  # an error that the device does not report
    ("server-conformance", "answers"),  # those of other servers
    ("server-conformance", "pdu"),
    ("server-conformance", "raw"),
    ("server", "functions"),  # another function that no step asks for
    ("tls-role", "extensions"),  # those of other purposes
    ("gateway", "bytes"),  # what is discarded in any case
    *[
        (kind, "one_of") for kind in ("server", "device", "drive-path", "gateway-309-3", "eds", "client", "sdo-talk")
    ],  # the answers of others
    ("server", "ask"),  # many requests are refused in the same way
    ("server", "raw"),  # other bytes are not a frame either
    ("server", "stream"),  # nor are those of a header that is refused
    ("server", "holding_registers"),  # registers and bits that no step reads or writes
    ("server", "input_registers"),
    ("server", "coils"),
    ("server", "discrete_inputs"),
    ("server", "files"),
    ("server", "functions"),  # those that it does not have either
    ("server", "queues"),
    ("server", "identification"),
    ("sdo-talk", "talk"),  # bytes that are reserved or sent by the side that breaks the rules
    ("sdo-talk", "value"),
    ("sdo-talk", "index"),
    ("sdo-talk", "sub"),
    ("sdo-talk", "abort"),
    ("text", "pad"),  # of a text that fills its bytes
}
"""Kind and field where a changed digit may give the same answer, and why."""


@pytest.mark.parametrize("step", part_or_whole(5, 1))
def test_a_changed_digit_of_a_valid_case_changes_the_answer(step: int) -> None:
    """The answers alone notice nearly every digit, without the digest. Each case has its own dice, so that a new case
    changes nothing for the others. A part is every fifth case, of all files."""
    missed = []
    for file, case in CASES[::step]:
        if case["result"] != "valid":
            continue
        dice = random.Random(case["id"])
        changed = json.loads(json.dumps(case))
        if places := list(hex_places(changed)):
            holder, key, name = dice.choice(places)
            text = holder[key]
            at = dice.choice([place for place, character in enumerate(text) if character != " "])
            holder[key] = text[:at] + dice.choice([one for one in DIGITS if one != text[at]]) + text[at + 1 :]
            if (file.kind, name) not in MAY_BE_INDIFFERENT and not is_noticed(file, changed):
                missed.append(f"{case['id']} {name}: {text} -> {holder[key]}")
    assert missed == []


DIGITS = "0123456789ABCDEF"


def hex_places(value: Any, name: str = "") -> Iterator[tuple[Any, Any, str]]:
    """Yield where in a case there is a text of hexadecimal bytes: holder, key, name of the field."""
    rows = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in rows:
        inner = key if isinstance(key, str) and not {*key} <= {*DIGITS} else name
        if inner in DESCRIBES:
            continue
        if isinstance(item, str) and item.strip() and {*item} <= {*DIGITS, " "}:
            yield value, key, inner
        else:
            yield from hex_places(item, inner)
