"""``python -m jshape`` is the command line."""

from jshape.cli import main

main()
