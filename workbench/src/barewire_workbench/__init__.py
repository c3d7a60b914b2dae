"""Explains, records, diagnoses and tests Modbus and CANopen: what is built on `barewire`, and the command `barewire`.

    >>> from barewire_workbench import explain_text
    >>> print(*explain_text("rtu", "01 04 0F B1 00 02 22 F8").lines(), sep="\\n")
    0  01     unit           1             unit 1
    1  04     function code  4             04 Read Input Registers
    2  0F B1  address        0FB1h (4017)  0-based; number 4018 in 1-based tables
    4  00 02  quantity       2             input registers
    6  22 F8  CRC                          CRC ok
    valid: a request to unit 1, Read Input Registers, 2 from 0FB1h; CRC ok

The rooms in reading order. Only `live` and `cli` use clocks and ports; the others work on bytes and recordings.

    sniffer         pairs the requests and responses of other stations on a Modbus line
    frames/         any frame field by field: every byte is in exactly one field, however broken the frame is
    recordings/     pcapng, candump, ASC, BLF, logs of programs; Modbus and CAN in them
    monitor/        a monitor for CANopen buses: transfers, states, broken rules
    wire            the levels of characters and CAN frames, and a receiver with other settings
    steps/          checksums, times, values and words, worked out step by step
    diagnosis/      what is wrong with a frame or a recording, proved by trials
    pictures/       frames, levels, exchanges, drives and values as text, SVG and HTML
    replay/         a recording played against a device or a client, and compared; the values in it
    eds/            EDS files checked, and written from the description of a device
    settings/       the settings of a device: the file that keeps them, what differs
    scan/           the units of a line, their settings, addresses and names
    value_log/      logs of values that are read periodically: rows, conditions, files that are whole after a power cut
    conform/        the behaviour that every server and every CANopen device must show, as data
    vectors/        the reference vectors, their questions, the judgement of answers
    vendor/         a client or server of the stack as one file; its shorter parts are in live/one_file
    ascii_gateway/  a CANopen network in lines of text, by CiA 309-3
    live/           both batteries, scans, values, the questions of vectors, and this gateway, on real ports
    cli/            the command `barewire`, one file per command
    api             `explain` and `explain_text`

A name loads its file when it is first used.
"""

TYPE_CHECKING = False  # for type checkers True; `typing` takes longer to load than the rest
if TYPE_CHECKING:
    from barewire_workbench.api import (
        explain as explain,
        explain_exchange as explain_exchange,
        explain_text as explain_text,
    )
    from barewire_workbench.frames.findings import DiagnosisCode as DiagnosisCode, Finding as Finding
    from barewire_workbench.frames.result import (
        ExplainedField as ExplainedField,
        Explanation as Explanation,
        FrameRole as FrameRole,
        Problem as Problem,
        ProtocolName as ProtocolName,
    )

__version__ = "0.1.0"

try:
    from barewire._lazy import lazy
except ModuleNotFoundError as error:
    if error.name != "barewire":
        raise

    # Installed without the stack: the command, in `cli`, says so in one line, and any other use with this error.
    def __getattr__(name: str) -> object:
        raise ModuleNotFoundError(f"barewire-workbench needs barewire {__version__}", name="barewire")

else:
    __getattr__, __dir__, __all__ = lazy(
        __name__,
        {
            "api": "explain explain_text explain_exchange",
            "frames.result": "Explanation ExplainedField Problem ProtocolName FrameRole",
            "frames.findings": "Finding DiagnosisCode",
        },
    )
