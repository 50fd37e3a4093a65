"""The entry of the command line, also of ``python -m jshape``."""

import sys


def main() -> None:
    """Run the command line; an interrupt while it is being loaded ends it without a traceback."""
    try:
        from jshape import cli
    except KeyboardInterrupt:
        sys.exit(130)
    cli.main()


if __name__ == "__main__":
    main()
