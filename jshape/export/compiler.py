"""A C compiler of this machine, for what is exported as a library."""

import importlib.util
import platform
import shutil
import subprocess
import sys
from pathlib import Path

FLAGS = ["-std=c99", "-O2", "-shared", "-fPIC", "-fvisibility=hidden"]

_MACHINES = {"amd64": "x86_64", "arm64": "aarch64"}
_SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "win32": ("windows", ".dll")}


def compiler() -> list[str]:
    """The command of a C compiler: ``cc``, ``gcc`` or ``clang`` of the machine, else ``zig cc`` of PyPI's ``ziglang``.

    Raises:
        ValueError: where there is none.
    """
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name):
            return [name]
    if importlib.util.find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "cc"]
    raise ValueError("no C compiler was found: install gcc or clang, or pip install ziglang")


def target() -> tuple[str, str, str]:
    """Machine, system and ending of libraries here, as FMI 3.0 names them: ``("x86_64", "linux", ".so")``."""
    machine = platform.machine().lower()
    system, ending = _SYSTEMS.get(sys.platform, _SYSTEMS["linux"])
    return _MACHINES.get(machine, machine), system, ending


def library(folder: Path, source: str, name: str) -> bytes:
    """A source file of a folder, compiled into a shared library.

    Args:
        folder: with all that the source includes.
        source: the file's name.
        name: of the library, without ending.

    Raises:
        ValueError: where there is no compiler, and with the compiler's own words where it fails.
    """
    path = folder / f"{name}{target()[2]}"
    command = [*compiler(), *FLAGS, source, "-o", path.name, "-lm"]
    built = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    if built.returncode:
        raise ValueError(f"{' '.join(command)} failed: {built.stderr.strip()}")
    return path.read_bytes()
