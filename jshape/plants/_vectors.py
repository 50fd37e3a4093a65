"""Vectors of three entries, each a number that is part of a program (``float``) or an array.

Zeros and ones among the numbers are left out when an expression is written down: a planar machine stays planar, and
its equation in space is as short as the one that is written by hand in the plane. XLA does not do so by itself, as 0
times an infinite number is not 0.
"""

from typing import Any, NamedTuple

import numpy as np

Entry = Any
"""A float, or an array (NumPy's or JAX's)."""

Vector = tuple[Entry, Entry, Entry]

Matrix = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]

ZERO: Vector = (0.0, 0.0, 0.0)

IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def is_number(value: Entry, number: float) -> bool:
    """Whether a value is that number in the program itself, whatever the arrays are."""
    return type(value) is float and value == number


def plus(a: Entry, b: Entry) -> Entry:
    """a + b."""
    return b if is_number(a, 0.0) else a if is_number(b, 0.0) else a + b


def minus(a: Entry, b: Entry) -> Entry:
    """a − b."""
    if a is b:
        return 0.0
    return a if is_number(b, 0.0) else -b if is_number(a, 0.0) else a - b


def times(a: Entry, b: Entry) -> Entry:
    """a b."""
    if is_number(a, 0.0) or is_number(b, 0.0):
        return 0.0
    if is_number(a, 1.0) or is_number(b, 1.0):
        return b if is_number(a, 1.0) else a
    return -b if is_number(a, -1.0) else -a if is_number(b, -1.0) else a * b


def added(*vectors: Vector) -> Vector:
    """The sum of vectors."""
    x, y, z = vectors[0]
    for u, v, w in vectors[1:]:
        x, y, z = plus(x, u), plus(y, v), plus(z, w)
    return x, y, z


def subtracted(a: Vector, b: Vector) -> Vector:
    """a − b."""
    return minus(a[0], b[0]), minus(a[1], b[1]), minus(a[2], b[2])


def scaled(s: Entry, a: Vector) -> Vector:
    """s a."""
    return times(s, a[0]), times(s, a[1]), times(s, a[2])


def dot(a: Vector, b: Vector) -> Entry:
    """a · b."""
    return plus(plus(times(a[0], b[0]), times(a[1], b[1])), times(a[2], b[2]))


def cross(a: Vector, b: Vector) -> Vector:
    """a × b."""
    return (
        minus(times(a[1], b[2]), times(a[2], b[1])),
        minus(times(a[2], b[0]), times(a[0], b[2])),
        minus(times(a[0], b[1]), times(a[1], b[0])),
    )


def turned(matrix: Matrix, a: Vector) -> Vector:
    """The matrix times the vector."""
    return dot(matrix[0], a), dot(matrix[1], a), dot(matrix[2], a)


def transposed(matrix: Matrix) -> Matrix:
    """The transpose, of a rotation its inverse."""
    x, y, z = zip(*matrix, strict=True)
    return x, y, z


class Angle(NamedTuple):
    """Cosine and sine of an angle; or of what both change by."""

    cosine: Entry
    sine: Entry


def rotated(axis: Vector, angle: Angle, a: Vector) -> Vector:
    """A vector turned about a unit vector, by Rodrigues' formula."""
    along = scaled(dot(axis, a), axis)
    return added(along, change(axis, angle, a))


def change(axis: Vector, angle: Angle, a: Vector) -> Vector:
    """The rotated part of a vector across the axis; linear in cosine and sine."""
    across = subtracted(a, scaled(dot(axis, a), axis))
    return added(scaled(angle.cosine, across), scaled(angle.sine, cross(axis, a)))


def plain(values: Any) -> Vector:
    """Three numbers as floats; what is 10¹² times smaller than the greatest is rounding and becomes 0."""
    numbers = np.asarray(values, float)
    least = 1e-12 * np.max(np.abs(numbers), initial=0.0)
    x, y, z = (float(value) if abs(value) > least else 0.0 for value in numbers)
    return x, y, z


def rotation(quaternion: Any) -> Matrix:
    """The rotation matrix of a unit quaternion (w, x, y, z)."""
    w, x, y, z = (float(value) for value in quaternion)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    first, second, third = (plain(row) for row in rows)
    return first, second, third


def solved(matrix: list[list[Any]], right: list[Any]) -> tuple[list[Any], list[Any]]:
    """The solution x of A x = b for a positive definite A, by L D Lᵀ, and the pivots D.

    Args:
        matrix: A, of which the lower triangle is read.
        right: b.
    """
    count = len(right)
    lower: list[list[Any]] = [[0.0] * count for _ in range(count)]
    pivots: list[Any] = []
    for i in range(count):
        for j in range(i):
            rest = matrix[i][j]
            for k in range(j):
                rest = minus(rest, times(times(lower[i][k], lower[j][k]), pivots[k]))
            lower[i][j] = 0.0 if is_number(rest, 0.0) else rest / pivots[j]
        pivot = matrix[i][i]
        for k in range(i):
            pivot = minus(pivot, times(times(lower[i][k], lower[i][k]), pivots[k]))
        pivots.append(pivot)
    x = list(right)
    for i in range(count):
        for k in range(i):
            x[i] = minus(x[i], times(lower[i][k], x[k]))
    x = [value / pivot for value, pivot in zip(x, pivots, strict=True)]
    for i in range(count - 1, -1, -1):
        for k in range(i + 1, count):
            x[i] = minus(x[i], times(lower[k][i], x[k]))
    return x, pivots
