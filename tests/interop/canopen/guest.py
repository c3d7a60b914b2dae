"""Runs a command in a User Mode Linux guest: a kernel with SocketCAN and vcan0, as an ordinary program.

    host                                     guest
    linux.uml init=JOB/init       ---->      /            the host's files, read-only (hostfs)
                                             /run         its own (tmpfs); TMPDIR is /run/tmp
                                             /run/job     JOB, a new directory of the host: out, err, status
                                             vcan0        virtual CAN, and the host's python, candump, cansend

The guest needs no image, no KVM and no privileges, starts in two seconds and has one processor. It is removed when the
command is done or the time is up.
"""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[3]
MODULES = ("net/can/can", "net/can/can-raw", "net/can/can-bcm", "drivers/net/can/dev/can-dev", "drivers/net/can/vcan")
INIT = """\
#!{busybox} sh
B={busybox}
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin
$B mount -t proc proc /proc
$B mount -t sysfs sys /sys
$B mount -t tmpfs tmpfs /run
$B mkdir -p /run/job /run/tmp /dev/pts /dev/shm
$B mount -t devpts -o ptmxmode=666 devpts /dev/pts
$B mount -t tmpfs tmpfs /dev/shm
$B ln -sf /proc/self/fd /dev/fd
$B mount -t hostfs -o {job} none /run/job
for module in {modules}; do $B insmod $module; done
ip link set lo up
ip link add vcan0 type vcan && ip link set vcan0 up
$B sh /run/job/command </dev/null >/run/job/out 2>/run/job/err
echo $? >/run/job/status
$B sync
$B poweroff -f
"""


class Done(NamedTuple):
    """The result of a command. `status` is None if the guest ended before it; `console` may show the reason."""

    status: int | None
    out: str
    err: str
    console: str
    job: Path

    def __str__(self) -> str:
        return f"status {self.status}\n{self.out}\n{self.err}\n--- console of the guest\n{self.console[-3000:]}"


@contextmanager
def in_guest(command: Sequence[str], environment: Mapping[str, str], *, timeout: float = 540) -> Iterator[Done]:
    """Run a command in a guest, in the root of the repository; the files it left in /run/job are in `job`."""
    job = Path(tempfile.mkdtemp(prefix="barewire-guest-"))
    try:
        yield _run(job, command, environment, timeout)
    finally:
        shutil.rmtree(job)


def _run(job: Path, command: Sequence[str], environment: Mapping[str, str], timeout: float) -> Done:
    busybox = shutil.which("busybox")
    directory = next(Path("/usr/lib/uml/modules").glob("*/kernel"))
    modules = " ".join(str(directory / f"{name}.ko") for name in MODULES)
    for name in ("out", "err"):
        (job / name).touch()
    inside = {
        "PATH": os.environ["PATH"],
        "LANG": "C.UTF-8",
        "HOME": "/run/tmp",
        "TMPDIR": "/run/tmp",
        "PYTHONDONTWRITEBYTECODE": "1",
        "PYTHONUNBUFFERED": "1",  # the output is written before a guest may hang
        **environment,
    }
    exports = [f"export {name}={shlex.quote(value)}" for name, value in inside.items()]
    (job / "command").write_text("\n".join([*exports, f"cd {shlex.quote(str(ROOT))}", f"exec {shlex.join(command)}\n"]))
    (job / "init").write_text(INIT.format(busybox=busybox, job=job, modules=modules))
    (job / "init").chmod(0o755)
    library = job / "xstate.so"
    source = Path(__file__).with_name("uml_xstate.c")
    subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", library, source], check=True, timeout=60)
    uml = shutil.which("linux.uml") or "linux.uml"
    kernel = [uml, "rootfstype=hostfs", "rootflags=/", "ro", "mem=512M", f"init={job / 'init'}", "con=null",
              "con0=null,fd:1", f"uml_dir={job}/", "umid=guest", "quiet"]  # fmt: skip
    with (job / "console").open("wb") as console:
        # A session of its own: all processes of the guest end with it.
        process = subprocess.Popen(
            kernel,
            stdin=subprocess.DEVNULL,
            stdout=console,
            stderr=subprocess.STDOUT,
            env={**os.environ, "LD_PRELOAD": str(library), "TMPDIR": str(job)},
            start_new_session=True,
        )
        try:
            process.wait(timeout)
        except subprocess.TimeoutExpired:
            console.write(f"\nthe guest was not done after {timeout:g} s\n".encode())
        finally:
            _end(process)
    status = job / "status"
    out, err, shown = ((job / name).read_text(errors="replace") for name in ("out", "err", "console"))
    return Done(int(status.read_text()) if status.exists() else None, out, err, shown, job)


def _end(process: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait(10)
