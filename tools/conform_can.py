"""Writes docs/reference/conform-canopen.md, a list of all CANopen conformance cases: `python tools/conform_can.py`."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

from barewire_workbench.conform.canopen.model import Subject  # noqa: E402
from barewire_workbench.live.canopen_conformance import cases, why_left_out  # noqa: E402
from tests.workbench.conform.canopen.devices import LARGE, az3, bus_with, failures, plain, subject_of  # noqa: E402
from tools.cia_cases import table  # noqa: E402

PAGE = ROOT / "docs" / "reference" / "conform-canopen.md"

HEAD = """\
# CANopen conformance, case by case

`barewire conform can://...` tests any CANopen device against CiA 301 and CiA 305 with {total} cases. Each case sends
some frames and compares the answers with those that the standard allows. Where devices differ within the standard
(which abort code a refusal has, whether a segment without a transfer is answered), every allowed answer is accepted; an
abort 0800 0000h, *general error*, is accepted for every refusal.

```text
$ barewire conform "can://socketcand/127.0.0.1:29536/can0?node=5"          # barewire simulate az3 is there
ok      SDO-01  upload of 1000h:00, device type
ok      SDO-02  upload of 1001h:00, error register
...
FAILED  SDO-47  four bytes to an object of two: after 605#2317100010270000: 585#6017100000000000, expected
                585#8017100010000706|585#8017100012000706|585#8017100000000008
...
-       SEG-40  7 bytes written and read back (needs large object)
...
{passed} of {judged} passed, {left_out} left out
```

First the objects of the device are read, after a reset of its communication if any case changes the device; a case
whose objects it does not have is left out with the reason. A failure shows what was sent, received and expected, in
the notation of candump with a dot for any digit. A case that fails is repeated, twice at most; if it then passes the
verdict is `now and then` in place of `FAILED`: a race in the device, or a disturbed bus. LSS requests are 13.5 ms
apart, the time of a frame at 10 kbit/s, since a device may hold only one, and most have no answer to wait for.

The exit status is 0 if all cases passed, 1 if one failed, always or now and then, or if no device answers, and 3 if two
devices answer as this node: that is one line, and no case is run. With `--json` each case has a `verdict`: `ok`,
`failed`, `now and then` or `left out`.

A device that stops answering during the run has three seconds to return; then the run ends with a line that names the
last case and the number of cases that were not run (with `--json` an object `unfinished`, `not_run`), and status 1.

| option | meaning |
|---|---|
| `?node=5` | the node-ID of the device; default 1 |
| `&timeout=0.2` | seconds until an answer counts as missing; default 0.5 |
| `--json` | one object a line, with every received frame |
| `--only SDO,NMT-1` | cases whose names begin so |
| `--eds drive.eds` | the EDS of the device: every object is compared with it, see [below](#against-an-eds) |
| `--large 2100:00` | an object for any bytes: 00h, 01h, 02h ... is written to it in several segments and blocks |
| `--save` | also the cases that store values in the memory of the device |
| `--power-cycle` | the same, and STO-08, in which you switch the device off and on within two minutes |
| `--write-application` | with `--eds`, also other values for objects from 2000h on, [below](#application-objects) |
| `--gentle` | leaves out the cases that change the device |

After each case that changes the device its communication is reset, it is switched to pre-operational (it may start
itself), and what the case wrote is read back and written if the device kept it. So one departure fails the cases that
name it, and not all that follow: a device that starts itself fails NMT-19; one that keeps values over a reset of the
communication fails NMT-17, RPD-19, TPD-19, SYN-05, CHN-06, CHN-08, CHN-12, CHN-13 and CFG-02, and STO-03 if that
runs. COB-01 to COB-09 send some 800 requests each: 15 s in all at 125 kbit/s.

Ctrl-C leaves the device as the last case has made it, possibly in STOPPED, where it does not answer. A run that finds
it silent sends NMT 80h, *enter pre-operational*, first, and says so on stderr; `--gentle` sends no command.

**Not for a machine that is running.** The column *effect* below:

| effect | meaning |
|---|---|
| reads | nothing changes |
| tries | objects are written, with the value that they have or with one that they must refuse; a failure is undone |
| writes | objects are written, 1000h to 1FFFh and the one of `--large`; a reset of the communication follows |
| commands | the device is started, stopped and reset, gets RPDOs of zeros, SYNC, and heartbeats of a node 126 |
| stores | values are stored by 1010h; afterwards those that the device had are stored again; only with `--save` |
| power | the same, and the device is switched off and on; only with `--power-cycle` |
| application | a drive may move, outputs may switch: other values from 2000h on; only with `--write-application` |

Interfaces without remote frames (socketcand) leave out the cases that need them.

The cases are data for any language, of the kind `device-conformance` of the
[vectors](../../vectors/kinds/device-conformance.md), in the files `vectors/cases/canopen/conform-*.json`: frames to
send, patterns of the answers that are accepted, and placeholders for what differs between devices. Only the cases RND
(random order) and those of an EDS are made by the program. The same cases, with JUnit XML and the other options of
[`vectors check`](../how-to/vectors.md):

    barewire vectors check --endpoint "can://socketcan/can0?node=5" --junit report.xml

A conversation carries the cases out, so they run in virtual time as well. This tests a device of your own in a second,
with the cases that do not start or stop it:

```python
from barewire.canopen import LocalNode, ObjectDictionary, standard_objects
from barewire_workbench.conform.canopen.battery import prepare, run_case
from barewire_workbench.conform.canopen.probe import probe
from barewire.conversation import play
from barewire_workbench.live.canopen_conformance import cases

device = LocalNode(5, ObjectDictionary(standard_objects()))
device.start(0.0)


def answer(frame, now):
    return [(now + 0.001, reply) for reply in device.feed(frame, now)]


subject, now = play(probe(5), answer)
for case in cases(subject):
    if case.effect != "commands" and not case.lacks:
        booted, now = play(prepare(subject), answer, start=now)
        outcome, now = play(run_case(case), answer, start=now)
        assert outcome.failure is None, outcome.failure
```

`play` does not feed a device at its `deadline`, so it sends nothing by itself; the other cases need a bus that does.

The simulated AZ3 passes all cases for its objects but SDO-47, where it follows its guide: it sends every number in
four bytes.

A LocalNode of the `canopen` library (2.4.1) answers in STOPPED (NMT-02, -03, -04, -06), sends no boot-up message after
a reset (NMT-10, -11, -13, -15), answers a frame with 29 bits like one with 11 (SDO-32), has every sub-index of a
variable (SDO-07, SDO-44), refuses 22h (SDO-46), and answers a block upload with segments although no
switch was allowed (BLK-01 to -05). `tests/interop/canopen/test_canopen_conform.py` runs the battery against it.

### CANopenNode's demo device

1,243 to 1,246 of 1,257 cases passed on 2026-11-22, with `--eds demoDevice.eds --large 2122:00 --save`, against
`demoLinuxDevice` of CANopenDemo 1f16f49 with the CANopenLinux and CANopenNode (v4.0-384-gfbd42d4) that it names. With
its program, which is built elsewhere, this repeats the run on vcan in the guest kernel of the interop tests, in two
minutes:

    python -m tests.interop.canopen.canopennode conform demoLinuxDevice demoDevice.eds --large 2122:00 --save

| cases | clause | what the device does |
|---|---|---|
| NMT-17, RPD-19, TPD-19, SYN-05, STO-03 | CiA 301 7.2.8, reset communication: 1000h to 1FFFh get their power-on \
values | it keeps the values of the moment; only NMT reset node, which ends the program, loads them. One cause, five \
cases |
| NMT-19 | CiA 301 7.2.8, NMT states: PRE-OPERATIONAL follows initialisation, unless 1F80h says otherwise | it starts \
itself (`CO_NMT_STARTUP_TO_OPERATIONAL`) and has no 1F80h |
| EMC-03 | CiA 301 7.5.2, object 1001h: bit 0 is set with every error | an RPDO that is too short sends emergency \
8210h with error register 00h, and 1001h stays 0: it counts this error as informative |
| EMC-10 | CiA 301 7.5.2, object 1014h: with bit 31 the emergency does not exist | it keeps the bit, reads it back \
and sends emergencies: `CO_EM_process` does not look at `producerEnabled` |
| BLK-21 | CiA 301 7.2.4, end of a block upload: the CRC is 0 if one side does not support it | it sends the CRC of \
the block upload before: `block_crc` is not cleared |
| OD-DEFAULT-2121:03 | CiA 306, DefaultValue | ten bytes, of which the EDS names the first three |
| SEG-30, BLK-01 to -03, BLK-17: now and then | CiA 301 7.2.4, abort and end of a transfer | it sends a response \
before it sets its next state, and another thread receives: a client that answers within microseconds, as on vcan, \
gets 05040001 |

Left out are what it does not have: guarding, 1020h, 1029h, 1201h, 1280h, entries of its empty history 1003h, and LSS
identify remote slave.

## Against an EDS

`--eds FILE` adds cases whose names begin with OD-, some for each object of the file, before all others:

```text
$ barewire conform "can://socketcan/can0?node=5" --eds drive.eds --only OD
ok      OD-READ-1000:00  1000h:00 Device type: ro, u32, of 4 bytes
ok      OD-READ-1001:00  1001h:00 Error register: ro, u8, of 1 byte
FAILED  OD-LIMIT-2000:00  2000h:00 speed: refuses less than 10 and more than 1000: after 605#2B002000E9030000: ...
```

| case | effect | the device conforms if |
|---|---|---|
| OD-READ-2000:00 | reads | it can be read and has the length of its DataType; a write-only one is refused |
| OD-SUB-2010 | reads | the sub-indices between and after the described ones do not exist (06090011) |
| OD-TYPE-2000 | reads | sub-index FFh, if there is one, has its ObjectType and DataType |
| OD-ABSENT-1011 | reads | a communication object that the EDS does not have does not exist (06020000) |
| OD-DEFAULT-2000:00 | tries | after a reset it has its DefaultValue, with `$NODEID` |
| OD-ACCESS-2002:00 | tries | a read-only object refuses a write (06010002) |
| OD-WRITE-2000:00 | tries | a writable object accepts the value that it has, and keeps it |
| OD-LENGTH-2000:00 | tries | one byte more and one less are refused (0607001x) |
| OD-LIMIT-2000:00 | tries | values below LowLimit and above HighLimit are refused (0609003x) |
| OD-RPDO-6040:00, OD-TPDO-6040:00 | writes | PDOMapping and AccessType say if it can be mapped (or 06040041) |
| OD-DUMMY-0005 | writes | a data type that [DummyUsage] allows can be mapped into an RPDO |
| OD-RANGE-2000:00 | application | values within its limits are accepted and kept, see [below](#application-objects) |
| RND-05, RND-06 | reads, application | 50 reads and 50 writes of objects from 2000h on are answered in random order |

OD-RPDO and OD-TPDO reset the communication before each object: an EDS of hundreds of objects takes minutes, without
them (`--only OD-READ,OD-SUB,OD-ABSENT,OD-DEFAULT,OD-ACCESS,OD-WRITE,OD-LENGTH,OD-LIMIT`) seconds.

The device is reset (NMT reset node) before, and should have its factory settings: stored values are no defaults.
These are not judged, since good devices differ: the value of a read-only object, except the device type, the identity
without the serial number, and the highest sub-index; writes of 1003h, 1010h and 1011h, of SDO channels and PDOs; the
direction of an object whose AccessType is `rw`, which CiA 306 leaves open; a write that is refused because of the
state of the device (0800002x). Bit 0 of an object's ObjFlags leaves out its writes, bit 1 its reads.

### Application objects

Without `--write-application` the battery writes to an object from 2000h on only the value that it has, or one that it
must refuse. So does CiA's tool, whose random writes stay within 1000h to 1FFFh: another value may start a motor or
switch an output, and no EDS says which value is safe. With it, in PRE-OPERATIONAL, each writable number gets LowLimit,
HighLimit and three values between them; one without both limits its DefaultValue alone, a BOOLEAN 0 and 1. Take the
load off a drive, and disconnect what outputs switch.

The controlword of a drive (6040h; 6840h, 7040h ... of further axes) is never written, since it switches the power stage
on. Bit 0 of ObjFlags leaves out more: an object that is a command and reads otherwise than it was written fails. After
each case the objects have the values that they had, unless the run is interrupted. A refusal because of the state of
the device or of other objects (0800002x, 06040043, 06040047, 06090036) is not a failure.

From Python: `conform_can(endpoint, eds=parse(data))` of `barewire_workbench.live.canopen_conformance`, and in virtual
time `probe(5, objects=eds.objects)` and `cases(subject, eds.objects, eds.dummies)` in the example above.

## The cases

The list for a device that supports everything. *Accepted* explains what is not obvious.
"""


CIA = """\
## The cases of CiA's conformance test tool

The tool that CiA certifies devices with has 127 cases; their names are those of a public log of its version 3.0.3.10
(`test/test_report_CCT.md` of CANopenNode/CANopenDemo). This table names our cases for the same subject, not the same
frames: most of ours accept what that log shows as accepted, and a device that passes here may still fail there.
OD-READ stands for all cases of [an EDS](#against-an-eds) that begin so.
"""


def subject() -> Subject:
    """Return the device of the tests with the objects that only some cases need."""
    return subject_of(plain, LARGE)


def sample_totals() -> dict[str, int]:
    """Return the totals of the command for the simulated AZ3 on socketcand, which carries no remote frames."""
    subject = subject_of(az3)
    left_out = [case for case in cases(subject) if why_left_out(case, False, remote=False)]
    judged = len(cases(subject)) - len(left_out)
    return {"judged": judged, "left_out": len(left_out), "passed": judged - len(failures(bus_with(az3()), subject))}


def page() -> str:
    """Return the whole page."""
    rows = cases(subject())
    lines = [HEAD.format(total=len(rows), **sample_totals())]
    for clause in dict.fromkeys(case.clause for case in rows):
        group = [case for case in rows if case.clause == clause]
        lines += [f"### {clause}", "", "| case | what | effect | accepted |", "|---|---|---|---|"]
        lines += [f"| {case.name} | {case.title} | {case.effect} | {case.why} |" for case in group]
        lines.append("")
    lines += [CIA, *table()]
    return "\n".join(lines).rstrip() + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
