"""What is counted on a Modbus line, and the verdicts that the numbers show.

        no frame, but the bytes are frames at another baud rate       baud-rate; likewise parity, inverted ...
        noise before many responses                                   no-bias
        responses without their first or last byte                    turnaround
        each request twice, at once, the second one answered          echo
        second answers, or damaged ones that are too long, of a unit  two-units
        requests to one unit without an answer, others answer         dead-unit

A share decides beside the number: a line that carries thousands of frames has a damaged one now and then.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container
from dataclasses import dataclass, field

from barewire_workbench.diagnosis.can_log import PROVES
from barewire_workbench.diagnosis.good import HIGHEST_UNIT
from barewire_workbench.diagnosis.verdict import LineVerdict, VerdictCode
from barewire_workbench.frames.findings import DiagnosisCode
from barewire_workbench.frames.result import counted

_SHARE = 0.05
"""The least share of frames with the same fault that makes it one of the line."""
_ALONE = 5
"""Undamaged responses of other units that show that the line itself is good."""

_READINGS: dict[DiagnosisCode, tuple[VerdictCode, str]] = {
    "baud-rate": ("baud-rate", "the reader has another baud rate than the sender"),
    "inverted": ("inverted", "the wires A and B are exchanged"),
    "parity": ("parity", "the reader has another parity than the sender"),
    "seven-bit": ("parity", "the sender has 7 data bits and a parity bit, the reader 8 data bits"),
    "ascii-on-rtu": ("wrong-protocol", "the devices speak Modbus ASCII, and RTU is read"),
    "mbap-on-serial": ("wrong-protocol", "frames of Modbus TCP are sent on a serial line"),
    "rtu-on-tcp": ("wrong-protocol", "RTU frames are sent on a connection where Modbus TCP is read"),
    "crc-inside-mbap": ("malformed", "the frames of Modbus TCP still have the CRC of the serial line"),
    "header-byte-order": ("malformed", "a number in the header is sent low byte first"),
    "mbap-header": ("malformed", "the header of Modbus TCP has a wrong length or protocol"),
    "crc-swapped": ("malformed", "a device sends the two bytes of the CRC in the wrong order"),
    "crc-span": ("malformed", "a device computes the CRC over other bytes"),
    "crc-kind": ("malformed", "a device computes another CRC than that of Modbus"),
    "crc-missing": ("malformed", "a device sends no CRC"),
    "lrc-over-characters": ("malformed", "a device computes the LRC over the characters"),
    "byte-count": ("malformed", "a device sends a wrong byte count"),
}
"""Code of a finding on damaged bytes -> the verdict if it is that of many."""


_LEVELS: tuple[DiagnosisCode, ...] = ("baud-rate", "inverted", "parity")
"""Other readings of the same levels: bytes may fit several of them, and most pieces decide."""


@dataclass(slots=True)
class UnitCounts:
    """What was counted of one unit."""

    requests: int = 0
    answered: int = 0
    missing: int = 0
    late: int = 0
    wrong: int = 0  # responses of another unit, or to another request
    damaged: int = 0
    too_long: int = 0  # damaged responses with more bytes than the whole response has
    twice: int = 0
    halves: int = 0  # single writes of which only the request or the equal response was received
    streak: int = 0  # requests without an answer since the last one


@dataclass(slots=True)
class LineCounts:
    """What was counted on one line or connection."""

    serial: bool = True
    units: dict[int, UnitCounts] = field(default_factory=dict)
    frames: int = 0
    requests: int = 0
    responses: int = 0
    bursts: int = 0  # pieces that are not a frame, stray bytes beside frames not counted
    no_value: Counter[str] = field(default_factory=Counter)  # responses of one register that is a mark, by that
    strange: int = 0  # of these: neither the beginning of the response that was due nor a frame with a fault
    stray: int = 0
    noise_bytes: int = 0
    before_responses: int = 0
    before_requests: int = 0
    after: int = 0
    longest_noise: int = 0
    first_lost: int = 0
    last_lost: int = 0
    echoes: int = 0
    overlaps: int = 0  # requests that were sent before another one had its response
    first_overlap: str = ""  # its proof
    foreign: int = 0  # requests that the client received, which are not its own
    first_foreign: str = ""
    own: set[int] = field(default_factory=set)  # the units that the client asked before
    codes: Counter[DiagnosisCode] = field(default_factory=Counter)  # bursts by each of their findings
    kinds: Counter[DiagnosisCode] = field(default_factory=Counter)  # bursts by their first finding

    def unit(self, number: int) -> UnitCounts:
        """Return the counts of a unit."""
        return self.units.setdefault(number, UnitCounts())

    def verdicts(self) -> list[LineVerdict]:
        """Return the verdicts that the numbers show, those that explain most first."""
        verdicts = [*self._readings(), *self._direction(), *self._two_masters(), *self._addresses()]
        if not verdicts and not self.frames and self.kinds["no-frame"]:
            verdicts.append(self._no_frames())
        damaged = self.bursts - self.first_lost - self.last_lost - self.strange
        damaged -= self.kinds["late-answer"] + self.kinds["noise-before"]  # which are good frames
        explained = {verdict.code for verdict in verdicts} - {"dead-unit", "no-answers", "echo", "two-masters"}
        if self.serial and not explained and damaged >= PROVES and damaged >= _SHARE * self.frames:
            verdicts.append(self._disturbed(damaged))
        verdicts += self._silence()
        return verdicts or self._late()

    def seen(self) -> str:
        """Return the counts in words."""
        answered = sum(unit.answered for unit in self.units.values())
        units = [number for number, unit in self.units.items() if unit.answered]
        text = f"{counted(self.frames, 'frame')}{'' if answered else ' read'}"
        if answered:
            text += f", {counted(answered, 'request')} answered by {counted(len(units), 'unit')}"
        for value, number in self.no_value.items():
            text += (
                f"; {counted(number, 'response')} of {value} alone, which many devices send for a value not available"
            )
        return text

    # Frames that are not read as they were sent

    def _readings(self) -> list[LineVerdict]:
        verdicts = []
        most = max(self.codes[code] for code in _LEVELS)
        for code, (verdict, text) in _READINGS.items():
            number = self.codes[code]
            if code in _LEVELS and number < most:
                continue
            alone = not self.frames and 2 * number > self.bursts and (number > 1 or verdict != "malformed")
            if alone or (number >= PROVES and number >= _SHARE * (self.frames + self.bursts)):
                evidence = f"{number} of {counted(self.bursts, 'damaged piece')} are good frames then"
                evidence += f"; {counted(self.frames, 'frame')} read as they were sent"
                verdicts.append(LineVerdict(verdict, text, evidence, _OTHER.get(verdict, "")))
        return verdicts

    def _no_frames(self) -> LineVerdict:
        evidence = f"{counted(self.noise_bytes)} in {counted(self.bursts, 'piece')}"
        return LineVerdict("no-frames", "the bytes are no Modbus frames as they are read here", evidence)

    # The direction of the line

    def _direction(self) -> list[LineVerdict]:
        verdicts = []
        noisy = self.before_responses + self.before_requests
        if noisy >= PROVES and noisy >= 2 * _SHARE * self.frames:
            verdicts.append(self._no_bias())
        if self.first_lost >= PROVES and self.first_lost >= _SHARE * self.responses:
            evidence = (
                f"{self.first_lost} of {counted(self.first_lost + self.responses, 'response')} lack their first bytes"
            )
            text = "the responses begin before the line is free: the turnaround is too short"
            verdicts.append(LineVerdict("turnaround", text, evidence, _OTHER["turnaround"]))
        if self.last_lost >= PROVES and self.last_lost >= _SHARE * self.responses:
            evidence = (
                f"{self.last_lost} of {counted(self.last_lost + self.responses, 'response')} lack their last bytes"
            )
            text = "a transmitter is switched off before its last byte is sent"
            verdicts.append(LineVerdict("turnaround", text, evidence, "a reader that stops too early"))
        if self.echoes >= PROVES and 4 * self.echoes >= self.requests - self.echoes:
            evidence = f"{self.echoes} of {counted(self.requests - self.echoes, 'request')} were received again at once"
            verdicts.append(LineVerdict("echo", "the transceiver receives what it sends", evidence, _OTHER["echo"]))
        return verdicts

    def _no_bias(self) -> LineVerdict:
        size = "1 byte" if self.longest_noise == 1 else f"up to {self.longest_noise} bytes"
        parts = []
        if self.before_responses:
            parts.append(f"{self.before_responses} of {counted(self.responses, 'response')}")
        if self.before_requests:
            parts.append(f"{self.before_requests} of {counted(self.requests, 'request')}")
        evidence = f"{' and '.join(parts)} had {size} of noise before them"
        return LineVerdict(
            "no-bias", "bias resistors are missing: noise comes before frames", evidence, _OTHER["no-bias"]
        )

    # Masters and units

    def _two_masters(self) -> list[LineVerdict]:
        if self.foreign and not any(self.unit(number).answered for number in self.own):
            evidence = f"{counted(self.foreign, 'request')} received that the client did not send, the first: "
            other = "an echo that comes late, or a client that listens on a line of which it is not the master"
            return [LineVerdict("two-masters", "another master is on the line", evidence + self.first_foreign, other)]
        if not self.overlaps:
            return []
        evidence = f"{counted(self.overlaps, 'time')}, the first: {self.first_overlap}"
        return [LineVerdict("two-masters", "two masters use the line", evidence, _OTHER["two-masters"])]

    def _addresses(self) -> list[LineVerdict]:
        verdicts = []
        for number, unit in self.units.items():
            others = sum(other.answered for place, other in self.units.items() if place != number)
            others_damaged = sum(other.damaged for place, other in self.units.items() if place != number)
            text = f"two devices answer as unit {number}"
            if unit.twice >= PROVES:
                evidence = f"{unit.twice} of {counted(unit.requests, 'request')} to it were answered twice"
                verdicts.append(LineVerdict("two-units", text, evidence, "a repeater that sends frames again"))
            elif self.serial and unit.too_long >= PROVES and 2 * unit.too_long >= unit.damaged and not others_damaged:
                evidence = (
                    f"{unit.too_long} of {counted(unit.requests, 'response')} are damaged and longer than a response"
                )
                if others:
                    evidence += f"; {others} responses of other units are good"
                other = "one device with noise behind its responses"
                verdicts.append(LineVerdict("two-units", text, evidence, other))
        return verdicts

    def _silence(self) -> list[LineVerdict]:
        dead = {
            number: unit
            for number, unit in self.units.items()
            if not (unit.answered or unit.damaged or unit.late or unit.wrong) and unit.missing + unit.halves >= PROVES
        }
        answered = sum(unit.answered + unit.damaged for unit in self.units.values())
        if dead and not answered and not self.bursts:
            requests = sum(unit.missing + unit.halves for unit in dead.values())
            evidence = f"{counted(requests, 'request')} to unit {', '.join(map(str, sorted(dead)))}, and no response"
            evidence += "; 248 to 255 are reserved" * (self.serial and min(dead) > HIGHEST_UNIT)
            return [LineVerdict("no-answers", "no unit answers", evidence, self._other("no-answers"))]
        verdicts = []
        for number, unit in dead.items():
            asked = unit.missing + unit.halves
            evidence = f"0 of {counted(asked, 'request')} answered; others answered {answered}"
            verdicts.append(
                LineVerdict("dead-unit", f"unit {number} does not answer", evidence, self._other("dead-unit"))
            )
        for number, unit in self.units.items():
            if unit.answered and unit.streak >= PROVES:
                evidence = f"the last {unit.streak} of {counted(unit.requests, 'request')} have no answer"
                verdicts.append(
                    LineVerdict("dead-unit", f"unit {number} fell silent", evidence, self._other("dead-unit"))
                )
                dead[number] = unit
        return [*verdicts, *self._lost(dead)]

    def _lost(self, dead: Container[int]) -> list[LineVerdict]:
        """Responses that are missing now and then. One that came late is not lost."""
        others = {number: unit for number, unit in self.units.items() if number not in dead}
        lost = {number: max(0, unit.missing - unit.late) for number, unit in others.items()}
        requests, total = sum(unit.requests for unit in others.values()), sum(lost.values())
        if total < PROVES or total < _SHARE * requests:
            return []
        units = [number for number, count in sorted(lost.items()) if count]
        evidence = f"{total} of {counted(requests, 'request')} have no response, of unit {', '.join(map(str, units))}"
        return [
            LineVerdict("lost-answers", "responses are missing now and then", evidence, self._other("lost-answers"))
        ]

    def _late(self) -> list[LineVerdict]:
        """Responses behind the next request. One may be an accident; beside wrong ones, a wrong one may seem late."""
        late = {number: unit.late for number, unit in sorted(self.units.items()) if unit.late}
        requests, total = sum(unit.requests for unit in self.units.values()), sum(late.values())
        if total < 2 or total < _SHARE * requests or any(unit.wrong for unit in self.units.values()):
            return []
        text = "responses come later than the client waits"
        units = ", ".join(map(str, late))
        evidence = f"{total} responses to {counted(requests, 'request')} came after the next request, of unit {units}"
        return [LineVerdict("late-answers", text, evidence, _OTHER["late-answers"])]

    def _other(self, code: VerdictCode) -> str:
        """Return what else silence may be on a serial line; nothing on another, whose way is not known."""
        return _OTHER[code] if self.serial else ""

    def _disturbed(self, damaged: int) -> LineVerdict:
        kinds = ", ".join(f"{number} {code}" for code, number in self.kinds.most_common(4))
        evidence = f"{damaged} damaged pieces beside {counted(self.frames, 'good frame')} ({kinds})"
        worst = max(self.units, key=lambda number: self.units[number].damaged, default=0)
        others = sum(unit.answered for number, unit in self.units.items() if number != worst)
        if worst and self.units[worst].damaged >= PROVES and self.units[worst].damaged == damaged and others >= _ALONE:
            evidence += f"; {others} responses of other units are good"
            text = f"only the responses of unit {worst} are damaged"
            return LineVerdict("disturbed", text, evidence, "two devices with its address, or a bad stub to it")
        other = "a baud rate that is slightly off, or two stations that send at the same time"
        return LineVerdict("disturbed", "frames are damaged on the line", evidence, other)


_OTHER: dict[VerdictCode, str] = {
    "no-bias": "a transmitter that is switched on before it sends, or a missing termination",
    "turnaround": "a master whose transmitter is switched off too late",
    "echo": "a master that sends every request twice",
    "two-masters": "one master that does not wait for a response before its next request",
    "baud-rate": "",
    "dead-unit": "another address, a broken stub, or an answer that is later than the time-out",
    "lost-answers": "requests that are damaged on the way, a busy device, or a master whose time-out is too short",
    "late-answers": "a converter or gateway that holds them back",
    "no-answers": "a listener that receives the master only, or another baud rate or parity at the units",
}
