"""Writes docs/conform-canopen.md: every case of the CANopen conformance battery, as the code has it.

python tools/conform_can.py
"""

from __future__ import annotations

from pathlib import Path

from barewire.canopen import Entry, LocalNode, LssAddress, LssSlave, ObjectDictionary, PdoConfig, standard_objects
from barewire.canopen.conformance.battery import cases
from barewire.canopen.conformance.model import Subject
from barewire.canopen.conformance.probe import probe
from barewire.conversation import play

PAGE = Path(__file__).parent.parent / "docs" / "conform-canopen.md"
NODE = 5

HEAD = """\
# CANopen conformance, case by case

`barewire conform can://...` holds any CANopen device against CiA 301 and CiA 305: {total} cases. Each says some frames
and compares what comes back with the answers that the standard lets a device give. Where real devices differ and nobody
is wrong (which abort code a refusal carries, whether a stray segment is answered), each of the ways is accepted; an
abort 0800 0000h, *general error*, is accepted for every refusal.

```text
$ barewire conform "can://socketcand/127.0.0.1:29536/can0?node=5"          # barewire simulate az3 is there
ok      SDO-01  upload of 1000h:00, device type
ok      SDO-02  upload of 1001h:00, error register
FAILED  SDO-03  upload of 1018h:00, entries of the identity: after 605#4018100000000000: 585#8018100000000206, expected
                585#4F18100000......|585#4218100000......
...
-       SEG-40  7 bytes there and back (needs large object)
...
145 of 149 as the standard says, 126 left out
```

First the objects of the device are read, behind a reset of its communication unless all cases only read; a case whose
objects it does not have is left out and says so. A failure tells what was said, what came and what was expected, in
the notation of candump with a dot for any digit. The exit status is 1 if a case failed, or if no device answers. One
that falls silent in the midst of it has three seconds to come back; then the run ends with a line that says behind
which case it was, and how many cases were not run (with `--json` an object `unfinished`, `not_run`), and with status 1.

| option | what it does |
|---|---|
| `?node=5` | the device; 1 if not said |
| `&timeout=0.2` | how long silence is waited for; 0.5 s if not said |
| `--json` | one object a line, with every frame that was heard |
| `--only SDO,NMT-1` | cases whose names begin so |
| `--large 2100:00` | an object that takes any bytes: it is written to, in several segments and blocks |
| `--gentle` | leaves out whatever changes the device |

**Not for a machine that is running.** The column *effect* below tells what a case does:

| effect | what it does |
|---|---|
| reads | nothing changes |
| writes | objects are written, 1000h to 1FFFh and the one of `--large`; a reset of the communication follows |
| commands | the device is started, stopped and reset, gets RPDOs of zeros, hears SYNC, and heartbeats of a node 126 |

An interface that cannot carry remote frames (socketcand) leaves out the cases that need them.

The cases are data in `barewire.canopen.conformance.battery` and the files beside it, and a conversation carries them
out, so they run in virtual time as well. This holds a device of your own against those that do not start or stop it,
in a second:

```python
from barewire.canopen import LocalNode, ObjectDictionary, standard_objects
from barewire.canopen.conformance.battery import cases
from barewire.canopen.conformance.probe import probe
from barewire.canopen.conformance.runner import prepare, run_case
from barewire.conversation import play

device = LocalNode(5, ObjectDictionary(standard_objects()))
device.start(0.0)


def answer(frame, now):
    return [(now + 0.001, one) for one in device.feed(frame, now)]


subject, now = play(probe(5), answer)
for case in cases(subject):
    if case.effect != "commands" and not case.lacks:
        booted, now = play(prepare(subject), answer, start=now)
        outcome, now = play(run_case(case), answer, start=now)
        assert outcome.failure is None, outcome.failure
```

`play` does not let a device speak by itself. The other cases need a bus that feeds it at its `deadline`.

The simulated AZ3 passes all that it can be asked but four, and these are what its guide says: it has no identity object
(SDO-03, SDO-04), takes every number in four bytes (SDO-47) and stores without a signature (SDO-51).

A LocalNode of the `canopen` library (2.4.1) answers in STOPPED (NMT-02, -03, -04, -06), says no boot-up message after a
reset (NMT-10, -11, -13, -15), takes a frame with 29 bits for one with 11 (SDO-32), has every sub-index of a variable
(SDO-07, SDO-44), refuses 22h (SDO-46), and answers a block upload with segments although no switch was offered (BLK-01
to -05). `tests/interop/test_canopen_conform.py` holds the battery against it.

## The cases

The list for a device that has everything. *Accepted* says what is not obvious.
"""


def subject() -> Subject:
    """A device that has whatever a case could ask for."""
    address = LssAddress(0x360, 1, 0x1_0002, 7)
    objects = [
        *standard_objects(address, name="barewire plain device"),
        *(Entry(index, 1, "all parameters", "u32", "rw", 1) for index in (0x1010, 0x1011)),
        Entry(0x1200, 1, "COB-ID client to server", "u32", "const", 0x600 + NODE),
        Entry(0x1200, 2, "COB-ID server to client", "u32", "const", 0x580 + NODE),
        Entry(0x2100, 0, "anything", "domain"),
        Entry(0x6040, 0, "controlword", "u16"),
        Entry(0x6041, 0, "statusword", "u16", "ro"),
    ]
    pdos = [PdoConfig("RPDO", 1, (0x60400010,)), PdoConfig("TPDO", 1, (0x60410010,), type=1)]
    device = LocalNode(NODE, ObjectDictionary(objects), pdos, lss=LssSlave(address))
    device.start(0.0)
    found, _ = play(probe(NODE, large=(0x2100, 0)), lambda frame, now: [(now, one) for one in device.feed(frame, now)])
    return found


def page() -> str:
    """The whole page."""
    rows = cases(subject())
    lines = [HEAD.format(total=len(rows))]
    for clause in dict.fromkeys(case.clause for case in rows):
        group = [case for case in rows if case.clause == clause]
        lines += [f"### {clause}", "", "| case | what | effect | accepted |", "|---|---|---|---|"]
        lines += [f"| {case.name} | {case.title} | {case.effect} | {case.why} |" for case in group]
        lines.append("")
    return "\n".join(lines).rstrip() + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
