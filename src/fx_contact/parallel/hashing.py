"""One mixing of bits, for the home ranks of keys and for checksums."""

import numpy as np

#: 2^64 over the golden ratio, odd: multiples of it lie evenly (D. E. Knuth, The Art of Computer Programming 3, 6.4).
GOLDEN = np.uint64(0x9E3779B97F4A7C15)


def mixed(numbers):
    """Numbers of 64 bits, one for each given one, whose high bits depend on all bits of that.  Local.

    Args:
        numbers: (n,) integers of 64 bits.

    Returns:
        (n,) uint64.
    """
    numbers = numbers.astype(np.uint64)
    return (numbers ^ numbers >> np.uint64(32)) * GOLDEN
