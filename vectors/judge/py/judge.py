"""The verdict on one answer, by ../../PROTOCOL.md: judge(row) is "passed", "open", "failed" or "not offered".

A row is a line of questions.jsonl with the `answer` to its question; of device-conformance also `filled`, by fill.py.
As a program it reads rows from standard input and writes a line for each: the id of the question, a blank, the verdict.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from equal import Fields, equal, form, is_excluded
from patterns import fits_one_row, is_accepted

MAY_REFUSE = ("drive-state.decode", "drive-command.decode")


def judge(row: Fields) -> str:
    question, expected, answer = row["question"], row["expected"], row["answer"]
    if not isinstance(answer, dict) or sum(name in answer for name in ("is", "refused", "not_offered")) != 1:
        return "failed"
    if "not_offered" in answer:
        return "not offered"
    fields, refused = answer.get("is"), answer.get("refused")
    if not isinstance(fields, dict) if "is" in answer else not isinstance(refused, str):
        return "failed"
    operation, result = f"{question['kind']}.{question['do']}", row["result"]
    if operation == "eds.check" and result == "acceptable":
        result = "valid"
    if result == "invalid" and row["fails"] != "compare":
        return "passed" if refused in ("", row["reason"]) else "failed"
    same = fields is not None and as_expected(row, fields)
    if result == "invalid" and fields is None:
        return "passed" if operation in MAY_REFUSE else "open"
    if result == "invalid":
        return "failed" if same or not has_form(expected, fields) else "passed"
    if result == "acceptable" and question["do"] == "encode":
        is_wrong = same and "tolerant" in row.get("flags", ())
        return "failed" if fields is not None and (is_wrong or not has_form(expected, fields)) else "passed"
    if same:
        return "passed"
    may_differ = result == "acceptable" and not (fields is not None and is_excluded(expected, fields, question))
    return "open" if may_differ else "failed"


def has_form(expected: Fields, fields: Any) -> bool:
    """Whether the fields could be an answer of another case: none is missing, empty, or of another type of JSON."""
    return all(
        name in fields
        and form(fields[name]) == form(value)
        and (value in ("", [], {}) or fields[name] not in ("", [], {}))
        for name, value in expected.items()
    )


def as_expected(row: Fields, fields: Fields) -> bool:
    question, expected = row["question"], row["expected"]
    if question["kind"] == "device-conformance":
        return is_accepted(row.get("filled"), fields.get("received"))
    if question["kind"] == "server-conformance":
        return fits_one_row(expected["answers"], fields.get("answers"))
    return equal(expected, fields, "", str(question.get("parameter", question).get("type", "")), question)


if __name__ == "__main__":
    for line in sys.stdin:
        row = json.loads(line)
        sys.stdout.write(f"{row['question']['id']} {judge(row)}\n")
