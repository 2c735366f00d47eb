"""Components of graphs that are spread over the ranks."""

import numpy as np
from conftest import WORLD

from fx_contact.parallel.components import lowest_labels
from fx_contact.parallel.mpi import Directory


def test_components():
    """Two chains of 100 nodes, the links of each dealt out to the ranks: a node knows the lowest of its own."""
    links = np.stack([np.arange(99), np.arange(1, 100)], axis=1)
    links = np.concatenate([links, links + 100])[WORLD.rank :: WORLD.size]
    keys = np.unique(links)
    label = lowest_labels(WORLD, np.arange(len(keys)), keys, _lowest_of_neighbours(keys, links))
    assert np.array_equal(label, 100 * (keys // 100))


def _lowest_of_neighbours(keys, links):
    """Labels over this rank's links, one turn, then over the ranks."""
    directory, ends = Directory(WORLD, keys), np.searchsorted(keys, links)

    def exchange(label):
        label = label.copy()
        np.minimum.at(label, ends, label[ends[:, ::-1]])
        return directory.lowest(label)

    return exchange
