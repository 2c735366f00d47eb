"""Bit mixing, for the home ranks of keys and for checksums."""

import numpy as np
import numpy.typing as npt

#: 2^64 over the golden ratio, odd, with evenly spread multiples (D. E. Knuth, The Art of Computer Programming 3, 6.4).
GOLDEN = np.uint64(0x9E3779B97F4A7C15)


def mixed(numbers: npt.NDArray[np.int64 | np.uint64]) -> npt.NDArray[np.uint64]:
    """Hash of each number; its high bits depend on all bits of the number.  Local."""
    bits = numbers.astype(np.uint64)
    return (bits ^ bits >> np.uint64(32)) * GOLDEN
