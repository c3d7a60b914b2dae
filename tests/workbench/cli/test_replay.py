"""`barewire replay`: a recording against a device of an EDS or of the catalogue, and wrong usage."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.workbench.cli.helpers import error_of, output_of, run_here

LOG = """\
(10.0) can0 705#00
(10.1) can0 605#4000600000000000
(10.101) can0 585#4B006000D7000000
(10.2) can0 605#2B01600008070000
(10.201) can0 585#6001600000000000
(10.3) can0 605#4001600000000000
(10.301) can0 585#4B01600008070000
"""


OBJECT = "[{index}]\nParameterName={name}\nObjectType=7\nDataType={type}\nAccessType={access}\nDefaultValue={value}\n"


@pytest.fixture
def eds(tmp_path: Path) -> Path:
    """An EDS of a device with a limit that the recorded one does not have."""
    text = OBJECT.format(index="1000", name="device type", type="0x0007", access="ro", value="0")
    text += OBJECT.format(index="1001", name="error register", type="0x0005", access="ro", value="0")
    text += OBJECT.format(index="6000", name="temperature", type="0x0003", access="ro", value="215")
    text += OBJECT.format(index="6001", name="alarm", type="0x0003", access="rw", value="800") + "HighLimit=1500\n"
    path = tmp_path / "thermometer.eds"
    path.write_text(text)
    return path


def test_differences_are_listed_and_decide_the_exit_status(eds: Path, tmp_path: Path) -> None:
    log = tmp_path / "run.log"
    log.write_text(LOG)
    done = run_here("replay", str(log), "--against", str(eds))
    assert (done.returncode, done.stderr) == (1, "")
    first, second, summary = done.stdout.splitlines()
    assert first.startswith("10.201000  DIFFERENT  recorded 585#6001600000000000 (")
    assert "; the device sends 585#8001600031000906 (" in first
    assert first.endswith(
        "; after 605#2B01600008070000 (SDO request to node 5: initiate download, 6001h:00, 2 bytes: 0708h)"
    )
    assert second.startswith("10.301000  DIFFERENT  recorded 585#4B01600008070000 (")
    assert summary == (
        "4 recorded frames of node 5: 2 same, 2 different, 0 missing; 0 extra; the device received 3 frames"
    )
    log.write_text("\n".join(LOG.splitlines()[:3]))
    assert output_of("replay", str(log), "--against", str(eds)).startswith("2 recorded frames of node 5: 2 same")


def test_the_summary_says_what_was_not_played(eds: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("barewire_workbench.replay.peer_replay.STEPS_MAX", 10)
    monkeypatch.setattr("barewire_workbench.cli.replay.STEPS_MAX", 10)
    log = tmp_path / "run.log"
    text = OBJECT.format(index="1017", name="heartbeat", type="0x0006", access="rw", value="1000")
    eds.write_text(f"{eds.read_text()}{text}")
    log.write_text("(1.0) can0 705#00\n(60.0) can0 605#4000100000000000\n(60.1) can0 585#4300100000000000\n")
    summary = run_here("replay", str(log), "--against", str(eds)).stdout.splitlines()[-1]
    cut = "; 1 pause of the recording cut short: the device was due more than 10 times in each"
    assert summary.endswith(f"; 11 extra; the device received 1 frame{cut}")


def test_json_and_all(eds: Path, tmp_path: Path) -> None:
    log = tmp_path / "run.log"
    log.write_text(LOG)
    done = run_here("replay", str(log), "--against", str(eds), "--json", "--all", "--only", "sdo")
    *played, summary = map(json.loads, done.stdout.splitlines())
    assert [one["event"] for one in played] == ["same", "different", "different"]
    assert played[1]["sent"] == "585#8001600031000906"
    assert (played[1]["recorded"], played[1]["request"]) == ("585#6001600000000000", "605#2B01600008070000")
    assert summary == {
        **{
            "event": "summary",
            "node": 5,
            "received": 3,
            "cut_short": 0,
            "same": 1,
            "different": 2,
            "missing": 0,
            "extra": 0,
        },
    }


def test_a_device_of_the_catalogue_and_a_log_without_times(tmp_path: Path) -> None:
    log = tmp_path / "report.md"
    lines = ("000 Tx SD 2 81 05", "705 Rx SD 1 00", "605 Tx SD 8 40 00 10 00 00 00 00 00")
    text = "".join(f"Test CAN\t: CAN1 {line}\n" for line in (*lines, "585 Rx SD 8 43 00 10 00 92 01 02 00"))
    log.write_text(text)
    assert "2 same, 0 different" in output_of("replay", str(log), "--against", "az3")
    log.write_text(text.replace("92 01", "91 01"))
    done = run_here("replay", str(log), "--against", "az3")
    assert done.returncode == 1
    assert done.stdout.startswith("line 4  DIFFERENT  recorded 585#4300100091010200 (")


def test_wrong_usage(eds: Path, tmp_path: Path) -> None:
    log = tmp_path / "run.log"
    log.write_text(LOG)
    against = ("--against", str(eds))
    assert "128 is not in the range 1<=x<=127" in error_of("replay", str(log), *against, "--node", "128", status=2)
    assert "did you mean 'sdo'" in error_of("replay", str(log), *against, "--only", "sod", status=2)
    assert "no frames on it" in error_of("replay", str(log), *against, "--bus", "can1")
    assert "not a recording of CAN" in error_of("replay", str(eds), *against)
    assert "ends in .eds or .dcf" in error_of("replay", str(log), "--against", str(log), status=2)
    done = run_here("replay", str(log), *against, "--node", "9")
    assert "node 9 does not answer in the recording; node 5 does" in done.stderr
    assert "`barewire replay` plays the recording" in error_of("record", str(log), status=2)
    assert "No such file" in error_of("replay", str(tmp_path / "none.log"), *against)
    assert "has no CANopen" in error_of("replay", str(log), "--against", "adxl", status=2)
    (tmp_path / "empty.eds").write_text("")
    assert "there are no objects in it" in error_of("replay", str(log), "--against", str(tmp_path / "empty.eds"))
    log.write_text(LOG + LOG.replace("can0", "can1"))
    assert "select one with --bus" in error_of("replay", str(log), *against, status=2)
    log.write_text("(1.0) can0 080#\n")
    assert "give the node-ID of the device with --node" in error_of("replay", str(log), *against, status=2)


def test_against_our_client(tmp_path: Path) -> None:
    """The recorded client repeats the toggle bit 0; ours sets it to 1."""
    log = tmp_path / "run.log"
    frames = [
        *("605#4008100000000000", "585#4108100009000000", "605#6000000000000000", "585#0074686572736D6F"),
        *("605#6000000000000000", "585#1B65740000000000", "605#4000100000000000", "585#4300100000000000"),
    ]
    log.write_text("".join(f"({10 + n / 10}) can0 {frame}\n" for n, frame in enumerate(frames)))
    done = run_here("replay", str(log), "--against", "client")
    assert (done.returncode, done.stderr) == (1, "")
    first, summary = done.stdout.splitlines()
    assert first.startswith("10.400000  DIFFERENT  recorded 605#6000000000000000 (")
    assert "; the client sends 605#7000000000000000 (" in first
    assert summary == (
        "2 transfers with node 5; 4 recorded requests: 3 same, 1 different, 0 missing; 0 extra; "
        "the client received 4 frames"
    )
    lines = run_here("replay", str(log), "--against", "client", "--json", "--only", "sdo").stdout.splitlines()
    (found, totals) = map(json.loads, lines)
    assert (found["event"], found["sent"], found["request"]) == ("different", "605#7000000000000000", frames[3])
    assert (totals["transfers"], totals["left_out"], totals["received"], totals["different"]) == (2, 0, 4, 1)
    log.write_text("\n".join(f"({n}) can0 {frame}" for n, frame in enumerate(frames[6:])))
    assert output_of("replay", str(log), "--against", "client", "--window", "2").startswith(
        "1 transfer with node 5; 1 "
    )
    for wrong in (("--values",), ("--only", "pdo")):
        assert "--against client compares SDO requests" in error_of(
            "replay", str(log), "--against", "client", *wrong, status=2
        )
