"""The steps of control and status words agree with the tables that the package drives by."""

from __future__ import annotations

import pytest

from barewire.devices import State, load, state_of
from barewire.devices.cia402 import after, command_of
from barewire.errors import DecodeError, EncodeError
from barewire_workbench.steps import Steps, control_word_steps, parse_word, status_word_steps

OTHER_BITS = (0, 0x0210, 0xFF80)


def marked(steps: Steps, caption: str) -> list[str]:
    table = next(table for table in steps.tables if table.caption.startswith(caption))
    return [row[0] for row in table.rows if row[-1] == "<--"]


def test_every_status_word_is_in_the_state_of_the_package() -> None:
    for low in range(0x80):
        for others in OTHER_BITS:
            word = low | others
            steps = status_word_steps(word)
            try:
                expected = [state_of(word).value]
            except DecodeError:
                expected = []
            assert marked(steps, "The state is in bits") == expected
            assert steps.values["state"] == (expected[0] if expected else None)


def test_every_control_word_is_the_command_of_the_package() -> None:
    for low in range(0x100):
        for previous in (0, 0x80):
            word = low | 0x100
            steps = control_word_steps(word, previous)
            command = command_of(word, previous)
            expected = [] if command is None else [command.name.lower().replace("_", " ")]
            assert marked(steps, "The command is in bits") == expected
            assert steps.values["command"] == (expected[0] if expected else None)


def test_the_states_after_a_control_word() -> None:
    for word in (0, 2, 6, 7, 0xF, 0x80):
        steps = control_word_steps(word)
        table = next(table for table in steps.tables if table.caption.startswith("What it does"))
        for state, row in zip(State, table.rows):
            target = after(state, word)
            assert row[0] == state.value
            assert row[2] == ("stays" if target is state else target.value)
            assert bool(row[1]) == (target is not state)
    table = next(table for table in control_word_steps(0xF).tables if table.caption.startswith("What it does"))
    assert table.rows[2] == ("ready to switch on", "3, 4", "operation enabled")


def test_a_drive_that_stays_in_its_quick_stop_has_transition_16() -> None:
    found = {}
    for name in ("az3", "csd-mt"):
        device = load(name)
        assert device.drive is not None
        table = next(
            table for table in control_word_steps(0xF, device=device).tables if table.caption.startswith("What it does")
        )
        found[device.drive.stays_in_quick_stop] = table.rows[5]
    for stays, row in found.items():
        expected = ("16", "operation enabled") if stays else ("", "stays")
        assert row[1:] == expected


def test_the_way_to_an_enabled_drive() -> None:
    def way(word: int) -> str:
        return str(status_word_steps(word).sections[2])

    assert way(0x0240).endswith("0006h, 0007h, 000Fh.")
    assert way(0x0218).endswith("0080h, 0006h, 0007h, 000Fh.")
    assert way(0x0233).endswith(": 000Fh.")
    assert "follows its target" in way(0x0637)
    assert "by itself" in way(0x000F)
    assert "No row fits" in way(0x0001)


def test_fault_reset_is_an_edge() -> None:
    assert "0080h is the command fault reset" in control_word_steps(0x80).result
    again = control_word_steps(0x80, 0x80)
    assert again.result == "0080h is no command"
    assert any("there is no edge" in str(section) for section in again.sections)


def test_the_names_of_a_device() -> None:
    bits = {row[0]: row[2] for row in status_word_steps(0x637, load("csd-mt")).tables[0].rows}
    assert bits["12"].startswith("set point acknowledge")
    assert {row[0]: row[2] for row in control_word_steps(0, device=load("az3")).tables[0].rows}[
        "4"
    ] == "(mode specific)"
    with pytest.raises(EncodeError, match="adxl is not a drive"):
        status_word_steps(0, load("adxl"))


def test_without_a_word_all_commands_and_transitions() -> None:
    steps = control_word_steps()
    assert [row[0] for row in steps.tables[1].rows][-1] == "fault reset"
    assert len(steps.tables[2].rows) == 18
    assert steps.values == {}


def test_words_of_16_bits_only() -> None:
    assert [parse_word(text, "word") for text in ("0637h", "0x637", "637", "F")] == [0x637, 0x637, 0x637, 15]
    for text in ("", "12345", "0637g", "-1", "0x"):
        with pytest.raises(EncodeError, match="expected up to 4 hexadecimal digits"):
            parse_word(text, "status word")
    for word in (-1, 0x10000):
        with pytest.raises(EncodeError, match=r"expected 0\.\.FFFFh"):
            status_word_steps(word)
        with pytest.raises(EncodeError, match=r"expected 0\.\.FFFFh"):
            control_word_steps(word)
        with pytest.raises(EncodeError, match=r"expected 0\.\.FFFFh"):
            control_word_steps(0, word)
