"""Writes docs/reference/diagnosis-table.md: run `python tools/diagnosis_table.py` after a change of the diagnosis.

    own.json       frames of the manuals, each with one damage    one row for each
    threads.json   bytes that people posted in issue threads      one row for each thread: right if all its forms are
    threads_open.jsonl, threads_closed.jsonl   threads collected later, in two halves; by now the code was changed with
                   both in view; one row for each that is not right
    threads_fresh.jsonl   threads that the code was not made with, judged by hand: the record of one run
    threads_second.jsonl  others, after the diagnosis was changed for those: the record of a second run
    threads_third.jsonl to threads_seventh.jsonl   others again: the records of five more runs, without the texts

All are in tests/workbench/diagnosis/broken/. A row is right if the first finding has a code that a reader expects. The
expectations were written before the answers were seen. A test compares the page with the answers of today.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from barewire.devices import load  # noqa: E402
from barewire.errors import BarewireError  # noqa: E402
from barewire_workbench import explain_exchange, explain_text  # noqa: E402
from tests.workbench.cli.helpers import run_here  # noqa: E402

BROKEN = ROOT / "tests" / "workbench" / "diagnosis" / "broken"
PAGE = ROOT / "docs" / "reference" / "diagnosis-table.md"
HALVES = ("open", "closed")
JUDGEMENTS = ("right", "undecided", "missed", "wrong")
"""From the best to the worst."""
Case = dict[str, Any]
_ANSWERS: dict[str, list[str]] = {}

_INTRODUCTION = """# Broken inputs and what is said about them

This page is made by `python tools/diagnosis_table.py`. The inputs of the first table are frames of the manuals of three
devices, each with a damage that is met in practice. Those of the second were posted in issue threads of other projects.
One thread may have several inputs, for `barewire explain` and for `barewire diagnose`, and counts as right if the first
finding is right for all of them. *Expected* are the codes that a careful reader accepts as the first finding; "none" is
expected where nothing can be proved or nothing is wrong. The codes are described in [Diagnosis](diagnosis.md).

The code was made with these inputs in view. How it does on others is in
[Threads unseen when judged](#threads-unseen-when-judged).
"""


def cases(name: str) -> list[Case]:
    """Return the cases of one file."""
    found: list[Case] = json.loads((BROKEN / name).read_text(encoding="utf-8"))["cases"]
    return found


def codes_of(case: Case) -> list[str]:
    """Return the codes of all findings, the first one first; "unreadable" if the text is refused."""
    if case["id"] not in _ANSWERS:
        _ANSWERS[case["id"]] = _answered(case)
    return _ANSWERS[case["id"]]


def _answered(case: Case) -> list[str]:
    if case["how"] == ["diagnose"]:
        return _codes_of_log(case["input"])
    protocol, request = case["how"][1], case.get("request")
    try:
        if request is not None and case.get("role") != "request" and protocol != "can":
            device = load(case["device"]) if "device" in case else None
            explanation = explain_exchange(protocol, request, case["input"], device=device)
        else:
            explanation = explain_text(protocol, case["input"], case.get("role"))
    except BarewireError:
        return ["unreadable"]
    return [finding.code for finding in explanation.diagnosis]


def _codes_of_log(text: str) -> list[str]:
    events = _events_of_log(text)
    return ["unreadable"] if events is None else [event["code"] for event in events if event["event"] == "finding"]


def _events_of_log(text: str) -> list[dict[str, Any]] | None:
    """Return what `barewire diagnose --json` prints; None if it refuses the text."""
    with TemporaryDirectory() as folder:
        log = Path(folder) / "posted.log"
        log.write_text(text, encoding="utf-8")
        run = run_here("diagnose", str(log), "--json")
    if run.returncode not in (0, 1) or (run.returncode == 1 and not run.stdout):
        return None
    return [json.loads(line) for line in run.stdout.splitlines()]


def is_right(case: Case, codes: list[str]) -> bool:
    """Return whether the first finding is one that a reader expects."""
    if not codes:
        return case["expected"] in ([], ["*"]) or case.get("none_ok", False)
    if codes == ["unreadable"]:
        return False
    return case["expected"] == ["*"] or codes[0] in (case["expected"] or case.get("also", []))


_UNDECIDED = {"nothing-proved", "open", "not-seen", "no-bytes", "said"}
"""Codes that accuse nobody and leave the cause open."""
_SEEN = {
    "refused", "nothing-heard", "no-frame", "no-frames", "crc-wrong", "no-answer", "no-answers", "dead-unit",
    "lost-answers", "late-answers",
}  # fmt: skip
"""Codes that say what came or did not come, and not why."""


def posted(half: str) -> list[Case]:
    """Return the threads of a half, "open" or "closed", or those of a record, "fresh" or "second" to "seventh"."""
    return [json.loads(line) for line in (BROKEN / f"threads_{half}.jsonl").read_text(encoding="utf-8").splitlines()]


def _leading(events: list[dict[str, Any]] | None) -> list[str]:
    if events is None:
        return ["unreadable"]
    findings = [event["code"] for event in events if event["event"] == "finding"]
    return findings[:1] + [event["code"] for event in events if event["event"] == "verdict"]


def judged(case: Case) -> tuple[str, list[str]]:
    """Return the judgement on the diagnosis of a thread, and its leading codes: the first finding and all verdicts.

    "right" if an expected code is among them, every word of `says` is in the text, and nothing else is accused;
    "wrong" if something else is accused, or all is called good and should not be; "undecided" if no cause is named.
    """
    events = _events_of_log(case["log"])
    leading = _leading(events)
    if events is None:
        return "missed", leading
    codes, expected = set(leading), set(case["right"])
    text = json.dumps(events, ensure_ascii=False).lower()
    if codes - expected - _UNDECIDED - _SEEN:
        return "wrong", leading
    if codes & expected and all(word.lower() in text for word in case["says"]):
        return "right", leading
    return "undecided" if codes <= _UNDECIDED and "no-bytes" not in expected else "missed", leading


def _rows(name: str) -> Iterator[tuple[str, list[tuple[Case, list[str]]]]]:
    """Yield the cases of each source with their answers: one by one for our own, by thread for the others."""
    groups: dict[str, list[tuple[Case, list[str]]]] = {}
    for case in cases(name):
        groups.setdefault(case["id"] if name == "own.json" else case["source"], []).append((case, codes_of(case)))
    yield from groups.items()


def _cell(text: str, most: int = 60) -> str:
    shown = " ".join(text.split()).replace("|", "\\|").replace("`", "'")
    return shown if len(shown) <= most else shown[: most - 3] + "..."


def _table(name: str, title: str, first: str) -> tuple[list[str], int, int]:
    lines, right, total = [], 0, 0
    for source, answers in _rows(name):
        all_right = all(is_right(case, codes) for case, codes in answers)
        right, total = right + all_right, total + 1
        # Of several inputs of a thread the first wrong one is shown, or the first.
        case, codes = next((pair for pair in answers if not is_right(*pair)), answers[0])
        command = " ".join(case["how"])
        cells = (source, f"`{command} {_cell(case['input'])}`", ", ".join(case["expected"]) or "none")
        said = codes[0] if codes else "none"
        lines.append(
            f"| {' | '.join(cells)} | {said} | {'yes' if all_right else '**no**'} | {_cell(case['why'], 160)} |"
        )
    head = [f"## {title}", "", f"Right: {right} of {total}.", ""]
    head += [f"| {first} | input | expected | first finding | right | why |", "|---|---|---|---|---|---|"]
    return [*head, *lines, ""], right, total


_LATER = """## Threads collected later

157 threads with a known cause, said by a maintainer, found by the author or read from the log. They were split by the
SHA-256 of their addresses as they were collected: an open half for the work on the diagnosis, and a closed half, on
which it was run once, when that was done: of 86 it had 63 right, 4 undecided, 17 missed and 2 wrong (with bytes 16 of
32 right), on the words of the threads as they were posted. Then the code was changed with both halves in view. So what
follows is the set that was worked with, and says nothing about threads that nobody has seen. Most of what people post
is text without bytes, so that text and bytes are counted apart.

*right*: an expected code is the first finding or a verdict, and nothing else is accused. *undecided*: no cause
is named. *missed*: only what came and did not come is named, or the text is refused. *wrong*: something else is
accused, or all is called good.
"""
_BEFORE = {
    "open": "Before the work on it: 18 of 28 with bytes right, 2 wrong; 0 of 43 without bytes, which were refused."
}


def _counts(judgements: list[str]) -> str:
    return ", ".join(f"{judgements.count(word)} {word}" for word in JUDGEMENTS)


def _thread(url: str) -> str:
    repository, _, number = url.removeprefix("https://github.com/").rpartition("/")
    return f"{repository.removesuffix('/pull').removesuffix('/issues')}#{number}"


def _later(half: str) -> list[str]:
    cases = posted(half)
    judgements = [(case, *judged(case)) for case in cases]
    lines = [f"### The {half} half", ""]
    for what, is_text in (("with bytes", False), ("without bytes", True)):
        told = [judgement for case, judgement, _ in judgements if (case["right"] == ["no-bytes"]) is is_text]
        lines.append(f"- {len(told)} {what}: {_counts(told)}.")
    lines += ["", _BEFORE[half], ""] if half in _BEFORE else [""]
    lines += ["| thread | judgement | said | expected | cause | why not |", "|---|---|---|---|---|---|"]
    why = json.loads((BROKEN / "threads_missed.json").read_text(encoding="utf-8"))
    for case, judgement, leading in judgements:
        if judgement != "right":
            expected = ", ".join([*case["right"], *(f'"{word}"' for word in case["says"])])
            thread = _thread(case["url"])
            cells = (thread, judgement, ", ".join(leading), expected, _cell(case["cause"], 160), why.get(thread, ""))
            lines.append(f"| {' | '.join(cells)} |")
    return [*lines, ""]


_UNSEEN = """## Threads unseen when judged

100 threads that those who wrote the diagnosis had not seen; one of them, esphome/issues#7034, proved to be in the
closed half too. What was settled, what an expert concludes from the text alone and which verdict is wrong was written
down before the run. `barewire diagnose` of commit 72489990 was run once on each text, and each output was judged by
hand. Many texts are excerpts: a search gave them, and sentences that tell the cause were left out. Nothing in the
diagnosis was changed for this set. The threads are known from now on: the next measurement needs others. After
the judgement two things were mended, which *today* shows in part: a byte count that was not asked for is called that,
and a text that speaks of a failure on a line or bus is not refused, also if its bytes are in a form that is not read.

*right*: the cause, or the part of it that the bytes prove. *undecided*: no cause is named, or it says that there are
no bytes and how to get them, where an expert decides no more. *missed*: nothing useful, undecided where the bytes prove
the cause, "no bytes" where there are some, or the text is refused. *wrong*: something is accused that is not so. Two
that are called good and are not, pyhys/minimalmodbus#5 and pymodbus-dev/pymodbus#1749, accuse nobody and are missed.

The 20 hardest were judged by two rules. By the first it is right if the leading part of what an expert says is there.
By the second no sentence may be untrue, and no provable part may be missing. The stricter judgement counts. One reader
judged all, so the two are not independent. Two records were corrected by the bytes: without the byte FF the CRC of
stephane/libmodbus#587 does not fit, which changes no judgement; and emelianov/modbus-esp8266#328 is right and not
undecided, as the 7 bytes of the answer are those of the request with every level inverted.
"""
_NOW = """The diagnosis was changed later with these threads in view. Of the {kept} whose lines are kept, without the
words around them, it has now: {counts}. Who changed it judged that, so this says nothing about threads not seen."""
_REST = """Those missed and wrong, with the judgement by the first rule in brackets where it is another. *today* is what
is said of the lines with bytes or an error, which are kept; the words around them are not."""


def _unseen() -> list[str]:
    cases = posted("fresh")
    parts: list[tuple[str, list[Case]]] = [
        ("threads", cases),
        ("whose cause is settled, or in part", [case for case in cases if case["settled"] != "no"]),
        ("with bytes", [case for case in cases if case["bytes"]]),
        ("without bytes", [case for case in cases if not case["bytes"]]),
    ]
    lines = [_UNSEEN]
    lines += [f"- {len(part)} {what}: {_counts([case['judgement'] for case in part])}." for what, part in parts]
    now = [case["now"] for case in cases if "now" in case]
    lines += ["", _NOW.format(kept=len(now), counts=_counts(now))]
    twice = [case for case in cases if "twice" in case]
    differ = sum(first != second for first, second in (case["twice"] for case in twice))
    first_rule = _counts([case["twice"][0] if "twice" in case else case["judgement"] for case in cases])
    lines += ["", f"The two judgements differ in {differ} of {len(twice)}. By the first rule alone: {first_rule}.", ""]
    lines += [f"| group | threads | {' | '.join(JUDGEMENTS)} |", "|---|---|---|---|---|---|"]
    for group in sorted({case["group"] for case in cases}):
        told = [case["judgement"] for case in cases if case["group"] == group]
        lines.append(f"| {group} | {len(told)} | {' | '.join(str(told.count(word)) for word in JUDGEMENTS)} |")
    return [*lines, "", _REST, "", *_missed_and_wrong(cases)]


_AGAIN = """## A second set, unseen when judged

64 other threads, after the diagnosis was changed with the 100 in view, by a reader who knew neither its code nor its
tests. Causes and what an expert says were written down before `barewire diagnose` of commit 5385616c was run, once.
Of 13 the cause is what the reader read in the log, since the thread was seen in part only. Six threads are about the
envelope of Solarman V5 (A5 ... 15), which was read as noise around RTU; one may say that they are not of Modbus.

After the judgement a traceback was mended (the words "exception 02"), and four of the wrong statements about words:
coil addresses taken for lengths, E2 of a CRC for an error code, a busy device for a busy port, the last number of a
sentence for a byte. The goal, 8 of 10 right or honestly undecided and none wrong, was not reached: most was missed
where bytes stand in escapes and markup, or where two frames have to be put in relation.
"""


_THIRD = """## A third set, unseen when judged

88 other threads, after the diagnosis was changed with the 64 in view. A reader who knew neither code nor tests took
them as searches gave them, and wrote down causes and what an expert says; two other such readers judged the output of
`barewire diagnose` of commit 7b60e58b, run once, by the stricter rule: no sentence may be untrue, no provable part may
be missing, and of two verdicts the worse one. Many texts are excerpts. The goal was missed by far, and by more than in
the sets before, of which a part was judged by the first rule.

Of the wrong ones 31 are wrong for a sentence about words: "the text says that no answer came in time" (a checksum, a
refusal) where a setting or a person is meant, or "the text does not say what failed" where it does.
Then come causes that the text excludes, silence where one side is logged, frames that a program prints without CRC,
pieces that are not joined, and counts.
After the judgement the words are shown with their line, and what they mean in messages of programs; settings, code and
sentences of people are no messages; causes hold where the text does not exclude them; rows of CAN with a time are read.
"""
_FOURTH = """## A fourth set, unseen when judged

54 other threads, collected, run (commit 127177ab) and judged as the third set was, after the words of texts were
changed. A list of causes that the text excludes counts as wrong here too, though it says that it holds only where the
text does not exclude it. What is wrong now: pieces of one frame that are not joined, words of a program's usual lines
("waiting for reply", mended after the judgement), times and ranges in sentences that are read as bytes, logs of one
side, causes of a serial line for TCP. What is missed are mostly causes in words that are no known message.
"""
_FIFTH = """## A fifth set, unseen when judged

60 other threads, after the diagnosis was changed to say less: no lists of causes, no counts of what was not read, one
side of a log is called that, a verdict without a proved cause begins with "undecided". Collected, run (commit b3dc9103)
and judged by the same strict rule as the third and fourth set, by readers who knew neither code nor tests; what an
expert says, and whether the text decides it, was written down and hashed before the run. Many texts are excerpts.

More is left undecided than in the sets before, and less is wrong, and almost nothing is right. Eleven of the fourteen
wrong ones have bytes of Modbus: "outside of a frame" of an answer with only its CRC wrong or a stray 00 in front, "cut"
of a frame whose print was cut or goes on in the next line, a PDU without an address read from its second byte. What is
missed are mostly relations of two frames: an own echo, answers shifted by one, quantities in another unit.

After the judgement, with these threads in view, a frame whose CRC alone does not fit is called that, bytes printed in
part are no cut frame, an own echo and eight times the bits are named, CAN data of unknown meaning are not called good,
and a time-out that a text denies is none. Logs of BUSMASTER are read, and the answer to a text without bytes begins
with the message that is known. Nobody has judged the answers of today.
"""
_SIXTH = """## A sixth set, unseen when judged

40 other threads, after the diagnosis was changed with the fifth set in view. Collected, run (commit df486e66) and
judged by the same strict rule, by a reader who knew neither code nor tests; what an expert says, whether the text
decides it, and which verdicts would be wrong was written down before the run. One reader judged all. All are threads
of GitHub, excerpts as a search gave them, so that many begin or end within a frame.

Few are right, as in the fifth set, and more are wrong. By the first rule, for which the leading part of what an expert
says is enough, eight of the fifteen wrong ones are right or undecided: wrong is a sentence beside it. In five the end
or the beginning of the quotation is called a fault of the line: a cut frame, a byte lost, bytes outside of a frame.
Four have frames of CAN in a print that is not read, or not in whole; two of them are read as Modbus. In three a frame
that a program printed twice counts twice, or a response in two pieces is not joined. The others are marks of a
terminal taken for bytes, silences of stamps in whole seconds, and one side of a log whose other side was left out.
What is missed are mostly messages of programs that are not known, relations of two frames, and an all-clear under a
title that tells of trouble.

After the judgement, with these threads in view, what a quotation cuts at its beginning or end is called that, a frame
that is printed twice counts once, two parts of one response are joined, and stamps in whole seconds give no short
silence. Frames of CAN in three more prints are read, and those of ISO-TP are no heartbeats. Sound frames under words
of trouble are left undecided. Five more messages are known, of ioBroker, mbusd, `ip` and jsmodbus. Messages with two
numbers, one expected and one that came, are known by that form; an exception in a sentence answers the one open request
of its function; responses behind the next request are a verdict; a response short of both counts, frames that code puts
together, messages of ISO-TP and error frames as gs_usb prints them are read. Nobody has judged the answers of today.
"""
_SEVENTH = """## A seventh set, unseen when judged

40 other threads, after the diagnosis was changed with the sixth set in view. Collected, run (just before commit
94a88daf) and judged by the same strict rule; the words of the expert were written down and hashed before the run, and
one reader judged all. The texts are excerpts as a search gave them; four are of forums, of which two are in Russian and
one in German.

It is no better than the sixth by either rule: what was changed in between does not carry over to other threads, and the
goal, eight of ten right or undecided, is not reached. Fewer are wrong and more are missed. Seven of the nine wrong ones
have bytes of Modbus: a print of the same frame beside it, a log that leaves the unit out or shows one request in three
forms, a first byte of the response that is there under "no unit answers", bytes of a sentence paired as a response. Six
of the eight with CAN are missed, most for prints that are not read. The others that are missed are messages of programs
that are not known, and numbers in a message that name a frame of the log. Nothing was changed after it.
"""
_RECORDS = {
    "second": _AGAIN, "third": _THIRD, "fourth": _FOURTH, "fifth": _FIFTH, "sixth": _SIXTH, "seventh": _SEVENTH,
}  # fmt: skip
"""The records of sets that were unseen when judged, and what the page says of each."""


_NOW_AGAIN = """The diagnosis was changed later with these threads in view. It has now: {counts}. Who changed it judged
that, by the stricter of the two rules above, so this says nothing about threads not seen."""


def _unseen_again(record: str, introduction: str) -> list[str]:
    cases = posted(record)
    found = [case for case in cases if case["settled"] == "yes"]
    lines = [introduction]
    for what, part in (("threads", cases), ("whose cause was found in the thread", found)):
        lines.append(f"- {len(part)} {what}: {_counts([case['judgement'] for case in part])}.")
    for group in sorted({case["group"] for case in cases}):
        told = [case["judgement"] for case in cases if case["group"] == group]
        lines.append(f"- {len(told)} with {group}: {_counts(told)}.")
    if "now" in cases[0]:
        lines += ["", _NOW_AGAIN.format(counts=_counts([case["now"] for case in cases]))]
    if all("twice" in case for case in cases):
        lines += ["", f"By the first rule alone: {_counts([case['twice'][0] for case in cases])}."]
    return [*lines, "", *_missed_and_wrong(cases)]


def _missed_and_wrong(cases: Iterable[Case]) -> list[str]:
    lines = [
        "| thread | judgement | said | today | an expert says | cause | why not |",
        "|---|---|---|---|---|---|---|",
    ]
    for case in sorted(cases, key=lambda case: case["judgement"] != "wrong"):
        if case["judgement"] in ("missed", "wrong"):
            first = case.get("twice", [case["judgement"]])[0]
            judgement = case["judgement"] + (f" ({first})" if first != case["judgement"] else "")
            today = ", ".join(_leading(_events_of_log(case["log"]))) if case.get("log") else ""
            texts = (_cell(case["expert"], 160), _cell(case["cause"], 160), case["why"])
            cells = (_thread(case["url"]), judgement, ", ".join(case["said"]), today, *texts)
            lines.append(f"| {' | '.join(cells)} |")
    return [*lines, ""]


def page(names: Iterable[str] = ("own.json", "threads.json"), halves: Iterable[str] = ()) -> str:
    """Return the page, or the tables of these files and halves."""
    titles = {
        "own.json": ("Damaged frames of three manuals", "case"),
        "threads.json": ("Bytes from issue threads", "thread"),
    }
    lines = [_INTRODUCTION]
    for name in names:
        lines += _table(name, *titles[name])[0]
    if halves:
        lines.append(_LATER)
    for half in halves:
        lines += _later(half)
    if halves:
        lines += _unseen()
        for record, introduction in _RECORDS.items():
            lines += _unseen_again(record, introduction)
    return "\n".join(lines).rstrip() + "\n"


def main() -> None:
    """Write the page, and say how many rows are right."""
    PAGE.write_text(page(halves=HALVES), encoding="utf-8")
    counts = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith(("Right", "- "))]
    sys.stdout.write("\n".join(counts) + "\n")


if __name__ == "__main__":
    main()
