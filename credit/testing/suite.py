"""Which checks each kind has, and how somebody's component is put to them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from credit.config import files, schema
from credit.config.kinds import KINDS
from credit.core.component import Component
from credit.core.errors import RunError, UserError, nearest
from credit.runs import rehearsal
from credit.testing import cases, leaks, learners, models, runs, words, worlds
from credit.testing.cases import Case
from credit.testing.lent import lent

Check = Callable[[Case], None]


def keeps_promises(case: Case) -> None:
    """A short run in which every answer is held to what its seam promises; for parts that are not credit's."""
    found = rehearsal.problems(case.config, schema.build(case.config, "trainer"))
    if found:
        raise AssertionError("\n".join(found))


OF_KIND: dict[str, Check] = {
    "env": worlds.environment,
    "feedback": worlds.feedback,
    "reward": models.reward,
    "features": models.features,
    "uncertainty": models.uncertainty,
    "mixer": models.mixer,
    "bonus": models.bonus,
    "encoder": learners.encoder,
    "network": learners.network,
    "scaler": models.scaler,
    "assigner": learners.assigner,
    "transition": learners.transition,
    "agent": learners.agent,
}
OF_RUNS: tuple[Check, ...] = (runs.repeats, runs.alone, runs.resumes, leaks.keeps_to_labels)


def checks(kind: str) -> tuple[Check, ...]:
    """What a kind owes, in the order in which it is asked for."""
    return (keeps_promises, OF_KIND[kind], *OF_RUNS)


def run(thing: str | type[Component] | Component, every: bool = False) -> None:
    """Hold a component to all that its kind promises; see `credit.testing.check`."""
    if isinstance(thing, str):
        kind, name = option(thing)
        for check in words.CHECKS:
            with blamed(thing, check):
                check(kind, name)
        hold(f"{kind}/{name}", cases.of_option(kind, name), every)
        return
    kind, cls = kind_of(thing), thing if isinstance(thing, type) else type(thing)
    if missing := sorted(getattr(cls, "__abstractmethods__", ())):
        raise AssertionError(f"{cls.__name__} does not define {', '.join(missing)}, as every {kind} does")
    with lent(thing) as node:
        hold(cls.__name__, cases.of_node(kind, cls.__name__, node), every)


def hold(label: str, found: Iterator[Case | str], every: bool) -> None:
    """Put a component to its checks in the first case, or in every one.

    Args:
        label: what messages call it. found: cases, or why there is none. every: not the first alone.

    Raises:
        AssertionError: a promise is broken. UserError: there is no case.
    """
    said, tried = list[str](), 0
    for case in found:
        if isinstance(case, str):
            said.append(case)
            continue
        tried += 1
        for check in checks(case.kind):
            with blamed(f"{label} in experiment={case.experiment}", check):
                check(case)
        if not every:
            return
    if not tried:
        raise UserError("\n".join([f"{label} goes with no experiment of credit's, so that it cannot be tried:", *said]))


@contextmanager
def blamed(label: str, check: Callable[..., None]) -> Iterator[None]:
    """Whatever a check finds is said with the component's name and the promise.

    Raises:
        AssertionError: where the check raised anything.
    """
    promise = " ".join((check.__doc__ or check.__name__).split())
    try:
        yield
    except (AssertionError, UserError, RunError) as error:
        raise AssertionError(f"{label}: {error}\n(what is promised: {promise})") from error
    except Exception as error:  # whatever somebody's part may raise
        raise AssertionError(f"{label}: {type(error).__name__}: {error}\n(what is promised: {promise})") from error


def option(text: str) -> tuple[str, str]:
    """Kind and name of an option.

    Raises:
        UserError: there is no such one.
    """
    kind, _, name = text.partition("/")
    if kind not in OF_KIND:
        raise UserError(f"{text!r}: {kind!r} is no kind that can be checked; {nearest(kind, OF_KIND)}")
    if name not in (known := files.options(kind)):
        raise UserError(f"{text!r}: {kind} has no option {name!r}; {nearest(name, known)}")
    return kind, name


def kind_of(thing: type[Component] | Component) -> str:
    """The kind of a class or an instance.

    Raises:
        UserError: it is none of credit's.
    """
    cls = thing if isinstance(thing, type) else type(thing)
    for kind in OF_KIND:
        if issubclass(cls, KINDS[kind].load()):
            return kind
    bases = ", ".join(KINDS[kind].base.partition(":")[2] for kind in OF_KIND)
    raise UserError(f"{cls.__name__}: no component of credit's; it must be one of credit.core.seams: {bases}")
