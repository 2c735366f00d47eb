"""Compare two files of `records.py`: integers must agree, forces to 1e-9, other figures to 1e-6.

PT-SCOTCH's partition differs from run to run, and the order of all sums with it: forces of `graph` must agree to 1e-7.
On 3 ranks sums are in another order each time too; the folder's README says which figures then may differ.

    python3 studies/equivalence/compare.py [--subset] studies/equivalence/before_2.json after.json

With `--subset` the runs of the second file alone are compared.  Ends with 1, and says where, if something differs.
"""

import json
import sys

#: Relative differences that rounding may make: of forces, as the solver's tolerance leaves them, the same for another
#: order of the unknowns, and of the rest.
FORCES, REORDERED, OTHERS = 1e-9, 1e-7, 1e-6


def differences(name, before, after):
    """Sentences on what two runs differ in."""
    if len(before) != len(after):
        yield f"{name}: {len(before)} steps before, {len(after)} now"
        return
    forces = REORDERED if "graph" in name else FORCES
    for number, (one, other) in enumerate(zip(before, after)):
        for entry in one:
            if entry != "krylov_iterations" and not same(entry, one[entry], other[entry], forces):
                yield f"{name}, step {number}: {entry} {one[entry]} before, {other[entry]} now"


def same(entry, one, other, forces):
    """Whether two figures agree as they must."""
    if isinstance(one, list):
        return len(one) == len(other) and all(same(entry, *both, forces) for both in zip(one, other))
    if other is None:  # radii are those of round contact alone; older files have others
        return entry == "contact_radius"
    if isinstance(one, int):
        return one == other
    allowed = forces if "force" in entry else OTHERS
    return abs(one - other) <= allowed * max(abs(one), abs(other))


def main(before, after, subset=False):
    """Print all differences; whether there are any."""
    before, after = (json.load(open(path)) for path in (before, after))
    lonely = after.keys() - before.keys() if subset else before.keys() ^ after.keys()
    found = [f"only in one file: {name}" for name in lonely]
    for name in before.keys() & after.keys():
        found += differences(name, before[name], after[name])
        iterations = [[s["krylov_iterations"] for s in run] for run in (before[name], after[name])]
        if iterations[0] != iterations[1]:
            print(f"(iterations of {name}: {iterations[0]} before, {iterations[1]} now)")
    print("\n".join(sorted(found)) or f"{len(before.keys() & after.keys())} runs agree")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main(*(word for word in sys.argv[1:] if word != "--subset"), subset="--subset" in sys.argv))
