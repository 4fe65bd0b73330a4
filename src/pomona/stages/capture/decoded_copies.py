"""Small copies of photos in memory: a run looks at each photo many times, and most of what that takes is decoding."""

from __future__ import annotations

import random
from collections.abc import Hashable
from threading import Lock

from cachetools import RRCache

from pomona.basics.arrays import ByteArray

# Copies of an 18-megapixel photo at a quarter of its size take 3.4 MB; larger ones are needed once.
_LARGEST_BYTES, _KEPT_BYTES = 6_000_000, 400_000_000


class DecodedCopies:
    """Arrays by what they were decoded from, at most `kept_bytes` of them, none larger than `largest_bytes`.

    Where there are more, any of them goes: stages take photos one after the other, so that a copy that was not asked
    for the longest is the one that is asked for next. Threads may share it.
    """

    def __init__(self, largest_bytes: int = _LARGEST_BYTES, kept_bytes: int = _KEPT_BYTES) -> None:
        self._largest_bytes = largest_bytes
        self._copies: RRCache[Hashable, ByteArray] = RRCache(
            kept_bytes, random.Random(0).choice, getsizeof=lambda pixels: pixels.nbytes
        )
        self._lock = Lock()

    def get(self, key: Hashable) -> ByteArray | None:
        """Return the copy of a key, or None."""
        with self._lock:
            return self._copies.get(key)

    def fits(self, pixels: ByteArray) -> bool:
        """Say whether an array is small enough to be kept."""
        return pixels.nbytes <= self._largest_bytes

    def keep(self, key: Hashable, pixels: ByteArray) -> None:
        """Keep an array that fits; from then on nobody can write to it."""
        pixels.setflags(write=False)
        with self._lock:
            self._copies[key] = pixels
