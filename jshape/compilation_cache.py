"""Programs that are kept from one process to the next: ``js.keep_programs()``, which the command line does by itself.

JAX keeps what it has compiled in a folder, but to look there it has to trace the function and lower it again, which
for a command that computes for two seconds takes three more. Functions marked ``kept`` are exported into a folder
beside that, after which another process finds them without running a line of them. Nothing is kept where nobody asked
for it, or of code that is not jshape's own: nobody could tell whether that has changed.
"""

import contextlib
import functools
import hashlib
import io
import os
import pickle
import shutil
import sys
import time
import types
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.export

from jshape import _check
from jshape._files import whole

P = ParamSpec("P")
R = TypeVar("R")

_LIBRARIES = ("jax", "jaxlib", "equinox", "diffrax", "optimistix", "lineax", "numpy", "jaxtyping")
"""Whose code is traced besides jshape's own; their versions belong to a program's name, jshape's source does too."""

_KNOWN = {"jshape", "builtins", "collections", *_LIBRARIES}
"""What a program may be made of to be kept."""

_UNGUARDED = ("lapack_dormqr_ffi", "lapack_sormqr_ffi")
"""Calls that JAX does not promise to other versions of itself; a program never meets one."""

_DAYS = 30
"""Programs of another version that nobody has used for so long are deleted."""

_shelf: Path | None = None
"""Where programs are kept, if they are."""


def keep_programs(folder: str | Path | None = None) -> None:
    """Keep this process's programs for the next ones, and find those of earlier ones; call it before anything else.

    ``folder``: where; unless given, where JAX keeps its own (``JAX_COMPILATION_CACHE_DIR``), or else the user's cache
    folder. There JAX keeps what it compiles, and jshape in ``programs`` what it has traced: for a process that computes
    little, three quarters of its time. A folder that cannot be written to keeps nothing; programs of other versions go
    when nobody has used them for 30 days.
    """
    if folder is None:
        settled = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
        folder = _users_cache() if settled is None else settled
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    # JAX takes addresses, and an empty name for "keep nothing", too.
    if str(folder) and "://" not in str(folder):
        _open(Path(folder) / "programs")


def _users_cache() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or base
    return Path(base) / "jshape"


def _open(folder: Path) -> None:
    global _shelf
    _shelf = folder / _stamp()
    try:
        if not _shelf.exists():
            _shelf.mkdir(parents=True)
            for other in folder.iterdir():
                if time.time() - other.stat().st_mtime > _DAYS * 86400:
                    shutil.rmtree(other, ignore_errors=True)
        os.utime(_shelf)
    except OSError:
        # A folder that cannot be written to keeps nothing.
        _shelf = None


def kept(function: Callable[P, R]) -> Callable[P, R]:
    """``eqx.filter_jit`` of a function of a module, whose programs are kept where a folder was named.

    All arrays are traced, everything else is part of the program. What the function returns consists of arrays.
    """
    plain: Any = eqx.filter_jit(function)
    programs: dict[Any, Callable[[list], Any] | None] = {}

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        if _shelf is None:
            return plain(*args, **kwargs)
        leaves, tree = jax.tree.flatten((args, kwargs))
        if not _check.is_concrete(leaves):
            return plain(*args, **kwargs)
        # Precision and the like, as they hold here and now.
        settings = tuple(getattr(jax.config, name, None) for name in jax.config.values)
        kinds = tuple(_Array.of(leaf) if eqx.is_array(leaf) else (type(leaf), leaf) for leaf in leaves)
        if (tree, kinds, settings) not in programs:
            programs[tree, kinds, settings] = _program(function, leaves, tree, settings, _shelf)
        program = programs[tree, kinds, settings]
        return plain(*args, **kwargs) if program is None else program([leaf for leaf in leaves if eqx.is_array(leaf)])

    return call


class _Array(NamedTuple):
    """What a program depends on of an array."""

    shape: tuple[int, ...]
    dtype: Any
    weak: bool

    @classmethod
    def of(cls, array: Any) -> "_Array":
        kind = jax.typeof(array)
        return cls(kind.shape, kind.dtype, kind.weak_type)


def _program(function: Callable, leaves: list, tree: Any, settings: Any, shelf: Path) -> Callable[[list], Any] | None:
    """What computes the function of the arrays among the leaves; ``None`` where it cannot be kept."""
    named = jax.tree.unflatten(tree, [_Array.of(leaf) if eqx.is_array(leaf) else leaf for leaf in leaves])
    name = f"{function.__module__}.{function.__qualname__}"
    words = _words((name, named, repr(settings), jax.default_backend(), jax.local_device_count()))
    if words is None:
        return None
    path = shelf / f"{name}-{hashlib.sha256(words).hexdigest()[:32]}"
    try:
        result, code = pickle.loads(path.read_bytes())
        exported = jax.export.deserialize(code)
    except Exception:  # It is not there, or no longer readable.
        try:
            result, exported = _export(function, leaves, tree)
            if exported.nr_devices > 1:
                # It could be called from among as many devices only.
                return None
            with contextlib.suppress(OSError), whole(path) as file:
                pickle.dump((result, bytes(exported.serialize())), file)
        except Exception:  # What stands in the way, if it is an error at all, the plain call tells.
            return None
    structure = jax.tree.structure(result)
    run = jax.jit(_named(function.__name__, lambda *arrays: exported.call(*arrays)))
    return lambda arrays: jax.tree.unflatten(structure, run(*arrays))


def _named(name: str, function: Any) -> Any:
    """The function under the name that its programs bear in logs and profiles."""
    function.__name__ = name
    return function


def _export(function: Callable, leaves: list, tree: Any) -> tuple[Any, jax.export.Exported]:
    """The program, and the shape of what it returns: the same with a number in each array's place."""
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


def _words(value: Any) -> bytes | None:
    """Everything that makes a program this one, in bytes; ``None`` where something in it is not ours."""
    file = io.BytesIO()
    pickler = _Pickler(file)
    # Equal values are written alike, whether they are one object or several.
    pickler.fast = True
    try:
        pickler.dump(value)
    except (pickle.PicklingError, AttributeError, TypeError, RecursionError):
        return None
    return file.getvalue()


class _Pickler(pickle.Pickler):
    def reducer_override(self, obj: Any) -> Any:
        # Classes and functions are written by name: what the name stands for must be covered by the stamp.
        named = isinstance(obj, type | types.FunctionType | types.BuiltinFunctionType)
        if named and str(obj.__module__).partition(".")[0] not in _KNOWN:
            raise pickle.PicklingError(f"{obj.__module__}.{obj.__qualname__} is not ours")
        return NotImplemented


def _stamp() -> str:
    """A name for the code that programs come from: Python's, the libraries', jshape's own; and XLA's flags."""
    versions = [(name, version(name)) for name in _LIBRARIES]
    stamp = hashlib.sha256(f"{sys.version} {versions} {os.environ.get('XLA_FLAGS')}".encode())
    root = Path(__file__).parent
    for file in sorted(root.rglob("*.py")):
        stamp.update(str(file.relative_to(root)).encode() + file.read_bytes())
    return stamp.hexdigest()[:32]
