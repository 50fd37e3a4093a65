"""What JAX keeps of its own compiled programs, protected: written whole, and damage and copies are noticed.

JAX runs the machine code that lies there. Where it checks that itself, delete this file.
"""

import hashlib
from pathlib import Path
from typing import Any

from jshape._files import whole

SEAL = b"jshape-entry 1"
"""With what a seal of an entry that JAX keeps begins."""


def protect() -> None:
    """Have JAX protect what it keeps, in this process."""
    _see_damage()
    _keep_whole()


def _see_damage() -> None:
    """Have JAX pack what it compiles with zlib, whose checksum shows damage.

    Where it finds zstd (Python 3.14, the package zstandard) it takes that, without one: of entries with a flipped bit
    half unpack to other machine code, which is run.
    """
    from jax._src import compilation_cache

    for name in ("zstd", "zstandard"):
        if getattr(compilation_cache, name, None) is not None:
            setattr(compilation_cache, name, None)


def _keep_whole() -> None:
    """Have JAX write what it keeps whole, in the place of a damaged entry, too, and with a seal that names the entry.

    A full disk and a process that is killed would leave half of one, which it does not write over: every later process
    would compile that program. A copy of another entry would be run in its place. Entries without a seal are of
    processes without jshape, which read ours as well: what follows compressed data is left alone.
    """
    from jax._src import lru_cache

    put, get = lru_cache.LRUCache.put, lru_cache.LRUCache.get
    if put.__module__ == __name__:
        return

    def put_whole(self: Any, key: str, value: bytes) -> None:
        if self.eviction_enabled or "://" in str(self.path):
            # Its user limits what is kept, or it is no folder: JAX's own way.
            put(self, key, value)
            return
        with whole(Path(self.path) / f"{key}-cache") as file:
            file.write(value + seal(key, value))

    def get_sealed(self: Any, key: str) -> bytes | None:
        found = get(self, key)
        size = len(SEAL) + hashlib.sha256().digest_size
        if found is None or found[-size:][: len(SEAL)] != SEAL:
            return found
        value = found[:-size]
        return value if found == value + seal(key, value) else None

    lru_cache.LRUCache.put, lru_cache.LRUCache.get = put_whole, get_sealed


def seal(key: str, value: bytes) -> bytes:
    """What stands behind an entry: it names the entry and its content."""
    return SEAL + hashlib.sha256(key.encode() + value).digest()
