"""A plug-in of pytest: `pytest --credit=my_package` tests every component that a package announces.

It is read at every start of pytest where credit is installed, and imports nothing until it is asked for.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from _pytest._code.code import ExceptionInfo

GROUP = "credit.components"


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--credit=PACKAGE`, and `--credit-every`."""
    group = parser.getgroup("credit", "components for credit")
    group.addoption(
        "--credit",
        action="append",
        default=[],
        metavar="PACKAGE",
        help="test every component that an installed package announces by its entry point credit.components",
    )
    group.addoption("--credit-every", action="store_true", help="… in every experiment that it goes with")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(session: pytest.Session, config: pytest.Config, items: list[pytest.Item]) -> None:
    """Add a test for each component."""
    for package in config.getoption("credit"):
        for kind, path in announced(package):
            name = f"component[{kind}/{path.stem}]"
            items.append(ComponentItem.from_parent(session, name=name, kind=kind, file=path))


def announced(package: str) -> Iterator[tuple[str, Path]]:
    """Kind and file of every component of a package.

    Args:
        package: its import name, or the name of its entry point.

    Raises:
        pytest.UsageError: it announces none.
    """
    from credit.config import files
    from credit.testing.suite import OF_KIND

    points = [point for point in entry_points(group=GROUP) if package in (point.module, point.name)]
    places = {Path(*point.module.split(".")) for point in points}
    folders = [one for one in files.package_dirs() if any(one.parent.match(str(place)) for place in places)]
    found = [(kind, path) for folder in folders for kind in OF_KIND for path in sorted((folder / kind).glob("*.yaml"))]
    if not found:
        known = ", ".join(sorted({point.module for point in entry_points(group=GROUP)})) or "none"
        why = "it has no YAML files in conf/KIND" if points else f"those with an entry point {GROUP!r} are: {known}"
        raise pytest.UsageError(f"--credit={package}: nothing to test; {why}")
    yield from found


class ComponentItem(pytest.Item):
    """A component, held to what its kind promises."""

    def __init__(self, *, kind: str, file: Path, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.kind, self.file = kind, file

    def runtest(self) -> None:
        """Run all checks of its kind."""
        from credit.testing import check

        check(f"{self.kind}/{self.file.stem}", every=self.config.getoption("credit_every"))

    def repr_failure(self, excinfo: ExceptionInfo[BaseException], style: Any = None) -> Any:
        """What is wrong; with a traceback where somebody's part raised."""
        raised = excinfo.value.__cause__
        if isinstance(excinfo.value, AssertionError | ValueError) and isinstance(
            raised, AssertionError | ValueError | None
        ):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int, str]:
        """Its file."""
        return self.file, 0, self.name
