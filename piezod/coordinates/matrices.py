"""Small square matrices, as tuples of rows."""

from collections.abc import Mapping, Sequence
from math import inf
from typing import TypeAlias

Vector: TypeAlias = Sequence[float]
Matrix: TypeAlias = tuple[tuple[float, ...], ...]
"""Rows of a matrix, each with one number for each column."""


def identity(size: int) -> Matrix:
    """Return the matrix that changes nothing."""
    return tuple(tuple(float(i == j) for j in range(size)) for i in range(size))


def from_rows(
    rows: Mapping[str, Mapping[str, float]], names: Sequence[str], columns: Sequence[str]
) -> Matrix:
    """Return the matrix of named rows; a number that is not named is 0.

    Args:
        rows: Row by name, its numbers by the names of the columns.
        names: Names of the rows, in order.
        columns: Names of the columns, in order.
    """
    return tuple(tuple(rows.get(row, {}).get(each, 0.0) for each in columns) for row in names)


def times(matrix: Matrix, vector: Vector) -> list[float]:
    """Return the product of a matrix and a vector. Real-time safe."""
    return [
        sum([factor * value for factor, value in zip(row, vector, strict=True)]) for row in matrix
    ]


def product(left: Matrix, right: Matrix) -> Matrix:
    """Return the product of two matrices."""
    columns = list(zip(*right, strict=True))
    return tuple(tuple(times(tuple(columns), row)) for row in left)


def inverse(matrix: Matrix) -> Matrix | None:
    """Return the inverse, by Gauss and Jordan with pivots; None if the matrix is singular."""
    size = len(matrix)
    rows = [[*row, *unit] for row, unit in zip(matrix, identity(size), strict=True)]
    for column in range(size):
        pivot = max(range(column, size), key=lambda i: abs(rows[i][column]))
        if not abs(rows[pivot][column]) > 0.0:
            return None
        rows[column], rows[pivot] = rows[pivot], rows[column]
        scale = rows[column][column]
        rows[column] = [value / scale for value in rows[column]]
        for i in range(size):
            if i != column and (factor := rows[i][column]):
                pairs = zip(rows[i], rows[column], strict=True)
                rows[i] = [value - factor * of_pivot for value, of_pivot in pairs]
    return tuple(tuple(row[size:]) for row in rows)


def condition(matrix: Matrix) -> float:
    """Return by how much a matrix and its inverse together enlarge an error, at least 1.

    Columns and rows are scaled to 1 before, so that units do not count; infinity if it is singular.
    """
    scaled = _rows_to_one(tuple(zip(*_rows_to_one(tuple(zip(*matrix, strict=True))), strict=True)))
    inverted = inverse(scaled)
    return inf if inverted is None else _norm(scaled) * _norm(inverted)


def _norm(matrix: Matrix) -> float:
    return max(sum(map(abs, row)) for row in matrix)


def _rows_to_one(matrix: Matrix) -> Matrix:
    largest = [max(map(abs, row)) or 1.0 for row in matrix]
    return tuple(
        tuple(value / most for value in row) for row, most in zip(matrix, largest, strict=True)
    )
