"""Texts without bytes: what their words state, and how the program that wrote them logs its bytes."""

from __future__ import annotations

import pytest

from barewire_workbench.diagnosis.texts import limited_to_the_frames, verdict_of_words, verdict_without_bytes
from barewire_workbench.diagnosis.verdict import LineVerdict
from tests.helpers import every_case


def sentence_of(text: str) -> str:
    """The verdict on a text without bytes, in words."""
    verdict = verdict_without_bytes(text)
    assert verdict is not None
    return verdict.sentence


@every_case(
    ("text", "states", "program"),
    [
        ("Modbus Error: [Input/Output] No Response received from the remote unit", "no answer came", "pymodbus"),
        ("Connection to (10.0.0.1, 502) failed: [Errno 111] Connection refused\npymodbus", "is refused", "pymodbus"),
        ("[homeassistant.components.modbus] Exception Response(131, 3, SlaveBusy)", "exception 06", "Home Assistant"),
        ("Modbus exception 2: Illegal data address", "exception 02", "modbus-serial"),
        ("Error: Data length error, expected 7 got 9", "another length", "modbus-serial"),
        ("NoResponseError: No communication with the instrument (no answer)", "no answer came", "instrument.debug"),
        ("ERROR Connection timed out: select", "a time-out", "modbus_set_debug"),
        ("canopen.sdo.exceptions.SdoAbortedError: Code 0x06020000", "abort 06020000", "candump"),
        ("write: No buffer space available", "the send queue of the interface is full", "candump"),
        ("[08:24:49][W][modbus:126]: Modbus CRC Check failed! C071!=00", "a checksum did not fit", "direction: BOTH"),
        (
            "response transaction id '82' does not match request '83' error",
            "number of the request before, so late by one",
            "bytes",
        ),
        ("it failed", "no message that is known", "tcpdump"),
        ("modbus-client received data: the request failed\nat jsmodbus/src/modbus-client.js", "no message", "DEBUG=*"),
        ("Failed to get data of the meter", "no message that is known", "tcpdump"),
        ("could not open port '/dev/ttyUSB0': [Errno 13] Permission denied", "denies the access", "sniff"),
        ("no sdo response recieved", "no answer came", "candump"),
        ("can0: bus-off", "left the bus", "candump"),
        ("TWAI: A (Bit, Stuff, CRC, Form, ACK) error has occurred", "counts errors in frames", "candump"),
        ("can state ERROR-WARNING (berr-counter tx 0 rx 96) restart-ms 0", "counts errors in frames", "candump"),
        ("canopen.sdo.exceptions.SdoCommunicationError: Unexpected response 0x80", "an SDO abort came", "candump"),
    ],
)
def test_the_verdict_says_what_the_words_state_and_how_to_get_the_bytes(text: str, states: str, program: str) -> None:
    verdict = verdict_without_bytes(text)
    assert verdict is not None
    assert verdict.code == "no-bytes"
    assert states in verdict.sentence
    assert program in verdict.sentence


def test_a_can_controller_without_errors_counts_none() -> None:
    sentence = sentence_of("no frames: can state ERROR-ACTIVE (berr-counter tx 0 rx 0) restart-ms 100")
    assert "counts errors" not in sentence


@pytest.mark.parametrize("text", ["a shopping list", "01 03 00 0G", "", "12.5", "abc\0def: it failed"])
def test_what_is_no_message_has_no_verdict(text: str) -> None:
    assert verdict_without_bytes(text) is None


@pytest.mark.parametrize(
    ("text", "states", "program"),
    [
        ("Two nodes with CAN bus shields. CAN.read() never returns anything.", "no message that is known", "candump"),
        (
            "My RS485 adapter works with a PC, but I can't get it to work with this board",
            "no message that is known",
            "sniff",
        ),
        ("the CANopen drive stops after the first PDO", "no message that is known", "candump"),
        ("modbus register 12 is always 0", "no message that is known", "sniff"),
    ],
)
def test_words_of_the_field_and_of_a_failure_are_a_message(text: str, states: str, program: str) -> None:
    sentence = sentence_of(text)
    assert states in sentence
    assert program in sentence


@every_case(
    "text",
    [
        "After a write there is no answer, if my inverter is busy with Modbus",
        "Modbus works in one program, and in mine it stops: how do I set the timeout of the slave?",
        "# bus-off after a reset\nWhy does it stop? The CAN bus works with another adapter",
        "with code: modbus fails\nthrow new Error('no response');\n    at Timeout._onTimeout (index.js:3)",
        "I refused to use RTU with this Modbus meter, since it always fails",
        "modbus fails: at listOnTimeout (node:internal/timers:559:17)\n at Timeout._onTimeout (index.js:3)",
        "client = ModbusSerialClient(timeout=5)  # modbus fails",
        '{"modbus": {"timeout": 5000}} and it fails',
        "the meter fails: it wants RTU frames over TCP, without CRC it never works with Modbus",
        "the slave does not check the checksum of Modbus and gets stuck",
        "`send()` of socketcan fails with the timeout not being reached",
        "the CAN bus fails before the timeout",
        "D (1824) MB_PORT_COMMON: vTimersRespondTimeoutEnable Respond enable timeout.",
        'socketcan fails\n  File "bus.py", line 20, in receive\n    self.wait_for(frame, _WAIT_TIMEOUT)',
        "pymodbus: Changing transaction state from 'SENDING' to 'WAITING FOR REPLY', then it fails",
    ],
)
def test_settings_code_and_what_people_write_are_no_messages(text: str) -> None:
    sentence = sentence_of(text)
    assert "no message that is known here" in sentence


def test_the_words_are_shown_with_their_line() -> None:
    sentence = sentence_of("I try to read my meter.\nIt prints\nModbus Error: No Response received")
    assert '"No Response" (line 3): no answer came in time' in sentence


@pytest.mark.parametrize(
    "text",
    ["I can't find the bus stop", "the can opener never works", "it is always raining", "a cereal bar, canned peas"],
)
def test_a_failure_outside_the_field_is_no_message(text: str) -> None:
    assert verdict_without_bytes(text) is None


def test_bytes_without_a_word_about_a_failure_are_a_recording_that_is_wrong() -> None:
    assert verdict_without_bytes("frame: 01 03 9c 41 00 02 ba 4f") is None


@pytest.mark.parametrize(
    ("text", "states"),
    [
        (
            "ERROR: Acknowledgement Error Detected, ERROR-PASSIVE",
            'no other node acknowledged it; "ERROR-PASSIVE" (line 1): the CAN controller is error passive',
        ),
        ("mcp2515: bit stuffing errors", "a frame broke the rules of bit stuffing or form"),
        ("Get:06:2101:01: Data type does not match (06070010)", "abort 06070010"),
        ("abort 1a01#2: Object cannot be mapped to the PDO.", "abort 06040041"),
        (
            "Emergency message from node 0x02: errorCode=0x8130",
            "emergency 8130h (life guarding or heartbeat error)",
        ),
        ("mbpoll: slave address out of range (800)", "unit 800 is asked, which is none"),
        (
            "Data length error, expected 261 got 5",
            '5 bytes came where 261 were expected: the length of a refusal; "expected 261 got 5"',
        ),
        ("sdo request: no response", "no answer came in time [no-bytes]: no frame is read in this text"),
        ("Result: EX_ILLEGAL_ADDRESS", "exception 02 (illegal data address)"),
        ("modbus exception 02", "exception 02 (illegal data address)"),
        ("Unexpected start address in response. Expected 262, received 5.", "no message that is known"),
        ("MB_MASTER_SERIAL: uart parity error.", "the UART reports an error of parity or framing, or a break"),
        ("-- Polling slave 255... Assertion `ctx->slave != -1' failed", "none: 1 to 247 are; 248 to 255 are reserved"),
        ("I receive `[Errno 105] No buffer space`", "the send queue of the interface is full"),
        ("Transfer aborted by client with code 0x05040000", "SDO abort 05040000 (0504 0000h SDO protocol timed out)"),
        ("checksum error: received 0, calculated 0", "the checksum received and the one calculated are equal"),
        ("response transaction id '1' does not match request '167'", "transaction 1 answers, and 167 was asked"),
        ("modbus.read_holding_registers(57357,1) [65535]", "65535 is FFFFh, which many devices send for a value"),
        ("result: E2", "no message that is known"),
        ("modbus: exception 2", "exception 02 (illegal data address) of Modbus: a device answers, and refuses"),
        (
            "modbus exception 0x0B",
            "(gateway target device failed to respond) of Modbus: a gateway answers for the device",
        ),
        ('while reading, the master prints "Illegal Data Value" of Modbus', "exception 03"),
        ("Unexpected response from modbus device slave 3 register 7, got 0x 2", "a device answers with a value"),
        (
            "qdisc pfifo_fast state UP qlen 10\ncan state ERROR-ACTIVE",
            "the send queue of the interface holds 10 frames",
        ),
        ("can state ERROR-ACTIVE, no buffer space", "the CAN controller is error active: its error counters are low"),
        ("the E2 terminal never gets a modbus frame", "no message that is known"),
        ("modbus: the ports 1 to 65535 fail", "no message that is known"),
        ("Failed: slave not connected; D (884) MB_PORT_COMMON: x", "if that is set already, of TCP by tcpdump"),
    ],
)
def test_a_message_means_what_its_words_say_and_no_cause_is_guessed(text: str, states: str) -> None:
    sentence = sentence_of(text)
    assert states in sentence


@every_case(
    ("text", "states"),
    [
        ("the frame is `80 00 00 00 00 00 04 05`, why?", "an SDO message of either side: abort, 0000h:00, 0504 0000h"),
        (
            "I see\n40 0C 50 00 00 00 00 00\n4F 0C 50 00 00 2E 30 2E",
            "1 byte: 00h; the unused bytes 2E 30 2E are ignored",
        ),
        ("it is <0x07><0x7A><0x42><0x9B>, and should be 77.514603", "CDAB 77.5146; ABCD 1.88275e-34"),
        ("the float is read as [0, 16320, 0, 16448]", "CDAB 1.5, 3"),
        ("Sent data is actually 01 ff ff ff 7f here", "01 FF FF FF 7F; no message that is known"),
    ],
)
def test_bytes_that_are_no_whole_frame_are_shown_and_read_where_that_makes_sense(text: str, states: str) -> None:
    verdict = verdict_without_bytes(text)
    assert verdict is not None
    assert verdict.code == "not-seen"
    assert states in verdict.evidence


def test_a_float_that_is_plausible_as_it_stands_is_not_called_one_in_another_order() -> None:
    assert verdict_without_bytes("the float is 42 9B 07 7A, 77.5146") is None


@pytest.mark.parametrize(
    ("text", "codes", "says"),
    [
        ("Modbus CRC Check failed! 9021!=02", {"open"}, "the checksums of the frames read here fit"),
        ("CRC: 5C 0A", {"nothing-wrong"}, None),
        ("invalid checksum", {"no-frames"}, "a checksum did not fit"),
        (
            "Unexpected byte count. Expected 32, received 16",
            {"nothing-wrong"},
            "another length than the program expected",
        ),
        ("Timeout for reading: 300.0 ms", {"nothing-wrong"}, None),
        ("send 01 03 5B 3D 00 01 06 E2", {"not-seen"}, None),
        ("error: E2", {"not-seen"}, None),
        ("exceptions.SlaveBusyException", {"open"}, "exception 06 (server device busy)"),
        ("CRC error", {"bit-flip", "nothing-proved"}, None),
        ("connection reset by peer", {"open", "not-seen"}, "the other side reset the TCP connection"),
    ],
)
def test_words_beside_bytes_are_said_and_not_seen(text: str, codes: set[str], says: str | None) -> None:
    verdict = verdict_of_words(text, codes)
    assert (verdict is None) is (says is None)
    if verdict is not None and says is not None:
        assert verdict.code == "said"
        assert says in verdict.evidence


@every_case(
    ("text", "states"),
    [
        ("modbus: Frame check failed, ignoring!!", "a checksum did not fit"),
        ("E (31) twai: error passive, tx_err_cnt 128", "the CAN controller is error passive"),
        ("twai: bus error, ack err", "no other node acknowledged it"),
        ("E (99) twai: bit1 error", "read another bit than it sent"),
        ("MCP2515: ALLTXBUSY error", "all transmit buffers of the CAN controller are full"),
        ("It says `SDO abort 0x05040001` and I am stuck", "SDO abort 05040001 ("),
        ("pymodbus: ConnectionResetError: [Errno 104] Connection reset by peer", "reset the TCP connection"),
        ("E (5) mb: read failed, ESP_ERR_TIMEOUT", "a time-out"),
        ("{ errorCode: 130, exceptionCode: 1, message: 'ILLEGAL FUNCTION' }", "exception 01"),
        ("2023-12-21 01:30:31.810 ERROR it is a ModbusTcpClient: Connection unexpectedly closed", "connection ended"),
    ],
)
def test_messages_of_the_field_are_known(text: str, states: str) -> None:
    sentence = sentence_of(text)
    assert states in sentence


@every_case(
    "text",
    [
        "Modbus Error: [Input/Output] No Response received from the remote unit",
        "CRC error in the answer of the slave",
        "Data length error, expected 7 got 9",
        "write: No buffer space available",
        "canopen: no sdo response",
        "connection refused by the modbus server",
    ],
)
def test_no_cause_is_listed(text: str) -> None:
    sentence = sentence_of(text)
    assert sentence.startswith('verdict: undecided: "')
    assert "[no-bytes]: no frame is read in this text, so that no cause is proved; " in sentence
    for word in ("wires", "DE,", "termination", "parity", "baud", "another unit", "is off", "noise", "registers"):
        assert word not in sentence


@every_case(
    ("text", "said"),
    [
        ("received answer for wrong ID 11, expected 1", "an answer came from another unit than the program asked"),
        ("25 Mar 2021 17:13:29 modbus tty: dropped 205 bytes", "the program discards bytes that it received"),
        (
            "can state BUS-OFF (berr-counter tx 248 rx 0) restart-ms 0",
            'restart-ms 0" (line 1): after bus off the interface does not start again by itself',
        ),
        (
            'Poll error: {"errorCode":131,"exceptionCode":229}',
            "exception E5h to function 03, a code of the device or gateway itself: the standard has 01 to 0B",
        ),
    ],
)
def test_messages_of_programs_that_say_more_than_a_time_out(text: str, said: str) -> None:
    sentence = sentence_of(text)
    assert said in sentence


def test_what_the_text_holds_is_not_asked_for() -> None:
    verdict = verdict_without_bytes("$ mbusd -d -v 9 -p /dev/ttyUSB0\nmodbus tty: dropped 205 bytes\n")
    assert verdict is not None
    assert "would tell more" not in verdict.sentence
    verdict = verdict_without_bytes("can state BUS-OFF (berr-counter tx 248 rx 0) restart-ms 100")
    assert verdict is not None
    assert "candump" in verdict.sentence
    assert "ip -details" not in verdict.sentence


@every_case(
    ("text", "states"),
    [
        ("Modbus error: expected 7 bytes, got 5", "5 bytes came where 7 were expected: the length of a refusal"),
        ("packet byte count does not match bytes in packet! count: 4, actual: 3", "another length than the program"),
        ("AssertionError: modbus response length expected:<9> but was:<8>", "another length than the program expected"),
        ("modbus: got 12 bytes instead of 13", "than the program expected: 12, not 13"),
        ("modbus warning: received response from slave 3, expected 1", "another unit than the program asked: 3, not 1"),
        ("ERROR: request ask for id=1 but got id=127, Skipping.", "another unit than the program asked: 127, not 1"),
        ("modbus: unexpected function code: expected 3, received 131", "another function than the program asked: 131"),
        ("Modbus checksum error: calculated 0xA1B2, received 0x0000", "a checksum did not fit: 0x0000, not 0xA1B2"),
        (
            'CANopen: cocomm "4 r 0x1001 0"\n[0] 11\n',
            "1001h of node 4 is read as 11h; 01h is generic error; 10h is communicat",
        ),
        ("The node reports a CAN error after the RPDO timeout", "a PDO did not come in the time that its consumer"),
    ],
)
def test_two_numbers_of_a_message_say_what_was_expected_and_what_came(text: str, states: str) -> None:
    sentence = sentence_of(text)
    assert states in sentence


@pytest.mark.parametrize(
    "text",
    [
        "modbus error: retry 3 of 5, got 2 answers",
        "modbus fails: expected 4 and got 4",
        "modbus fails at step 3 but was 2",
    ],
)
def test_other_numbers_are_no_mismatch(text: str) -> None:
    sentence = sentence_of(text)
    assert "not 4" not in sentence
    assert "not 3" not in sentence


@pytest.mark.parametrize(
    ("data", "says"),
    [
        ("b0 26 00 00 00 07 03 03 04 ff ff f4", "length is 7, and 6 bytes follow; the byte count is 4, and 3 follow"),
        ("00 07 00 00 00 06 01 03 00 6b 00", "is the beginning of a request, 1 byte is to come: the length is 6"),
    ],
)
def test_a_frame_of_tcp_that_is_short_of_its_length_is_told(data: str, says: str) -> None:
    verdict = verdict_without_bytes(f"Exception: cannot read this response, it is `{data}`")
    assert verdict is not None
    assert verdict.code == "not-seen"
    assert says in verdict.sentence


@pytest.mark.parametrize(
    "title",
    [
        "When we have two clients, from time to time the machine behind the converter is crashing",
        "Die Verbindung zum Zähler im Keller geht seit der letzten Version leider gar nicht mehr",
        "Can't set a value of the inverter",
    ],
)
def test_sound_frames_below_a_title_of_trouble_are_not_all(title: str) -> None:
    good = LineVerdict("nothing-wrong", "nothing wrong", "2 frames")
    assert limited_to_the_frames(good, [title], None).code == "not-seen"
    assert limited_to_the_frames(good, ["My meter of the type SDM120"], None) == good
