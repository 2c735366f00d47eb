"""Lines of the package that each test runs, a plugin of pytest: `-p studies.mutations.covered --covered FILE`.

Written for each rank as JSON: `tests`, a list of [node id, seconds] of those that pass, and `lines`: of each file below
`src/fx_contact` and line in it, the tests as bits of a hexadecimal number.  What fixtures run counts for all tests of
their file.
"""

import json
import sys
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI

SOURCE = str(Path(__file__).resolve().parents[2] / "src" / "fx_contact") + "/"
_TOOL = 4


def pytest_addoption(parser: pytest.Parser) -> None:
    """The file to write."""
    parser.addoption("--covered", metavar="FILE", required=True, help="what is written, with the rank added")


def pytest_configure(config: pytest.Config) -> None:
    """Begin to watch."""
    config.pluginmanager.register(_Watch(f"{config.getoption('--covered')}-{MPI.COMM_WORLD.rank}.json"))


class _Watch:
    def __init__(self, target: str) -> None:
        self.target = target
        self.tests: list[list[Any]] = []
        self.lines: dict[str, dict[int, int]] = defaultdict(lambda: defaultdict(int))
        self.shared: dict[Path, set[tuple[str, int]]] = defaultdict(set)
        self.seen: set[tuple[str, int]] = set()
        sys.monitoring.use_tool_id(_TOOL, "covered")
        sys.monitoring.register_callback(_TOOL, sys.monitoring.events.LINE, self._line)
        sys.monitoring.set_events(_TOOL, sys.monitoring.events.LINE)

    def _line(self, code: Any, line: int) -> Any:
        if SOURCE and code.co_filename.startswith(SOURCE):
            self.seen.add((code.co_filename[len(SOURCE) :], line))
        return sys.monitoring.DISABLE

    def _anew(self) -> None:
        self.seen = set()
        sys.monitoring.restart_events()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> Any:
        """Fixtures of a module are made once, at its first test."""
        self._anew()
        try:
            return (yield)
        finally:
            self.shared[item.path] |= self.seen

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Any:
        """A test that passes."""
        self._anew()
        start = time.monotonic()
        result = yield
        for file, line in self.seen | self.shared[item.path]:
            self.lines[file][line] |= 1 << len(self.tests)
        self.tests.append([item.nodeid, round(time.monotonic() - start, 3)])
        return result

    def pytest_sessionfinish(self) -> None:
        """Write the file."""
        lines = {file: {line: f"{bits:x}" for line, bits in of.items()} for file, of in self.lines.items()}
        Path(self.target).write_text(json.dumps({"tests": self.tests, "lines": lines}))
