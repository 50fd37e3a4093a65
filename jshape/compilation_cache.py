"""Programs kept from one process to the next: ``js.keep_programs()``, which the command line calls by itself.

This file stands for speed alone: a second ``jshape tune`` of a shipped problem takes two seconds in the place of five.
JAX keeps what it has compiled in a folder, but to look there it has to trace the function and lower it again. Functions
marked ``kept`` are exported into a folder beside that, after which another process finds them without running a line
of them. Once JAX finds its programs without tracing, delete this file and put ``eqx.filter_jit`` in the place of
``kept``.

A kept program is data: a SHA-256 digest, a line of JSON that says which program it is and how the result is put
together, and what ``jax.export`` writes. A file that is damaged, of another version, or a copy of another one is
computed again and overwritten. Nothing is
kept where nobody asked for it, of code that is not jshape's own (nobody could tell whether that has changed), or in a
folder that others may write to.
"""

import contextlib
import dataclasses
import functools
import hashlib
import importlib
import json
import os
import shutil
import sys
import threading
import time
import types
import warnings
from collections.abc import Callable
from enum import Enum
from importlib.metadata import version
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.export
import numpy as np

from jshape import _check
from jshape._compiling import LARGE, LEAN, MANY, compile_lean
from jshape._files import whole
from jshape._jax_cache import protect

try:
    from jax._src.core import trace_state_clean
except ImportError:  # Not of JAX's public interface: without it every program is compiled as a part of another one is.

    def trace_state_clean() -> bool:
        return False


try:
    from jax._src.config import trace_context
except ImportError:  # In forty times the time.

    def trace_context() -> Any:
        return tuple(getattr(jax.config, name, None) for name in jax.config.values)


P = ParamSpec("P")
R = TypeVar("R")

_FORMAT = "jshape-program 2"

_LIBRARIES = ("jax", "jaxlib", "equinox", "diffrax", "optimistix", "lineax", "numpy", "jaxtyping")
"""Whose code is traced besides jshape's own; their versions belong to a program's name, jshape's source does too."""

_KNOWN = {"jshape", "builtins", "collections", *_LIBRARIES}
"""What a program may be made of to be kept."""

_UNGUARDED = ("lapack_dormqr_ffi", "lapack_sormqr_ffi")
"""Calls that JAX does not promise to other versions of itself; a program never meets one."""

_DAYS = 30
"""Programs of another version that nobody has used for so long are deleted."""

_TRACING = threading.RLock()
"""Python traces one function at a time: in turns, the first program is compiled while the second one is traced."""

_folder: Path | None = None
"""Where programs are kept, if they are."""


def keep_programs(folder: str | Path | None = None) -> None:
    """Keep this process's programs for the next ones, and find those of earlier ones; call it before anything else.

    There JAX keeps what it compiles, and jshape in ``programs`` what it has traced: for a process that computes
    little, three quarters of its time. Where XLA has not begun yet, its programs run faster, too: ``XLA_FLAGS`` takes
    in the flags of ``_compiling.WHOLE``, but for those that it names. A folder that cannot be written to, or that
    others may write to, keeps nothing; programs of other versions go when nobody has used them for 30 days.

    Args:
        folder: where JAX keeps its own (``JAX_COMPILATION_CACHE_DIR``), or else the user's cache folder, unless given.
    """
    global _folder
    _check.instance(folder, "folder", str | os.PathLike | None, "a path")
    _folder = None
    compile_lean()
    if folder is None:
        folder = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    if folder is None:
        try:
            folder = _private_folder(_users_cache())
        except RuntimeError:
            # A user without a home.
            return
    # JAX takes addresses, and an empty name for "keep nothing", too.
    local = bool(str(folder)) and "://" not in str(folder)
    if local and _made(Path(folder)).is_dir() and not _private(Path(folder)):
        warnings.warn(f"{folder}: others may write to it, so no programs are kept there", stacklevel=2)
        return
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    # On a full disk, too, and where an entry was damaged, a command says its own line alone.
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache entry")
    protect()
    if local:
        _open(Path(folder) / "programs")


def _users_cache() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or base
    return Path(base) / "jshape"


def _private_folder(folder: Path) -> Path:
    """The same folder, made where there is none; its user alone may write to it, where the system has such rights."""
    # One that cannot be made, or is another's, keeps nothing.
    with contextlib.suppress(OSError):
        if hasattr(os, "getuid") and _made(folder).stat().st_uid == os.getuid():
            folder.chmod(folder.stat().st_mode & ~0o022)
    return folder


def _made(folder: Path) -> Path:
    """The same folder; it, and those above it, are made for their user alone where there are none."""
    with contextlib.suppress(OSError):
        for part in reversed((folder, *folder.parents)):
            part.mkdir(mode=0o700, exist_ok=True)
    return folder


def _open(folder: Path) -> None:
    global _folder
    _folder = None
    own = folder / _stamp()
    try:
        first = not own.exists()
        for part in (folder, own):
            if not _private(_made(part)):
                warnings.warn(f"{part}: others may write to it, so no programs are kept there", stacklevel=3)
                return
        for other in folder.iterdir() if first else ():
            if time.time() - other.stat().st_mtime > _DAYS * 86400:
                shutil.rmtree(other, ignore_errors=True)
        os.utime(own)
    except OSError:
        # A folder that cannot be written to keeps nothing.
        return
    _folder = own


def _private(folder: Path) -> bool:
    """Whether nobody else owns a folder or may write to it, where the system can say so."""
    if not hasattr(os, "getuid"):
        return True
    about = folder.stat()
    return about.st_uid == os.getuid() and not about.st_mode & 0o022


def kept(function: Callable[P, R]) -> Callable[P, R]:
    """``eqx.filter_jit`` of a function of a module, whose programs are kept where a folder was named.

    All arrays are traced, everything else is part of the program. What the function returns consists of arrays.
    """
    jit: Any = eqx.filter_jit
    plain, lean, large = jit(function), jit(function, compiler_options=LEAN), jit(function, compiler_options=LARGE)
    programs: dict[Any, Callable[[list], Any] | None] = {}

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        leaves, tree = jax.tree.flatten((args, kwargs))
        if not _check.is_concrete(leaves) or not trace_state_clean():
            # A part of another program, whose options hold.
            return plain(*args, **kwargs)
        if _folder is None:
            options = _options(leaves)
            return (plain if options is None else large if options is LARGE else lean)(*args, **kwargs)
        # Precision and the like, as they hold here and now.
        settings = trace_context()
        kinds = tuple(_kind(leaf) for leaf in leaves)
        if (tree, kinds, settings) not in programs:
            programs[tree, kinds, settings] = _program(function, leaves, tree, _folder)
        program = programs[tree, kinds, settings]
        return plain(*args, **kwargs) if program is None else program([leaf for leaf in leaves if eqx.is_array(leaf)])

    return call


def _options(leaves: list) -> dict[str, str | bool | int] | None:
    """How XLA compiles a program of these arguments."""
    if jax.default_backend() != "cpu":
        return None
    return LARGE if any(eqx.is_array(leaf) and leaf.size >= MANY for leaf in leaves) else LEAN


def _kind(leaf: Any) -> Any:
    """What of a leaf a program depends on, as a part of its key in this process: looked up at every call."""
    if isinstance(leaf, np.ndarray | np.generic):
        # What ``jax.typeof`` makes of them, in a tenth of the time.
        return leaf.shape, leaf.dtype, False
    if isinstance(leaf, jax.Array):
        return leaf.shape, leaf.dtype, leaf.aval.weak_type
    return type(leaf), leaf


def _program(function: Callable, leaves: list, tree: Any, folder: Path) -> Callable[[list], Any] | None:
    """What computes the function of the arrays among the leaves; ``None`` where it cannot be kept."""
    kinds = [{"array": repr(jax.typeof(leaf))} if eqx.is_array(leaf) else leaf for leaf in leaves]
    named = jax.tree.unflatten(tree, kinds)
    name = f"{function.__module__}.{function.__qualname__}"
    settings = [getattr(jax.config, name, None) for name in jax.config.values]
    try:
        key = repr(_describe((name, named, repr(settings), jax.default_backend(), jax.local_device_count())))
    except _NotOursError:
        return None
    path = folder / f"{name}-{hashlib.sha256(key.encode()).hexdigest()[:32]}"
    try:
        result, exported = _read(path)
    except Exception:  # It is not there, or damaged.
        try:
            with _TRACING:
                result, exported = _export(function, leaves, tree)
            if exported.nr_devices > 1:
                # It could be called from among as many devices only.
                return None
            with contextlib.suppress(OSError):
                _write(path, result, exported)
        except Exception:  # What stands in the way, if it is an error at all, the plain call reports.
            return None
    structure = jax.tree.structure(result)
    options: Any = _options(leaves)
    run = jax.jit(_named(function.__name__, lambda *arrays: exported.call(*arrays)), compiler_options=options)
    return lambda arrays: jax.tree.unflatten(structure, run(*arrays))


def _named(name: str, function: Any) -> Any:
    """The function under the name that its programs bear in logs and profiles."""
    function.__name__ = name
    return function


def _export(function: Callable, leaves: list, tree: Any) -> tuple[Any, jax.export.Exported]:
    """What the function returns, with a number in each array's place, and the program."""
    result: Any = None

    def flat(*arrays: Any) -> list:
        nonlocal result
        rest = iter(arrays)
        args, kwargs = jax.tree.unflatten(tree, [next(rest) if eqx.is_array(leaf) else leaf for leaf in leaves])
        found, structure = jax.tree.flatten(function(*args, **kwargs))
        result = jax.tree.unflatten(structure, range(len(found)))
        return found

    unguarded = [jax.export.DisabledSafetyCheck.custom_call(name) for name in _UNGUARDED]
    export = jax.export.export(jax.jit(_named(function.__name__, flat)), disabled_checks=unguarded)
    exported = export(*(leaf for leaf in leaves if eqx.is_array(leaf)))
    return result, exported


def _write(path: Path, result: Any, exported: jax.export.Exported) -> None:
    header = json.dumps({"format": _FORMAT, "program": _which(path), "result": _describe(result)}).encode()
    if _rebuild(json.loads(header)["result"]) != result:
        raise _NotOursError(result)
    content = header + b"\n" + exported.serialize()
    with whole(path) as file:
        file.write(hashlib.sha256(content).digest() + content)


def _read(path: Path) -> tuple[Any, jax.export.Exported]:
    """What ``_write`` wrote there. *Raises* one error or another unless all of it is there and unchanged."""
    read = path.read_bytes()
    digest, content = read[:32], read[32:]
    if hashlib.sha256(content).digest() != digest:
        raise ValueError("damaged")
    header, _, code = content.partition(b"\n")
    about = json.loads(header)
    if about["format"] != _FORMAT or about["program"] != _which(path):
        raise ValueError("of another version, or another program")
    return _rebuild(about["result"]), jax.export.deserialize(bytearray(code))


def _which(path: Path) -> str:
    """The stamp and the name of a kept program, wherever its folder lies."""
    return f"{path.parent.name}/{path.name}"


class _NotOursError(Exception):
    """Something that cannot be written down, or whose code is not jshape's or a library's."""


def _describe(value: Any) -> Any:
    """A value as plain data: containers, modules and functions by name. Equal descriptions make equal programs."""
    kind = type(value)
    if value is None or kind in (bool, int, float, str):
        return value
    if isinstance(value, np.dtype | np.generic):
        return [kind.__name__, repr(value)]
    if isinstance(value, type | types.FunctionType | types.BuiltinFunctionType):
        return ["function", _name(value)]
    if kind in (list, tuple):
        return [kind.__name__, [_describe(part) for part in value]]
    if isinstance(value, dict):
        return ["dict", {key: _describe(part) for key, part in value.items()}]
    if isinstance(value, Enum):
        parts = {"name": value.name}
    elif isinstance(value, tuple) and hasattr(value, "_asdict"):
        parts = value._asdict()  # pyright: ignore[reportAttributeAccessIssue]
    elif dataclasses.is_dataclass(value):
        parts = {field.name: getattr(value, field.name, None) for field in dataclasses.fields(value)}
    else:
        raise _NotOursError(value)
    return [_name(kind), {name: _describe(part) for name, part in parts.items()}]


def _name(value: Any) -> str:
    """The name of a class or function; what it stands for must be covered by the stamp."""
    if str(value.__module__).partition(".")[0] not in _KNOWN or "<" in value.__qualname__:
        raise _NotOursError(value)
    return f"{value.__module__}:{value.__qualname__}"


def _rebuild(described: Any) -> Any:
    """The tree of numbers of a description; its classes are jshape's own.

    Raises:
        _NotOursError: for anything else.
    """
    if not isinstance(described, list):
        return described
    name, parts = described
    if name in ("list", "tuple"):
        return {"list": list, "tuple": tuple}[name](map(_rebuild, parts))
    values = {key: _rebuild(part) for key, part in parts.items()}
    if name == "dict":
        return values
    module, _, qualname = name.partition(":")
    kind = getattr(importlib.import_module(module), qualname) if module.partition(".")[0] == "jshape" else None
    if not isinstance(kind, type) or not issubclass(kind, eqx.Module | tuple):
        raise _NotOursError(name)
    if issubclass(kind, tuple):
        return kind(**values)
    made = object.__new__(kind)
    for field, value in values.items():
        object.__setattr__(made, field, value)
    return made


def _stamp() -> str:
    """A name for the code that programs come from: Python's, the libraries', jshape's own; and XLA's flags."""
    versions = [(name, version(name)) for name in _LIBRARIES]
    stamp = hashlib.sha256(f"{sys.version} {versions} {os.environ.get('XLA_FLAGS')}".encode())
    root = Path(__file__).parent
    for file in sorted(root.rglob("*.py")):
        stamp.update(str(file.relative_to(root)).encode() + file.read_bytes())
    return stamp.hexdigest()[:32]
