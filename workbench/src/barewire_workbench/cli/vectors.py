"""`barewire vectors`: the reference vectors, listed, shown, and run against any implementation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import click

from barewire.errors import EncodeError
from barewire_workbench.cli.arguments import CommandGroup, duration, format_option, json_option
from barewire_workbench.cli.ending import EndedBySignal, ended_by_signals
from barewire_workbench.cli.output import (
    Output,
    output_form,
    output_option,
    port_error,
    print_json,
    printable,
    replace_file,
    status_line,
)
from barewire_workbench.cli.vectors_show import pictures_of_case, shown_case
from barewire_workbench.vectors.answers.table import own_answer
from barewire_workbench.vectors.files import Vectors, load_vectors
from barewire_workbench.vectors.profiles import badge_json, badge_svg, badge_texts, in_profile
from barewire_workbench.vectors.run import Ask, CheckedCase, CheckSummary, run_cases, selected

_LIVE_KINDS = {"can": "device-conformance"}
"""By the scheme of an endpoint: the kind of the cases that a running device can be asked."""
_LIVE_KIND = "server-conformance"
"""The kind of those that a running Modbus server can be asked."""

_folder_option = click.option(
    "--cases",
    "folder",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Vectors of a folder, not the built-in ones.",
)


def _filter_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that select cases."""
    for option in (
        click.option("--profile", metavar="NAME", help="Only the cases of a profile, such as modbus-core."),
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
@_filter_options
@click.option("--profiles", is_flag=True, help="The profiles, and how many cases each has.")
@_folder_option
@output_option
def list_command(
    kinds: tuple[str, ...],
    only: tuple[str, ...],
    flags: tuple[str, ...],
    profile: str | None,
    profiles: bool,
    folder: Path | None,
    output: Output,
) -> None:
    """List the files of the vectors, or, with a filter, the cases that fit it.

    \b
    barewire vectors list
    barewire vectors list --profiles
    barewire vectors list --kind crc16
    barewire vectors list --only "canopen/*" --flag widely-wrong
    """
    if profiles:
        _list_profiles(load_vectors(folder), output)
        return
    vectors = _selected(folder, profile, kinds=kinds, only=only, flags=flags)
    if output.as_json:
        for file in vectors.files:
            print_json({"file": file.name, "kind": file.kind, "subject": file.subject, "cases": list(file.cases)})
    elif kinds or only or flags or profile:
        for file in vectors.files:
            for case in file.cases:
                print(f"{case['id']:32} {case['result']:11} {case.get('comment', '')}")
    else:
        print(f"{'file':42} {'kind':18}{'valid':>7}{'invalid':>9}{'acceptable':>12}  subject")
        for file in vectors.files:
            results = Counter(case["result"] for case in file.cases)
            columns = (f"{results[name] or '':>{len(name) + 2}}" for name in ("valid", "invalid", "acceptable"))
            print(f"{file.name:42} {file.kind:18}{''.join(columns)}  {file.subject}")
        print(f"{sum(len(file.cases) for file in vectors.files)} cases in {len(vectors.files)} files")


def _selected(folder: Path | None, profile: str | None, **filters: tuple[str, ...]) -> Vectors:
    vectors = load_vectors(folder)
    return selected(vectors if profile is None else in_profile(vectors, profile), **filters)


def _list_profiles(vectors: Vectors, output: Output) -> None:
    for name, rules in vectors.profiles.items():
        chosen = in_profile(vectors, name)
        count = sum(len(file.cases) for file in chosen.files)
        if output.as_json:
            print_json({"profile": name, "cases": count, "about": rules["about"]})
        else:
            print(f"{name:16}{count:>6} cases in {len(chosen.files):>3} files   {rules['about']}")


@vectors_command.command("show")
@click.argument("case_id", metavar="ID")
@_folder_option
@json_option
@format_option
def show_command(case_id: str, folder: Path | None, as_json: bool, form: str | None) -> None:
    """Show the case ID: its fields, its frames byte by byte, and the questions that it asks, with our answers.

    \b
    barewire vectors show crc16-1
    barewire vectors show sdo-blocks-1 --format svg
    """
    form = output_form(form, as_json=as_json)
    vectors = load_vectors(folder)
    file, case = vectors.find(case_id)
    if form in ("html", "svg"):
        from barewire_workbench.pictures.picture import rendered

        print(rendered(form, *pictures_of_case(file.kind, case)), end="")
    elif form == "json":
        questions = [question.as_json() for question in vectors.questions(file, case)]
        print_json({"file": file.name, "kind": file.kind, "case": case, "questions": questions})
    else:
        for line in shown_case(vectors, file, case):
            print(line)


@vectors_command.command("check")
@_filter_options
@_folder_option
@click.option("--adapter", metavar="COMMAND", help="The program that answers; without it barewire itself answers.")
@click.option("--endpoint", metavar="ENDPOINT", help="A running Modbus server or CANopen device that answers.")
@click.option(
    "--timeout",
    type=duration,
    default=10.0,
    metavar="SECONDS",
    help="For each answer of the adapter (10; 30 for the first).",
)
@click.option("--junit", type=click.Path(path_type=Path), metavar="FILE", help="Also write JUnit XML.")
@click.option("--badge", type=click.Path(path_type=Path), metavar="FILE", help="Also write a badge, .svg or .json.")
@output_option
def check_command(
    kinds: tuple[str, ...],
    only: tuple[str, ...],
    flags: tuple[str, ...],
    profile: str | None,
    folder: Path | None,
    adapter: str | None,
    endpoint: str | None,
    timeout: float,
    junit: Path | None,
    badge: Path | None,
    output: Output,
) -> int:
    """Run the cases against an implementation: barewire itself, an adapter, or a running server.

    An adapter is any program that reads questions as lines of JSON from its standard input and writes answers;
    vectors/PROTOCOL.md describes the lines; the source tree has examples in vectors/examples, and in vectors/peers the
    adapters of other stacks. Cases that have failed are printed, then the numbers of each kind. "open" is a case that
    the standard leaves open and the implementation decides otherwise than we do.

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
    barewire vectors check --adapter "node vectors/examples/javascript/main.mjs" --kind crc16
    barewire vectors check --profile modbus-core --adapter ./my-adapter --junit report.xml --badge badge.svg
    barewire vectors check --endpoint "tcp://127.0.0.1:1502?unit=1"
    barewire vectors check --endpoint "can://socketcan/can0?node=5"
    """
    if endpoint is not None:
        if adapter is not None:
            raise EncodeError("--endpoint and --adapter: give one of them, the implementation that answers")
        live = _LIVE_KINDS.get(endpoint.partition("://")[0], _LIVE_KIND)
        if other := [kind for kind in kinds if kind != live]:
            raise EncodeError(f"--endpoint: a running server is asked {live}, not {other[0]}; --adapter asks a codec")
        kinds = (live,)
    vectors = _selected(folder, profile, kinds=kinds, only=only, flags=flags)
    if adapter is not None and not adapter.split():
        raise EncodeError("--adapter: the command is empty")
    if junit is not None:
        _write_junit(junit, "", [])  # fail now, and not after the run, if the file cannot be written
    if badge is not None:
        if kinds or only or flags:
            raise EncodeError("--badge: is for a whole profile, or for all cases; leave out --kind, --only and --flag")
        _write_badge(badge, vectors, profile, CheckSummary())
    try:
        with ended_by_signals(), _implementation(adapter, endpoint, timeout) as (name, ask):
            cases = _run(vectors, ask, output, exact=adapter is None and endpoint is None)
    except EndedBySignal as error:
        return error.status
    summary = CheckSummary()
    for checked in cases:
        summary.add(checked)
    if junit is not None:
        _write_junit(junit, name, cases)
    if badge is not None:
        _write_badge(badge, vectors, profile, summary)
    output.show(_table(summary, name), _summary_fields(summary, name))
    if all(checked.verdict.state == "not offered" for checked in cases):
        output.text(f"nothing was asked; for example {cases[0].id}: {printable(cases[0].verdict.text)}")
    return int(summary.total["failed"] > 0 or not summary.total["passed"])


def _live(endpoint: str) -> AbstractContextManager[Ask]:
    """Return what puts questions to a running server or device."""
    from barewire.io.endpoint import Endpoint

    parsed = Endpoint.parse(endpoint)
    if parsed.scheme in _LIVE_KINDS:
        from barewire.io.canopen.bus.port import inside_one_process
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


def _run(vectors: Vectors, ask: Ask, output: Output, *, exact: bool) -> list[CheckedCase]:
    """Run the cases, and print them as they end: all of them as JSON, otherwise those that have failed."""
    total, failed = sum(len(file.cases) for file in vectors.files), 0
    cases: list[CheckedCase] = []
    with status_line() as show:
        for checked in run_cases(vectors, ask, exact=exact):
            cases.append(checked)
            if checked.verdict.state == "failed":
                failed += 1
                if show is not None:
                    show("")
            if output.as_json:
                print_json(_case_fields(checked))
            elif checked.verdict.state == "failed":
                comment = checked.case.get("comment", "")
                output.text(f"failed  {checked.id}  {comment}", f"    {printable(checked.verdict.text)}")
            if show is not None and len(cases) % 20 == 0:
                show(f"{len(cases)} of {total} cases, {failed} failed ")
    return cases


# What a check prints and writes

_STATES = ("passed", "open", "failed", "not offered")


def _case_fields(checked: CheckedCase) -> dict[str, Any]:
    fields = {
        "id": checked.id,
        "file": checked.file.name,
        "kind": checked.file.kind,
        "result": checked.case["result"],
        "state": checked.verdict.state,
    }
    return fields | ({"text": checked.verdict.text} if checked.verdict.text else {})


def _summary_fields(summary: CheckSummary, name: str) -> dict[str, Any]:
    """Return the last object of the JSON output: the numbers by kind."""
    rows = {kind: {state: row[state] for state in _STATES} for kind, row in summary.by_kind.items()}
    return {"implementation": name, **{state: summary.total[state] for state in _STATES}, "kinds": rows}


def _table(summary: CheckSummary, name: str) -> str:
    """Return the numbers by kind as a table."""
    width = max(map(len, summary.by_kind), default=4)
    rows = [f"{'':{width}}" + "".join(f"{state:>13}" for state in _STATES)]
    counts = [*summary.by_kind.items(), ("all", summary.total)]
    for kind, row in counts:
        rows.append(f"{kind:{width}}" + "".join(f"{row[state] or '':>13}" for state in _STATES))
    total = sum(summary.total.values())
    not_offered = f", {summary.total['not offered']} not offered" if summary.total["not offered"] else ""
    return "\n".join([*rows, f"{printable(name)}: {summary.total['passed']} of {total} cases passed{not_offered}"])


def _write_junit(path: Path, name: str, cases: list[CheckedCase]) -> None:
    """Write a file of JUnit XML: a suite for each file, a test case for each case."""
    root = ElementTree.Element("testsuites", name=f"barewire vectors: {printable(name)}")
    suites: dict[str, ElementTree.Element] = {}
    for checked in cases:
        suite = suites.get(checked.file.name)
        if suite is None:
            suite = suites[checked.file.name] = ElementTree.SubElement(root, "testsuite", name=checked.file.name)
        row = ElementTree.SubElement(suite, "testcase", classname=checked.file.name, name=checked.id)
        if checked.verdict.state == "failed":
            ElementTree.SubElement(row, "failure", message=printable(checked.verdict.text))
        elif checked.verdict.state in ("open", "not offered"):
            ElementTree.SubElement(
                row, "skipped", message=printable(f"{checked.verdict.state}: {checked.verdict.text}")
            )
    for suite in suites.values():
        suite.set("tests", str(len(suite)))
        suite.set("failures", str(len(suite.findall("testcase/failure"))))
        suite.set("skipped", str(len(suite.findall("testcase/skipped"))))
    with port_error(path):
        ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _write_badge(path: Path, vectors: Vectors, profile: str | None, summary: CheckSummary) -> None:
    """Write how many cases have not failed, as a picture or, if the name ends with .json, as shields.io reads it."""
    if path.suffix not in (".svg", ".json"):
        raise EncodeError(f"--badge {path}: expected a name that ends with .svg or .json")
    form = badge_json if path.suffix == ".json" else badge_svg
    replace_file(path, form(*badge_texts(vectors, profile or "", summary.total)).encode())
