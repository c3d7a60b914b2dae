"""The races of `test_can` on vcan, in the guest kernel of the interop tests: `python -m bench.can_guest`.

It needs `barewire[bench]` (`make bench` installs it) and what those tests need (linux.uml, busybox, cc, ip), no
privileges, and takes some minutes. The guest has one processor, on which client and responder take turns, and slower
system calls than the host. Arguments go to pytest.
"""

from __future__ import annotations

import json
import sys

from bench.results import races, read, show, times
from tests.interop.canopen.guest import in_guest


def main(arguments: list[str]) -> int:
    """Run the races, and print the median and the ratio to the floor of each contestant."""
    options = ("-p", "no:cacheprovider", "-q", "-W", "default", "--benchmark-json=/run/job/can.json")
    which = arguments or ["-k", "vcan"]
    command = (sys.executable, "-m", "pytest", "bench/test_can.py", *options, *which)
    with in_guest(command, {}, timeout=1800) as done:
        result = done.job / "can.json"
        if not result.exists():
            sys.stderr.write(f"{done}\n")
            return 1
        for groups in races(read(json.loads(result.read_text(encoding="utf-8")))).values():
            for (what, size), rows in groups.items():
                sys.stdout.write(f"{what}, {size}\n")
                for row in rows:
                    ratio = row.ratios.get(row.floor, {"median": 1.0})["median"]
                    sys.stdout.write(f"    {row.contestant:28}{show(row.seconds):>10}  x {times(ratio)}\n")
        if done.status:
            sys.stderr.write(done.out)
        return done.status or 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
