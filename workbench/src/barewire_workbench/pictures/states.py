"""A picture of the state machine of CiA 402 with the path that a drive has taken.   [CiA 402, device control]

    word                state                  transition
    status 0250h        switch on disabled
    control 0006h                              2 shutdown
    status 0231h        ready to switch on
    control 0007h                              3 switch on
    status 0233h        switched on

The states come from status words, the transitions between two of them from the commands that were given meanwhile and
from what a drive does by itself. If these do not lead to the state that was seen, the shortest way is given as such.
Control words alone do not prove that the drive followed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from typing import Any, Literal, NamedTuple

from barewire.devices.cia402 import TRANSITIONS, DriveCommand, State, command_of, state_of, transitions_by
from barewire.errors import DecodeError, EncodeError
from barewire_workbench.frames.result import counted
from barewire_workbench.pictures.drawing import Drawing, Tile
from barewire_workbench.pictures.picture import Picture

WordKind = Literal["status", "control"]

STEPS_DRAWN = 60
"""The most words in the list; the path in the drawing has all of them."""

_FAULT = 13
_BOXES: dict[State, tuple[int, int]] = {
    State.NOT_READY_TO_SWITCH_ON: (150, 40),
    State.SWITCH_ON_DISABLED: (150, 130),
    State.READY_TO_SWITCH_ON: (150, 230),
    State.SWITCHED_ON: (150, 330),
    State.OPERATION_ENABLED: (150, 430),
    State.QUICK_STOP_ACTIVE: (490, 430),
    State.FAULT_REACTION_ACTIVE: (490, 40),
    State.FAULT: (490, 130),
}
_WIDE, _TALL = 190, 46
_WIDTH, _DRAWN = 690, 496

# The line of each transition, its last point with the arrow, and where its number stands.
_LINES: dict[int, tuple[tuple[tuple[int, int], ...], str, tuple[int, int]]] = {
    0: (((245, 14), (245, 40)), "down", (262, 28)),
    1: (((245, 86), (245, 130)), "down", (262, 112)),
    2: (((200, 176), (200, 230)), "down", (182, 207)),
    7: (((240, 230), (240, 176)), "up", (258, 207)),
    3: (((200, 276), (200, 330)), "down", (182, 307)),
    6: (((240, 330), (240, 276)), "up", (258, 307)),
    4: (((200, 376), (200, 430)), "down", (182, 407)),
    5: (((240, 430), (240, 376)), "up", (258, 407)),
    8: (((150, 445), (104, 445), (104, 253), (150, 253)), "right", (86, 349)),
    9: (((150, 463), (40, 463), (40, 153), (150, 153)), "right", (22, 307)),
    10: (((340, 353), (394, 353), (394, 165), (340, 165)), "left", (412, 307)),
    11: (((340, 441), (490, 441)), "right", (415, 430)),
    16: (((490, 467), (340, 467)), "left", (415, 484)),
    12: (((585, 430), (585, 260), (446, 260), (446, 153), (340, 153)), "left", (585, 345)),
    15: (((490, 141), (340, 141)), "left", (415, 130)),
    13: (((412, 63), (490, 63)), "right", (452, 52)),
    14: (((585, 86), (585, 130)), "down", (602, 112)),
}


class DriveWord(NamedTuple):
    """One word: a status word of the drive or a control word for it; `at` is its time in seconds, if known."""

    kind: WordKind
    word: int
    at: float | None = None


class DriveStep(NamedTuple):
    """One word of the path: the state that a status word shows, the command of a control word.

    `taken` are the transitions since the status word before. `sure` is False if the words do not prove them.
    """

    word: DriveWord
    state: State | None
    command: DriveCommand | None
    taken: tuple[int, ...]
    sure: bool = True

    @property
    def text(self) -> str:
        """What the word says, in words."""
        if self.word.kind == "control":
            return "no command" if self.command is None else self.command.text
        if self.state is None:
            return "none of the eight states: during a transition"
        if not self.taken:
            return self.state.value
        numbers = f"transition{'s' if len(self.taken) > 1 else ''} {', '.join(map(str, self.taken))}"
        if self.sure:
            return f"{self.state.value}, by {numbers}"
        return f"{self.state.value}; the shortest way is {numbers}, which the words do not prove"


def state_path(words: Iterable[DriveWord]) -> list[DriveStep]:
    """Return the states, commands and transitions in status words and control words, in their order.

    >>> [step.taken for step in state_path(DriveWord("status", word) for word in (0x250, 0x231, 0x237))]
    [(), (2,), (3, 4)]

    Raises EncodeError for a word that does not fit in 16 bits.
    """
    steps: list[DriveStep] = []
    previous: State | None = None
    before, commands = 0, list[DriveCommand]()
    for word in words:
        if not 0 <= word.word <= 0xFFFF:
            raise EncodeError(f"{word.kind} word {word.word}: expected 0..FFFFh", word.kind)
        if word.kind == "control":
            command, before = command_of(word.word, before), word.word
            steps.append(DriveStep(word, None, command, ()))
            commands += [] if command is None else [command]
            continue
        try:
            state = state_of(word.word)
        except DecodeError:
            steps.append(DriveStep(word, None, None, ()))
            continue
        taken, sure = ((), True) if previous in (None, state) else _way(previous, state, commands)
        steps.append(DriveStep(word, state, None, taken, sure))
        previous, commands = state, []
    return steps


_BY_ITSELF = {
    (State.NOT_READY_TO_SWITCH_ON, State.SWITCH_ON_DISABLED): 1,
    (State.QUICK_STOP_ACTIVE, State.SWITCH_ON_DISABLED): 12,
    (State.FAULT_REACTION_ACTIVE, State.FAULT): 14,
}


def _way(source: State, target: State, commands: Sequence[DriveCommand]) -> tuple[tuple[int, ...], bool]:
    """Return the transitions between two status words with these commands between them, and whether they are sure.

    They are if the commands, and what a drive does by itself, lead to the state that was seen; without commands if one
    transition does, and no other way is usual: 9 may also be 11 and 12.
    """
    state, taken = source, list[int]()
    for command in commands:
        # A recording does not say whether the drive stays in its quick stop; if it took 16, it does.
        for transition in transitions_by(state, command, stays_in_quick_stop=True):
            taken.append(transition.number)
            state = transition.target
    if state is target and taken:
        return tuple(taken), True
    if (state, target) in _BY_ITSELF:
        return (*taken, _BY_ITSELF[state, target]), True
    numbers = transitions_between(source, target)
    return numbers, len(numbers) < 2 and not commands and numbers != (9,)


def transitions_between(source: State, target: State) -> tuple[int, ...]:
    """Return the numbers of the transitions on the shortest way; transition 13, to a fault, leaves every state.

    >>> transitions_between(State.OPERATION_ENABLED, State.FAULT)
    (13, 14)
    """
    arrows = {(row.source, row.target): row.number for row in TRANSITIONS}
    healthy = [state for state in State if state not in (State.FAULT, State.FAULT_REACTION_ACTIVE)]
    arrows |= {(state, State.FAULT_REACTION_ACTIVE): _FAULT for state in healthy}
    ways: deque[tuple[State, tuple[int, ...]]] = deque([(source, ())])
    seen = {source}
    while ways:
        state, numbers = ways.popleft()
        if state is target:
            return numbers
        for (start, end), number in arrows.items():
            if start is state and end not in seen:
                seen.add(end)
                ways.append((end, (*numbers, number)))
    return ()


class StatesPicture(Picture):
    """The state machine, its visited states and the transitions between them.

    >>> picture = StatesPicture(DriveWord("status", word) for word in (0x250, 0x231, 0x233, 0x237))
    >>> print(*picture.lines(), sep="\\n")
    1  status  0250h   switch on disabled
    2  status  0231h   ready to switch on, by transition 2
    3  status  0233h   switched on, by transition 3
    4  status  0237h   operation enabled, by transition 4
    """

    kind = "states"
    caption = (
        "The numbers at the arrows are the transitions of CiA 402; 13 leads from every state, 0 is power on. Thick "
        "arrows were taken; thick dashed ones are the shortest way to a state, not seen step by step. A number in a "
        "box says which word of the list showed that state."
    )

    def __init__(self, words: Iterable[DriveWord], name: str = "") -> None:
        self.steps = state_path(words)
        self.name = name
        states = [step.state for step in self.steps if step.state is not None]
        of = f" of {name}" if name else ""
        self.title = f"State machine of CiA 402{of}" + (f": {states[-1].value}" if states else "")

    def lines(self) -> list[str]:
        return self._list_of(2 * STEPS_DRAWN)

    def _list_of(self, most: int) -> list[str]:
        """Return a line for each word; of more than `most` words the first and the last."""
        width, count = len(str(len(self.steps))), len(self.steps)
        lines = []
        for number, step in enumerate(self.steps):
            if count <= most or not most // 2 <= number < count - most // 2:
                word = step.word
                lines.append(f"{number + 1:>{width}}  {_moment(word)}{word.kind:<8}{word.word:04X}h   {step.text}")
            elif number == most // 2:
                lines.append(f"... {counted(count - most, 'word')} left out ...")
        return lines

    def as_dict(self) -> dict[str, Any]:
        return {
            "picture": self.kind,
            "name": self.name,
            "words": [
                {
                    "at": step.word.at,
                    "kind": step.word.kind,
                    "word": step.word.word,
                    "state": None if step.state is None else step.state.value,
                    "command": None if step.command is None else step.command.text,
                    "transitions": list(step.taken),
                    "sure": step.sure,
                }
                for step in self.steps
            ],
        }

    def tiles(self) -> Sequence[Tile]:
        return [self._machine(), self._list()]

    def _machine(self) -> Tile:
        drawing = Drawing()
        taken = {number for step in self.steps for number in step.taken}
        drawing.dot(245, 12, 6)
        drawing.text(352, 67, "any state", "s")
        for number in sorted(_LINES, key=lambda number: number in taken):  # those that were taken lie on top
            self._draw_transition(drawing, number)
        visits: dict[State, list[int]] = {}
        for number, step in enumerate(self.steps, start=1):
            if step.state is not None:
                visits.setdefault(step.state, []).append(number)
        for state in _BOXES:
            _draw_state(drawing, state, visits.get(state, []))
        return Tile(_WIDTH, _DRAWN, str(drawing), f"the eight states and the transitions, taken: {sorted(taken)}")

    def _draw_transition(self, drawing: Drawing, number: int) -> None:
        points, direction, place = _LINES[number]
        proofs = [step.sure for step in self.steps if number in step.taken]
        said, line = ("", "l") if not proofs else (", taken", "p") if any(proofs) else (", on the way", "p d")
        with drawing.group(label=f"transition {number}{said}"):
            drawing.line(points, line)
            drawing.arrow(*points[-1], direction, "dot" if proofs else "tip")
            if proofs:
                drawing.dot(place[0], place[1] - 5, 11)
            drawing.text(*place, number, f"h c{' on' if proofs else ' s'}")

    def _list(self) -> Tile:
        drawing = Drawing()
        shown = self._list_of(STEPS_DRAWN)
        for number, line in enumerate(shown, start=1):
            drawing.text(0, 18 * number, line, "m")
        width = round(max((len(line) for line in shown), default=1) * 13 * 0.61) + 8
        return Tile(width, 18 * len(shown) + 12, str(drawing), "the words in their order", starts_row=True)


def _draw_state(drawing: Drawing, state: State, words: Sequence[int]) -> None:
    """Draw the box of a state, with the numbers of the words that showed it."""
    x, y = _BOXES[state]
    with drawing.group(label=f"{state.value}{f', words {_few(words)}' if words else ''}"):
        drawing.box(x, y, _WIDE, _TALL, "t0" if words else "paper", 8)
        drawing.box(x, y, _WIDE, _TALL, "p" if words else "o", 8)
        drawing.text(x + _WIDE / 2, y + (20 if words else 28), state.value, "h c")
        if words:
            drawing.text(x + _WIDE / 2, y + 38, _few(words), "s c")


def _few(numbers: Sequence[int]) -> str:
    if len(numbers) > 6:
        return f"{', '.join(map(str, numbers[:4]))} ... {numbers[-1]}"
    return ", ".join(map(str, numbers))


def _moment(word: DriveWord) -> str:
    return "" if word.at is None else f"{word.at:.6f}  "
