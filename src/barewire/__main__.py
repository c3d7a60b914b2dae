"""`python -m barewire`, the same as `barewire`."""

from barewire.cli import main

main()
