"""`python -m barewire.cli`, the same as `barewire`."""

from barewire.cli import main

main()
