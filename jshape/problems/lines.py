"""Lines of a problem file's keys, and the error for a wrong one."""

import re
from pathlib import Path

from jshape.problems.limits import LENGTH


class ProblemError(ValueError):
    """A problem file that cannot be used; the message names the file, the line and the key."""


class Lines:
    """The line of each key of a TOML file, for error messages."""

    def __init__(self, path: Path, text: str):
        self.path = path
        self.lines: dict[tuple[str, ...], int] = {}
        table: tuple[str, ...] = ()
        for number, line in enumerate(text.splitlines(), start=1):
            header = re.match(r"\s*\[\[?([^\]]+)\]", line)
            pair = re.match(r"\s*((?:\"[^\"]*\"|'[^']*'|[\w-]+)(?:\s*\.\s*(?:\"[^\"]*\"|'[^']*'|[\w-]+))*)\s*=", line)
            if header:
                table = self._split(header[1])
                self.lines.setdefault(table, number)
            elif pair:
                self.lines.setdefault((*table, *self._split(pair[1])), number)

    @staticmethod
    def _split(key: str) -> tuple[str, ...]:
        return tuple(part.strip("\"'") for part in re.findall(r"\"[^\"]*\"|'[^']*'|[\w-]+", key))

    def error(self, keys: list[str], message: str) -> ProblemError:
        """The error at that key, or at the nearest table around it that has a line."""
        if len(message) > LENGTH:
            message = f"{message[:LENGTH]} ..."
        for length in range(len(keys), 0, -1):
            line = self.lines.get(tuple(".".join(keys[:length]).split("."))) or self.lines.get(tuple(keys[:length]))
            if line is not None:
                return ProblemError(f"{self.path}:{line}: {'.'.join(keys)}: {message}")
        return ProblemError(f"{self.path}: {'.'.join(keys)}{': ' if keys else ''}{message}")
