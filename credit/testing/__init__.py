"""What every component owes its kind: the conformance suite, for credit's own parts and for yours.

Example:
    >>> from credit.testing import check
    >>> check(MyMixer)  # a class whose parameters have defaults
    >>> check(MyMixer(alpha=0.5))  # or an instance, not yet started
    >>> check("mixer/mine")  # or the name of an option that a package registered
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from credit.core.component import Component

__all__ = ["check"]


def check(thing: str | type[Component] | Component, every: bool = False) -> None:
    """Hold a component to all that its kind promises: shapes, finite numbers, state, random numbers, no leak.

    It is put into short runs of credit's experiments, in the place of the part that is there.

    Args:
        thing: a class, an instance that was not started, or `kind/name` of an option (`credit list` has them).
        every: in every experiment that it goes with; else in the first alone.

    Raises:
        AssertionError: a promise is broken: which, by whom, and what was given.
        UserError: there is no such option, it is no component, or it goes with no experiment, and why.
    """
    from credit.testing.suite import run

    run(thing, every)
