"""Compare two tables of scores scene by scene: the verdicts must be the same.

    python3 -m studies.stability.compare studies/stability/scores.csv results/stability/scores.csv

Scenes that one of the files lacks are counted alone. Ends with 1 if a verdict differs.
"""

import sys

from studies.tables import read


def differences(before, after):
    """Sentences on the scenes that are in both, two dicts name -> score."""
    for name in before:
        if name in after and before[name] != after[name]:
            yield f"{name}: {before[name]} before, {after[name]} now"


def main(*paths):
    """Print all differences; whether there are any."""
    before, after = ({row["name"]: row["score"] for row in read(path)[1]} for path in paths)
    found = list(differences(before, after))
    common = before.keys() & after.keys()
    print("\n".join(found) or "no verdict differs")
    print(f"{len(common)} scenes compared, {len(before.keys() ^ after.keys())} only in one file")
    return bool(found) or not common


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
