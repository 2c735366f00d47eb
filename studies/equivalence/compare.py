"""Compare two files of `records.py`: integers must agree, forces to 1e-9, other figures to 1e-6.

    python3 studies/equivalence/compare.py before.json after.json

Iterations of PCG and stated errors of forces are shown where they differ, and may.  Ends with 1 if something else does.
"""

import json
import sys

#: Entries that may differ.
SOFT = ("pair_errors", "krylov_iterations")


def same(entry, one, other):
    """Whether two figures agree as they must."""
    if isinstance(one, list):
        return isinstance(other, list) and len(one) == len(other) and all(same(entry, *b) for b in zip(one, other))
    if one is None or other is None or isinstance(one, (int, str)):
        return one == other
    allowed = (1e-9 if "force" in entry else 1e-6) * max(abs(one), abs(other))
    return abs(one - other) <= allowed + 1e-12 * (entry == "max_penetration")


def main(*paths):
    """Print all differences; the number of those that must not be."""
    before, after = (json.load(open(path)) for path in paths)
    common, wrong = before.keys() & after.keys(), 0
    for name in sorted(common):
        if len(before[name]) != len(after[name]):
            print(f"{name}: {len(before[name])} steps before, {len(after[name])} now")
            wrong += 1
            continue
        for number, (one, other) in enumerate(zip(before[name], after[name])):
            for entry in one.keys() & other.keys():
                if not same(entry, one[entry], other[entry]):
                    wrong += entry not in SOFT
                    said = f"{name}, step {number}: {entry} {one[entry]} before, {other[entry]} now"
                    print(f"({said})" if entry in SOFT else said)
    print(f"{len(common)} runs compared, {wrong} figures differ")
    return wrong if common else 1


if __name__ == "__main__":
    sys.exit(bool(main(*sys.argv[1:])))
