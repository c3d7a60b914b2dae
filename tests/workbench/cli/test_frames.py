"""`--frames`: the frames of a command as they pass, explained."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from barewire.rtu import encode
from barewire.tcp import encode as tcp_frame
from barewire_workbench.cli.shown_frames import ShownFrames
from tests.helpers import free_port, unhex
from tests.workbench.cli.helpers import output_of, run_here, simulated_at

ASKED, ANSWERED = encode(1, unhex("04 0FB1 0002")), encode(1, unhex("04 04 0000 0110"))


def shown(endpoint: str, *passed: tuple[str, bytes]) -> list[str]:
    lines: list[str] = []
    frames = ShownFrames(endpoint, show=lines.append)
    for direction, data in passed:
        frames.watch(direction, data)  # type: ignore[arg-type]
    frames.flush()
    return [" ".join(line.split()) for line in lines]


def test_a_frame_in_pieces_is_one_line() -> None:
    lines = shown("rtu:///dev/x", ("sent", ASKED), ("received", ANSWERED[:3]), ("received", ANSWERED[3:]))
    assert len(lines) == 2
    assert lines[0].startswith("sent 01 04 0F B1 00 02 22 F8 valid: a request to unit 1")
    assert lines[1].startswith("received 01 04 04 00 00 01 10 FB D8 valid: a response from unit 1")


def test_a_damaged_answer_is_shown_when_the_next_request_is_sent() -> None:
    lines = shown("rtu:///dev/x", ("received", ANSWERED[:5]), ("sent", ASKED), ("received", ANSWERED[:4]))
    assert [line.split(" ")[0] for line in lines] == ["received", "sent", "received"]
    assert "not valid" in lines[0]
    assert "not valid" in lines[2]


def test_two_answers_in_one_segment() -> None:
    answer = tcp_frame(1, unhex("83 02"), 7)
    assert len(shown("tcp://x", ("received", answer + answer[:4]), ("received", answer[4:]))) == 2


def test_a_closed_output_does_not_fail_the_port() -> None:
    """A drive that turns has to be stopped over this port."""

    def broken(text: str) -> None:
        raise BrokenPipeError

    frames = ShownFrames("rtu:///dev/x", show=broken)
    frames.watch("sent", ASKED)
    frames.watch("sent", ASKED)


@pytest.mark.long
def test_read_and_write_show_their_frames(tmp_path: Path) -> None:
    with simulated_at("adxl", f"rtu://{tmp_path}/line") as endpoint:
        lines = output_of("read", endpoint, "adxl", "Thyristors temperature", "--frames", "--no-check").splitlines()
        assert [line.split()[0] for line in lines] == ["sent", "received", "Thyristors"]
        lines = output_of("read", endpoint, "adxl", "Thyristors temperature", "--frames").splitlines()
        assert "Report Server ID" in lines[0]  # asked first what it is
        lines = output_of(
            "write", endpoint, "adxl", "Motor start command=1", "--frames", "--json", "--no-check"
        ).splitlines()
        rows = [json.loads(line) for line in lines]
        assert [row.get("direction") for row in rows] == ["sent", "received", None]
        assert all(row["valid"] for row in rows[:2])
        fields = run_here("-v", "read", endpoint, "adxl", "Thyristors temperature", "--frames")
        assert "function code  4             04 Read Input Registers" in fields.stdout


@pytest.mark.long
def test_a_drive_on_can_shows_its_frames_with_names() -> None:
    with simulated_at("az3", f"can://socketcand/127.0.0.1:{free_port()}/can0") as endpoint:
        text = output_of("drive", endpoint, "az3", "status", "--frames")
    assert "valid: SDO request to node 1: initiate upload, 6041h:00 STATUS WORD" in text
    assert "(voltage enabled" in text
