"""`barewire save`, `restore` and `diff`: files, exit statuses, and processes that are killed."""

from __future__ import annotations

import csv
import json
import os
import stat
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from datetime import datetime
from io import StringIO
from pathlib import Path
from typing import Any

import pytest

from barewire import CanopenServer, ModbusServer, connect, load
from barewire.canopen import eds
from barewire.canopen.datatypes import TimeDifference, TimeOfDay
from barewire.codecs import Value
from barewire.devices.sim import simulator
from barewire.errors import PortError
from barewire.io.machine import MachineClient
from barewire_workbench.cli.arguments import load_device
from barewire_workbench.cli.output import replace_file
from barewire_workbench.eds.export import export
from barewire_workbench.settings.rules import SettingRules
from barewire_workbench.settings.saved import SavedSettings
from tests.helpers import part_or_whole
from tests.workbench.cli.helpers import error_of, output_of, run_here
from tests.workbench.eds.described import described

KILLED = Path(__file__).parent / "killed.py"


@pytest.fixture(autouse=True)
def no_pause(monkeypatch: pytest.MonkeyPatch) -> None:
    """The CSD MT takes five seconds to store."""
    rules = SettingRules.of
    monkeypatch.setattr(SettingRules, "of", lambda device: rules(device)._replace(store_takes=0.0))


@pytest.fixture
def drive() -> Iterator[str]:
    """The URL of a CSD MT with some settings changed."""
    machine: Any = simulator("csd-mt")
    machine.store["Current Ratio"] = 55
    machine.store["Homing Method"] = 35
    with ModbusServer("tcp://127.0.0.1:0", {1: machine.modbus}) as server:
        yield f"{server.url}?timeout=30"


@pytest.fixture
def fresh() -> Iterator[str]:
    """The URL of a CSD MT as delivered."""
    unit = simulator("csd-mt").modbus
    assert unit is not None
    with ModbusServer("tcp://127.0.0.1:0", {1: unit}) as server:
        yield f"{server.url}?timeout=30"


def test_a_drive_is_saved_swapped_and_restored(drive: str, fresh: str, tmp_path: Path) -> None:
    file = str(tmp_path / "press.toml")
    assert output_of("save", drive, "csd-mt", file) == f"{file}: 61 settings of {load('csd-mt').title}\n"
    compared = run_here("diff", file, fresh)
    assert compared.returncode == 1
    assert [line.split() for line in compared.stdout.splitlines()] == [
        [file, fresh],
        ["Current", "Ratio", "55", "%", "70", "%"],
        ["Homing", "Method", "35", "0"],
    ]
    planned = output_of("restore", file, fresh, "--dry-run")
    assert planned.splitlines()[0] == "Current Ratio = 55 % (was 70 %), would be written"
    assert run_here("diff", file, fresh).returncode == 1
    written = output_of("restore", file, fresh)
    assert "2 settings written, 46 equal already; stored, but for 27 that the device does not keep" in written
    assert output_of("diff", file, fresh) == ""
    assert output_of("diff", drive, fresh, "--device", "csd-mt") == ""


def test_a_file_has_device_identity_time_and_one_line_for_each_setting(drive: str) -> None:
    text = output_of("save", drive, "csd-mt", "-")
    saved = SavedSettings.parse(text.encode(), "-")
    assert (saved.device, saved.source, saved.identity["Software Version"]) == ("csd-mt", drive, "31")
    assert saved.time is not None
    assert saved.time.utcoffset() is not None
    assert '"Current Ratio" = { value = 55, unit = "%", address = "holding 1080" }' in text.splitlines()
    assert '"Control Word" =' not in text


def test_a_dry_run_shows_the_frames(drive: str, fresh: str, tmp_path: Path) -> None:
    file = str(tmp_path / "press.toml")
    output_of("save", drive, "csd-mt", file)
    shown = output_of("restore", file, fresh, "--dry-run", "--frames")
    frames = [line for line in shown.splitlines() if line.startswith("would send")]
    assert len(frames) == 2
    assert "06 04 38 00 37" in frames[0]


def test_differences_as_json_and_csv(drive: str, fresh: str) -> None:
    both = (drive, fresh, "--device", "csd-mt")
    objects = [json.loads(line) for line in run_here("diff", *both, "--json").stdout.splitlines()]
    assert objects[0] == {"name": "Current Ratio", "a": 55, "a_unit": "%", "b": 70, "b_unit": "%", "error": ""}
    rows = list(csv.DictReader(StringIO(run_here("diff", *both, "--csv").stdout)))
    assert [row["name"] for row in rows] == ["Current Ratio", "Homing Method"]
    assert "--csv and --json" in error_of("diff", *both, "--csv", "--json", status=2)


def test_what_is_not_read_is_in_a_new_file_and_takes_no_old_one_away(tmp_path: Path) -> None:
    file = tmp_path / "press.toml"
    unit = simulator("csd-mt").modbus
    assert unit is not None
    with ModbusServer("tcp://127.0.0.1:0", {1: unit}, faults="exception=04@1080") as server:
        done = run_here("save", server.url, "csd-mt", str(file))
        assert (done.returncode, "60 settings of" in done.stdout, ", 1 not read" in done.stdout) == (1, True, True)
        assert done.stderr.startswith("barewire: Current Ratio: not read: unit 1, address 1080: exception 04")
        assert "exception 04" in SavedSettings.parse(file.read_bytes(), "file").not_read["Current Ratio"]
        file.write_text("old", encoding="utf-8")
        assert "is kept as it is; see --partial" in run_here("save", server.url, "csd-mt", str(file)).stderr
        assert file.read_text(encoding="utf-8") == "old"
        assert run_here("save", server.url, "csd-mt", str(file), "--partial").returncode == 1
        compared = run_here("diff", str(file), server.url)
        assert compared.returncode == 2
        assert "Current Ratio" in compared.stdout


def test_a_failure_says_what_was_not_written_and_how_to_go_on(drive: str, tmp_path: Path) -> None:
    file = tmp_path / "press 1.toml"
    output_of("save", drive, "csd-mt", str(file))
    file.write_text(
        file.read_text(encoding="utf-8").replace(
            '"Counter Watchdog" = { value = 0', '"Counter Watchdog" = { value = 50'
        ),
        encoding="utf-8",
    )
    done = run_here("restore", str(file), drive)
    assert done.returncode == 1
    assert "Counter Watchdog = 50 ms (was 0 ms (off)): not written: unit 1, address 1097: exception 03" in done.stdout
    assert "0 settings written, 47 equal already, 1 not written; not stored" in done.stdout
    assert done.stderr == f"barewire: to go on: barewire restore '{file}' '{drive}'\n"


def test_an_interrupted_restore_says_what_was_written_and_how_to_go_on(
    drive: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "press.toml"
    output_of("save", drive, "csd-mt", str(file))
    output_of("write", drive, "csd-mt", "Current Ratio=50", "Homing Method=17")
    write, written = MachineClient.write, list[object]()

    def interrupted(machine: MachineClient, *values: Any, **options: Any) -> None:
        if written:
            raise KeyboardInterrupt
        written.append(values)
        write(machine, *values, **options)

    monkeypatch.setattr(MachineClient, "write", interrupted)
    done = run_here("restore", str(file), drive)
    assert (done.returncode, done.stdout.count(" written\n")) == (130, 1)
    lost = "not stored: what was written is lost when the device is switched off"
    go_on = f"to go on: barewire restore {file} '{drive}'"
    assert done.stderr.strip() == f"barewire: interrupted; 1 written; {lost}; {go_on}"


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["save", "{url}", "raw", "-"], 2, "raw has no settings on Modbus"),
        (["save", "{url}", "csd-mt", "press.dcf"], 2, "a DCF is made of an EDS"),
        (["save", "{url}", "adxl", "-"], 1, "is not adxl"),
        (["restore", "{file}", "{url}", "--device", "az3"], 2, "not for az3 here: Mode of Operation: az3 has no such"),
        (["restore", "{moved}", "{url}"], 2, "names it; --device names another description"),
        (["restore", "nothing.toml", "{url}"], 1, "nothing.toml: No such file"),
        (["diff", "{url}", "{url}"], 2, "no file says which device it is: expected --device"),
        (["diff", "{file}", "nothing.toml"], 2, "nothing.toml: No such file"),
        (["diff", "{file}", "{broken}"], 2, "no TOML"),
        (["restore", "{broken}", "{url}"], 1, "no TOML"),
        (["save", "{url}", "drive.eds", "-"], 1, "drive.eds: No such file"),
    ],
)
def test_wrong_arguments_are_one_line(
    arguments: list[str], status: int, message: str, drive: str, tmp_path: Path
) -> None:
    file, broken, moved = (tmp_path / f"{name}.toml" for name in ("press", "broken", "moved"))
    output_of("save", drive, "csd-mt", str(file))
    broken.write_text("[", encoding="utf-8")
    moved.write_text(SavedSettings("plant/pump").text(), encoding="utf-8")
    given = [argument.format(url=drive, file=file, broken=broken, moved=moved) for argument in arguments]
    assert message in error_of(*given, status=status)


def test_the_file_of_another_model_is_refused_and_says_what_goes_on(drive: str, fresh: str, tmp_path: Path) -> None:
    file = tmp_path / "press.toml"
    text = output_of("save", drive, "csd-mt", "-")
    assert '"Product Code" = "148"' in text
    file.write_text(text.replace('"Product Code" = "148"', '"Product Code" = "149"'), encoding="utf-8")
    refusal = error_of("restore", str(file), fresh)
    assert "another model: its Product Code is 148, the file is of 149" in refusal
    assert refusal.endswith("; nothing was written; --no-check goes on\n")
    assert "2 settings written" in output_of("restore", str(file), fresh, "--no-check")
    refusal = error_of("restore", str(file), fresh, "--no-check", "--device", "az3")
    assert refusal == "barewire: there is no setting to write in the file: expected names below [settings]\n"


@pytest.mark.parametrize("ends", part_or_whole(("dcf",), ("dcf", "toml")))
def test_a_dcf_out_of_a_node_and_into_it(ends: tuple[str, ...], tmp_path: Path) -> None:
    """Settings without a DCF, and their comparison with one, are in the whole: `restore` reads both in one way."""
    file, dcf, toml = tmp_path / "az3.eds", tmp_path / "left.dcf", tmp_path / "left.toml"
    file.write_bytes(export(load("az3")).encode())
    url = "can://memory/keep-dcf?node=5"
    with CanopenServer(url, eds=eds.parse(file.read_bytes())):
        for saved in (tmp_path / f"left.{end}" for end in ends):
            output_of("save", url, str(file), str(saved))
            assert output_of("diff", str(saved), url) == ""
            text = saved.read_text(encoding="utf-8")
            before, after = text.split("PROFILE ACCELERATION", 1)
            after = after.replace("ParameterValue=1000", "ParameterValue=1500", 1).replace("= 1500,", "= 2500,", 1)
            saved.write_text(f"{before}PROFILE ACCELERATION{after}", encoding="utf-8")
            assert run_here("diff", str(saved), url).returncode == 1
            assert "PROFILE ACCELERATION" in output_of("restore", str(saved), url, "--dry-run")
            assert "written" in output_of("restore", str(saved), url, "--no-store")
            assert output_of("diff", str(saved), url) == ""
        if "toml" in ends:
            compared = run_here("diff", str(dcf), str(toml))
            assert compared.returncode == 1
            assert compared.stdout.splitlines()[1].split()[-2:] == ["1500", "2500"]
    with CanopenServer("can://memory/keep-dcf?node=9", eds=eds.parse(file.read_bytes())):
        node_9 = "can://memory/keep-dcf?node=9"
        assert "written" in output_of("restore", str(dcf), node_9, "--no-store")
        assert output_of("diff", str(dcf), node_9) == ""  # its COB-IDs are those of node 9


def test_a_dcf_by_our_own_eds_has_no_measurement_and_no_command(tmp_path: Path) -> None:
    file, dcf = tmp_path / "az3.eds", tmp_path / "left.dcf"
    file.write_bytes(export(load("az3")).encode())
    with CanopenServer("can://memory/keep-moved?node=5", device="az3") as server, connect("az3", server.url) as drive:
        output_of("save", server.url, str(file), str(dcf))
        saved = eds.parse(dcf.read_bytes())
        measured_or_command = ("CUSTOM POSITION ACTUAL VALUE", "COIL WORD 0", "COIL WORD 5", "TARGET VELOCITY")
        places = [drive.device.find(name).object for name in measured_or_command]
        assert [saved.get(f"{place.index:04X}", "ParameterValue") for place in places if place] == [None] * 4
        drive.write("PROFILE VELOCITY", 77)
        assert "node 5: 1 value written" in output_of("restore", str(dcf), server.url, "--no-store")


def test_a_control_word_in_a_dcf_is_left_out_and_a_drive_that_is_enabled_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "left.dcf"
    url = "can://memory/keep-control?node=5"
    document = export(load("az3"))
    document.set(0x6040, 0, "ParameterValue", 15)
    document.set(0x6081, 0, "ParameterValue", 777)
    file.write_bytes(document.encode())
    with CanopenServer(url, device="az3"), connect("az3", url) as drive:
        drive.write("CONTROL WORD", 6)
        drive.write("CONTROL WORD", 7)
        assert "left out: " in output_of("restore", str(file), url, "--no-store")
        assert (drive.read("PROFILE VELOCITY").value, int(drive.read("STATUS WORD")) & 0x6F) == (777, 0x23)
        drive.write("CONTROL WORD", 15)
        assert "the drive is in OPERATION ENABLED" in error_of("restore", str(file), url, "--no-store", status=1)


def test_a_damaged_dcf_is_not_equal_to_a_device(tmp_path: Path) -> None:
    """A value that cannot be read is refused as by `restore`; a file that was cut says so."""
    file = tmp_path / "left.dcf"
    url = "can://memory/keep-damaged?node=5"
    document = export(load("az3"))
    document.set(0x6081, 0, "ParameterValue", 777)
    whole = document.encode()
    with CanopenServer(url, device="az3"):
        for damaged in (b"77x", b"9999999999"):
            file.write_bytes(whole.replace(b"ParameterValue=777", b"ParameterValue=" + damaged))
            for words in (("diff", str(file), url), ("restore", str(file), url)):
                error = error_of(*words, status=2)
                assert "[6081] ParameterValue = " + damaged.decode() in error, words
                assert str(file) in error, words
        file.write_bytes(whole[: whole.index(b"ParameterValue=777") + 19])
        for cut in (("diff", str(file), url), ("restore", str(file), url, "--dry-run")):
            note = run_here(*cut).stderr
            assert note.startswith(f"barewire: {file}: line "), cut
            assert note.endswith(" more: is the file whole?\n"), cut


MOMENT = TimeOfDay.of(datetime(2026, 6, 28, 14, 3, 11))
ALL_TYPES: dict[str, tuple[int, Value, Value]] = {
    "Time": (0x0C, MOMENT, TimeOfDay(MOMENT + 1)),
    "Span": (0x0D, TimeDifference(90_000), TimeDifference(0)),
    "Bool": (0x01, True, False),
    "I8": (0x02, -5, 5),
    "U24": (0x16, 100_000, 0),
    "U64": (0x1B, 2**64 - 1, 2**64 - 2),
    "F32": (0x08, 0.2, 0.3),
    "F64": (0x11, 300000.125, 300000.12),
    "Text": (0x09, "Hall 4", ""),
    "Unicode": (0x0B, "Hall 5", "x"),
    "Octets": (0x0A, b"\x01\xab", b"\2"),
}
"""The code of a type, a value of it, and another one."""


@contextmanager
def two_devices(
    path: Path, types: Mapping[str, tuple[int, Value, Value]] = ALL_TYPES
) -> Iterator[tuple[str, str, str]]:
    """Serve two devices with a setting of each type; yield the EDS and both URLs. The second has the other values."""
    file = path / "device.eds"
    objects = [f"{0x2000 + number:X} {name} {code} rw" for number, (name, (code, *_)) in enumerate(types.items())]
    objects += ["3000 key 10 ro DefaultValue=01AB"]
    file.write_bytes(described(*objects).encode())
    bus = f"can://memory/keep-{path.name}"
    urls = [f"{bus}?node={node}" for node in (5, 6)]
    with ExitStack() as stack:
        for number, url in enumerate(urls):
            stack.enter_context(CanopenServer(url, eds=eds.parse(file.read_bytes())))
            with connect(load_device(str(file), url), url) as client:
                for name, (_, *values) in types.items():
                    client.write(name, values[number])
        yield str(file), urls[0], urls[1]


def test_a_time_is_saved_as_a_number_that_is_read_again(tmp_path: Path) -> None:
    file = tmp_path / "left.toml"
    with two_devices(tmp_path) as (device, first, second):
        output_of("save", first, device, str(file))
        assert SavedSettings.parse(file.read_bytes(), "file").settings["Span"].value == 90_000
        assert output_of("diff", str(file), first) == ""
        rows = list(csv.DictReader(StringIO(run_here("diff", str(file), second, "--csv").stdout)))
        assert [(row["a"], row["b"]) for row in rows[:2]] == [(str(int(MOMENT)), str(MOMENT + 1)), ("90000", "0")]


@pytest.mark.parametrize("end", ["toml", "dcf"])
def test_a_setting_of_each_type_is_saved_compared_and_restored(end: str, tmp_path: Path) -> None:
    file = str(tmp_path / f"left.{end}")
    with two_devices(tmp_path) as (device, first, second):
        output_of("save", first, device, file)
        assert output_of("diff", file, first) == ""
        if end == "dcf":
            assert "the DCF has" not in output_of("read", first, file, *ALL_TYPES)
        assert len(run_here("diff", file, second).stdout.splitlines()) == 1 + len(ALL_TYPES)
        assert all(map(json.loads, output_of("restore", file, second, "--dry-run", "--json").splitlines()))
        assert all(map(json.loads, output_of("devices", device, "--json").splitlines()))
        planned = output_of("restore", file, second, "--dry-run")
        assert [name for name in ALL_TYPES if name not in planned] == []
        assert f"{len(ALL_TYPES)} " in output_of("restore", file, second, "--no-store")
        assert output_of("diff", file, second) == ""


def test_a_dcf_of_some_settings_is_compared_with_those_of_any_other_side(tmp_path: Path) -> None:
    dcf, toml = tmp_path / "part.dcf", str(tmp_path / "full.toml")
    with two_devices(tmp_path, {"Speed": (0x06, 1, 2), "Mode": (0x06, 3, 3)}) as (device, first, second):
        part = eds.to_dcf(eds.parse(Path(device).read_bytes()), 6, {"Speed": 1})
        dcf.write_bytes(part.encode())
        for url, status in ((first, 0), (second, 1)):
            output_of("save", url, device, toml)
            for sides in ((str(dcf), toml), (toml, str(dcf)), (str(dcf), url)):
                done = run_here("diff", *sides, "--no-check")
                assert (done.returncode, done.stdout.count("\n")) == (status, 2 * status), done.stdout
            assert output_of("read", url.replace("can:", "CAN:"), device, "Speed") == f"Speed = {1 + status}\n"


def test_half_a_character_ends_neither_save_nor_a_log(tmp_path: Path) -> None:
    half = bytes.fromhex("410000D84200").decode("utf-16-le", "surrogatepass")
    types: dict[str, tuple[int, Value, Value]] = {"Speed": (0x06, 1, 2), "Name": (0x0B, half, "x")}
    with two_devices(tmp_path, types) as (device, url, _):
        for end in ("toml", "dcf"):
            done = run_here("save", url, device, str(tmp_path / f"left.{end}"))
            assert done.returncode == 1, done.stderr
            assert "barewire: Name: not read: its text has half a character" in done.stderr
            assert done.stdout.endswith(", 1 not read\n")
        for log in ("left.csv", "left.db"):
            output_of("watch", url, device, "Name", "--count", "1", "--to", str(tmp_path / log))
        assert ",A?B," in (tmp_path / "left.csv").read_text(encoding="utf-8")
        assert json.loads(output_of("read", url, device, "Name", "--json"))["value"] == "A?B"


def test_a_file_that_could_not_be_read_again_takes_no_old_one_away(
    drive: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "press.toml"
    file.write_text("old", encoding="utf-8")
    monkeypatch.setattr(SavedSettings, "text", lambda saved: "format = 1 =")
    assert "press.toml: no TOML" in error_of("save", drive, "csd-mt", str(file))
    assert file.read_text(encoding="utf-8") == "old"


# The file


def test_a_file_keeps_its_mode_and_what_links_to_it(tmp_path: Path) -> None:
    file, link = tmp_path / "file", tmp_path / "link"
    file.write_text("old", encoding="utf-8")
    file.chmod(0o640)
    link.symlink_to(file)
    replace_file(link, b"new")
    assert (link.is_symlink(), file.read_bytes(), stat.S_IMODE(file.stat().st_mode)) == (True, b"new", 0o640)
    replace_file(tmp_path / "made", b"new")
    mask = os.umask(0)
    os.umask(mask)
    assert stat.S_IMODE((tmp_path / "made").stat().st_mode) == 0o666 & ~mask
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "link", "made"]


def test_a_file_that_cannot_be_written_is_one_error_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(PortError, match="nowhere/file: No such file"):
        replace_file(tmp_path / "nowhere" / "file", b"")
    file = tmp_path / "file"
    file.write_text("old", encoding="utf-8")

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(PortError, match="No space left on device"):
        replace_file(file, b"new")
    assert [(path.name, path.read_text(encoding="utf-8")) for path in tmp_path.iterdir()] == [("file", "old")]


def killed(*arguments: str) -> int:
    done = subprocess.run(
        [sys.executable, str(KILLED), *arguments], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    return int(done.stdout)


@pytest.mark.long
def test_killed_at_a_hundred_moments_a_file_is_the_old_one_or_the_new_one(tmp_path: Path) -> None:
    assert killed(str(tmp_path)) == 100


@pytest.mark.long
def test_a_save_that_is_killed_at_a_hundred_moments_leaves_a_whole_file(drive: str, tmp_path: Path) -> None:
    assert killed(str(tmp_path), drive, "csd-mt") == 100
