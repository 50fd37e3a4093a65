"""Files damaged at random, as disks, transfers and editors damage them."""

import numpy as np

KINDS = ("bit", "byte", "cut", "drop", "insert", "repeat", "zeros", "random", "empty", "swap")


def damaged(content: bytes, random: np.random.Generator) -> bytes:
    """A file's content with one fault: a bit flipped, an end missing, a block moved, replaced, dropped or repeated.

    Args:
        content: of the file.
        random: chooses the kind of fault and its place.
    """
    data, kind = bytearray(content), KINDS[random.integers(len(KINDS))]
    first, last = sorted(random.integers(0, len(data) + 1, 2).tolist())
    last = min(last, first + 512)
    if kind == "empty" or not data:
        return b""
    if kind in ("bit", "byte"):
        place = int(random.integers(len(data)))
        data[place] ^= 1 << int(random.integers(8)) if kind == "bit" else int(random.integers(1, 256))
    elif kind == "cut":
        del data[first:]
    elif kind == "drop":
        del data[first:last]
    elif kind == "insert":
        data[first:first] = random.bytes(int(random.integers(1, 64)))
    elif kind == "repeat":
        data[last:last] = data[first:last]
    elif kind == "zeros":
        data[first:last] = bytes(last - first)
    elif kind == "random":
        data[first:last] = random.bytes(last - first)
    else:
        place = int(random.integers(len(data)))
        data[first:last], data[place:place] = b"", data[first:last]
    return bytes(data)
