"""`python -m barewire`, the same as the command `barewire`, which another distribution installs."""

import sys


def main() -> None:
    """Run the command. If it is not installed, print one line that says how to install it, and end with status 1."""
    from importlib.metadata import entry_points  # here, where Ctrl-C has no traceback
    from importlib.util import find_spec

    for command in entry_points(group="console_scripts", name="barewire"):
        if find_spec(command.module.partition(".")[0]) is not None:  # not what remains of an older installation
            command.load()()
            return
    print("barewire: the command is not installed: pip install 'barewire[cli]'", file=sys.stderr)  # noqa: T201
    sys.exit(1)


try:
    main()
except KeyboardInterrupt:
    sys.exit(130)
