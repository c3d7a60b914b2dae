"""`barewire vectors`: the reference vectors, listed, shown, and run against any implementation."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import click

from barewire.errors import EncodeError
from barewire_workbench.cli.arguments import (
    CommandGroup,
    EndedBySignal,
    Seconds,
    ended_by_signals,
    format_option,
    json_option,
    output_form,
    print_json,
)
from barewire_workbench.cli.vectors.report import (
    Progress,
    nothing_asked,
    print_checked,
    summary_fields,
    table,
    write_junit,
)
from barewire_workbench.cli.vectors.show import shown_case
from barewire_workbench.vectors.answers.table import own_answer
from barewire_workbench.vectors.files import Vectors, load_vectors
from barewire_workbench.vectors.run import Ask, CheckedCase, CheckSummary, run_cases, selected

LIVE_KINDS = {"can": "device-conformance"}
"""By the scheme of an endpoint: the kind of the cases that a running device can be asked."""
LIVE_KIND = "server-conformance"
"""The kind of those that a running Modbus server can be asked."""

folder_option = click.option(
    "--cases",
    "folder",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Vectors of a folder, not the built-in ones.",
)


def filter_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that select cases."""
    for option in (
        click.option("--flag", "flags", multiple=True, metavar="FLAG", help="Only cases with this flag."),
        click.option("--only", multiple=True, metavar="PATTERN", help="Only these ids, files or folders: 'rtu/*'."),
        click.option("--kind", "kinds", multiple=True, metavar="KIND", help="Only cases of this kind."),
    ):
        command = option(command)
    return command


@click.group("vectors", cls=CommandGroup)
def vectors_command() -> None:
    """List, show and check the reference vectors."""


@vectors_command.command("list")
@filter_options
@folder_option
@json_option
def list_command(
    kinds: tuple[str, ...], only: tuple[str, ...], flags: tuple[str, ...], folder: Path | None, as_json: bool
) -> int:
    """List the files of the vectors, or, with a filter, the cases that fit it.

    \b
    barewire vectors list
    barewire vectors list --kind crc16
    barewire vectors list --only "canopen/*" --flag widely-wrong
    """
    vectors = selected(load_vectors(folder), kinds=kinds, only=only, flags=flags)
    shows_cases = bool(kinds or only or flags)
    if not as_json and not shows_cases:
        print(f"{'file':42} {'kind':18}{'valid':>7}{'invalid':>9}{'acceptable':>12}  subject")
    for file in vectors.files:
        results = Counter(case["result"] for case in file.cases)
        if as_json:
            print_json({"file": file.name, "kind": file.kind, "subject": file.subject, "cases": list(file.cases)})
        elif shows_cases:
            for case in file.cases:
                print(f"{case['id']:32} {case['result']:11} {case.get('comment', '')}")
        else:
            numbers = "".join(
                f"{results[result] or '':>{len(result) + 2}}" for result in ("valid", "invalid", "acceptable")
            )
            print(f"{file.name:42} {file.kind:18}{numbers}  {file.subject}")
    if not as_json and not shows_cases:
        print(f"{sum(len(file.cases) for file in vectors.files)} cases in {len(vectors.files)} files")
    return 0


@vectors_command.command("show")
@click.argument("case_id", metavar="ID")
@folder_option
@json_option
@format_option
def show_command(case_id: str, folder: Path | None, as_json: bool, form: str | None) -> int:
    """Show the case ID: its fields, its frames byte by byte, and the questions that it asks, with our answers.

    \b
    barewire vectors show crc16-1
    barewire vectors show sdo-blocks-1 --format svg
    """
    form = output_form(form, as_json=as_json)
    vectors = load_vectors(folder)
    file, case = vectors.find(case_id)
    if form in ("html", "svg"):
        from barewire_workbench.cli.vectors.picture import pictures_of_case
        from barewire_workbench.pictures.picture import rendered

        print(rendered(form, *pictures_of_case(file.kind, case)), end="")
    elif form == "json":
        questions = [question.as_json() for question in vectors.questions(file, case)]
        print_json({"file": file.name, "kind": file.kind, "case": case, "questions": questions})
    else:
        for line in shown_case(vectors, file, case):
            print(line)
    return 0


@vectors_command.command("check")
@filter_options
@folder_option
@click.option("--adapter", metavar="COMMAND", help="The program that answers; without it barewire itself answers.")
@click.option("--endpoint", metavar="ENDPOINT", help="A running Modbus server or CANopen device that answers.")
@click.option(
    "--timeout",
    type=Seconds(),
    default=10.0,
    metavar="SECONDS",
    help="For each answer of the adapter (10; 30 for the first).",
)
@click.option("--junit", type=click.Path(path_type=Path), metavar="FILE", help="Also write JUnit XML.")
@json_option
def check_command(
    kinds: tuple[str, ...],
    only: tuple[str, ...],
    flags: tuple[str, ...],
    folder: Path | None,
    adapter: str | None,
    endpoint: str | None,
    timeout: float,
    junit: Path | None,
    as_json: bool,
) -> int:
    """Run the cases against an implementation: barewire itself, an adapter, or a running server.

    An adapter is any program that reads questions as lines of JSON from its standard input and writes answers;
    vectors/README.md describes the lines, vectors/adapters has examples (in the source tree and in each release of the
    vectors). Cases that have failed are printed, then the
    numbers of each kind. "open" is a case that the standard leaves open and the implementation decides otherwise than
    we do.

    \b
    first it reads    {"hello": "barewire-vectors", "protocol": 1}
    and writes        {"name": "mine", "version": "1", "kinds": {"lrc": ["encode"]}}
    then it reads     {"id": "lrc-1.encode", "kind": "lrc", "do": "encode", "bytes": "01 04 00 00 08"}
    and writes        {"id": "lrc-1.encode", "is": {"lrc": "F3"}}

    With --endpoint the cases of the kind server-conformance are put to a Modbus server, as `barewire conform` does:
    they write registers and coils 0 to 9 of the unit. Cases for another framing, and cases that need a function or a
    register that the server does not have, are not offered. A CANopen device at can:// gets those of the kind
    device-conformance, without the ones that store values: it is reset many times, started and stopped.

    With --json every case is an object, and the last one has the numbers. Exit status 1 if a case has failed, or if
    nothing was offered.

    \b
    barewire vectors check
    barewire vectors check --adapter "node vectors/adapters/javascript/main.mjs" --kind crc16
    barewire vectors check --endpoint "tcp://127.0.0.1:1502?unit=1"
    barewire vectors check --endpoint "can://socketcan/can0?node=5"
    """
    if endpoint is not None:
        if adapter is not None:
            raise EncodeError("--endpoint and --adapter: give one of them, the implementation that answers")
        live = LIVE_KINDS.get(endpoint.partition("://")[0], LIVE_KIND)
        if other := [kind for kind in kinds if kind != live]:
            raise EncodeError(f"--endpoint: a running server is asked {live}, not {other[0]}; --adapter asks a codec")
        kinds = (live,)
    vectors = selected(load_vectors(folder), kinds=kinds, only=only, flags=flags)
    if adapter is not None and not adapter.split():
        raise EncodeError("--adapter: the command is empty")
    if junit is not None:
        write_junit(junit, "", [])  # fail now, and not after the run, if the file cannot be written
    try:
        with ended_by_signals(), _implementation(adapter, endpoint, timeout) as (name, ask):
            cases = _run(vectors, ask, as_json, exact=adapter is None and endpoint is None)
    except EndedBySignal as error:
        return error.status
    summary = CheckSummary()
    for checked in cases:
        summary.add(checked)
    if junit is not None:
        write_junit(junit, name, cases)
    if as_json:
        print_json(summary_fields(summary, name))
    else:
        print(table(summary, name))
        if remark := nothing_asked(cases):
            print(remark)
    return int(summary.total["failed"] > 0 or not summary.total["passed"])


def _live(endpoint: str) -> AbstractContextManager[Ask]:
    """Return what puts questions to a running server or device."""
    from barewire.io.endpoint import Endpoint

    parsed = Endpoint.parse(endpoint)
    if parsed.scheme in LIVE_KINDS:
        from barewire.io.canopen.bus.receiving import inside_one_process
        from barewire_workbench.live.canopen_conformance import LiveDevice

        if remark := inside_one_process(parsed.place):
            raise EncodeError(f"{endpoint}: {remark}, no device of another program is there")
        return LiveDevice(parsed)
    from barewire_workbench.live.modbus_conformance import LiveServer

    return LiveServer(parsed)


@contextmanager
def _implementation(adapter: str | None, endpoint: str | None, timeout: float) -> Iterator[tuple[str, Ask]]:
    """Yield the name of the implementation, and the function that answers."""
    if endpoint is not None:
        with _live(endpoint) as ask:
            yield endpoint, ask
        return
    if adapter is None:
        from barewire import __version__

        yield f"barewire {__version__}", lambda question: own_answer(question.as_json())
        return
    from barewire_workbench.live.vector_adapter import VectorAdapter

    with VectorAdapter(adapter, timeout=timeout) as program:
        yield f"{program.name} {program.version}".strip(), program


def _run(vectors: Vectors, ask: Ask, as_json: bool, *, exact: bool) -> list[CheckedCase]:
    """Run the cases and print them as they end."""
    progress = Progress(sum(len(file.cases) for file in vectors.files))
    cases = []
    for checked in run_cases(vectors, ask, exact=exact):
        if checked.verdict.state == "failed":
            progress.clear()
        print_checked(checked, as_json)
        progress.add(checked)
        cases.append(checked)
    progress.clear()
    sys.stdout.flush()
    return cases
