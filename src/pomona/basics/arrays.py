"""Shape checks for the values that flow between stages, arrays of groups, subsets, and what is usual in numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from math import comb
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from pomona.errors import InputError

T = TypeVar("T")

Array = npt.NDArray[Any]
FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
ByteArray = npt.NDArray[np.uint8]
Float32Array = npt.NDArray[np.float32]


def groups(labels: IntArray) -> list[tuple[int, IntArray]]:
    """Return each label that occurs in `labels` (n,), in order, and where it does, in order."""
    order = np.argsort(labels, kind="stable")
    found, starts = np.unique(labels[order], return_index=True)
    return list(zip(found.tolist(), np.split(order, starts[1:]) if len(found) else [], strict=True))


def places_within(counts: IntArray) -> IntArray:
    """Return 0, 1, … `counts[0]` − 1, 0, 1, … `counts[1]` − 1, and so on: each one's place within its group."""
    return np.asarray(np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts), np.int64)


def among(values: IntArray, ordered: IntArray) -> BoolArray:
    """Say of each value (n,) whether it is one of `ordered` (m,), which rise: unlike `np.isin`, without reading all."""
    if len(ordered) == 0:
        return np.zeros(len(values), bool)
    places = np.minimum(np.searchsorted(ordered, values), len(ordered) - 1)
    return np.asarray(ordered[places] == values, bool)


def weighted_median(values: FloatArray, weights: FloatArray) -> float:
    """Return the value of n ≥ 1 (n,) up to which half of the weights (n,) are."""
    order = np.argsort(values, kind="stable")
    cumulated = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(cumulated, cumulated[-1] / 2)])


SD_OF_MAD = 1.4826
"""From the median of absolute deviations to the standard deviation, of values that scatter normally."""


def robust_sd(values: FloatArray) -> float:
    """Return the standard deviation of values (n,) by the median of their absolute deviations from the median."""
    return SD_OF_MAD * float(np.median(np.abs(values - float(np.median(values)))))


def some_subsets(n: int, k: int, most: int) -> list[tuple[int, ...]]:
    """Return the subsets of `k` of 0 … `n` − 1, in rising order; where there are more than `most`, so many by chance.

    The same each time. What is not returned is never made: of a thousand there are 166 million triples.
    """
    count = comb(n, k)
    if count <= most:
        return list(combinations(range(n), k))
    chosen = np.random.default_rng(0).choice(count, most, replace=False, shuffle=False)
    return [_subset(n, k, rank) for rank in np.sort(chosen).tolist()]


def _subset(n: int, k: int, rank: int) -> tuple[int, ...]:
    """The subset that `combinations(range(n), k)` yields after `rank` others."""
    found, first = [], 0
    for left in range(k - 1, -1, -1):
        while rank >= (skipped := comb(n - first - 1, left)):
            rank -= skipped
            first += 1
        found.append(first)
        first += 1
    return tuple(found)


class OneLine:
    """Values that say how much they hold in one line, where a dataclass would print every array and mask.

    A dataclass of it is declared with `repr=False`.
    """

    _one = "entry"

    def __len__(self) -> int:
        raise NotImplementedError

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._holds()})"

    def _holds(self) -> str:
        return counted(len(self), self._one)


def counted(n: int, one: str) -> str:
    """Return a number with what it counts: 1 fruit, 2 fruits, 1,000 fruits."""
    return f"{n:,} {one}{'' if n == 1 else 's'}"


def to_digits(value: float, digits: int, *, mark: str = ",") -> str:
    """Return a number to so many digits that count, or to a whole one: of three, 0.123, 12.3, 1,234; no 1.23e+03."""
    return f"{value:.{digits}g}" if abs(value) < 10**digits - 0.5 else f"{value:{mark}.0f}"


def batches(items: Sequence[T], size: int) -> Iterator[Sequence[T]]:
    """Yield items in turn, `size` at once; the last ones may be fewer."""
    for start in range(0, len(items), size):
        yield items[start : start + size]


def chosen(n: int, selection: Any) -> IntArray:
    """Return the indices of 0 … `n` − 1 that a selection takes: a boolean array, indices, a slice, or one index."""
    return np.asarray(np.atleast_1d(np.arange(n)[selection]))


def checked(name: str, value: Any, shape: tuple[int | None, ...], dtype: Any) -> Array:
    """Return `value` as a read-only array of `dtype`, or raise `InputError` saying both shapes.

    `shape` holds an int where the length is fixed and None where it is free.
    """
    array = np.asarray(value, dtype=dtype)
    if array.size == 0 and array.ndim != len(shape):
        array = array.reshape(tuple(0 if length is None else length for length in shape))
    fits = array.ndim == len(shape) and all(
        want is None or want == have for want, have in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = "(" + ", ".join("n" if length is None else str(length) for length in shape) + ")"
        raise InputError(f"{name}: expected an array of shape {wanted}, found {array.shape}")
    if array.flags.writeable:
        array = array.view()
        array.flags.writeable = False
    return array


def set_checked(target: object, name: str, shape: tuple[int | None, ...], dtype: Any) -> None:
    """Check field `name` of the frozen dataclass `target` and store it as a read-only array."""
    label = f"{type(target).__name__}.{name}"
    object.__setattr__(target, name, checked(label, getattr(target, name), shape, dtype))
