"""Do the parts fit the problem? Each says which spaces and tasks it takes; nobody looks at classes of environments."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from credit.core.component import Component
from credit.core.errors import Misfit
from credit.core.problem import Problem

SAYS = {"finite": "numbers (Discrete)", "vector": "vectors (Box)"}


def parts_of(component: Component, path: str = "") -> Iterator[tuple[str, Component]]:
    """A component and all that it was made of, each once: where it stands, and itself."""
    seen: set[int] = set()

    def walk(value: object, at: str) -> Iterator[tuple[str, Component]]:
        if isinstance(value, Mapping):
            for key, inner in value.items():
                yield from walk(inner, f"{at}.{key}" if at else str(key))
        elif isinstance(value, (list, tuple)):
            for inner in value:
                yield from walk(inner, at)
        elif isinstance(value, Component) and id(value) not in seen:
            seen.add(id(value))
            yield at, value
            for name, inner in vars(value).items():
                if not name.startswith("_"):
                    yield from walk(inner, f"{at}.{name}" if at else name)

    yield from walk(component, path)


def misfits(component: type[Component] | Component, problem: Problem) -> list[str]:
    """What a component wants of a problem and does not find: `states that are numbers, and here they are vectors`."""
    kinds = {True: "finite", False: "vector"}
    setting = "episodic" if problem.episodic else "continuing"
    found = []
    for what, wanted, given in (
        ("states", component.observations, kinds[problem.finite_states]),
        ("actions", component.actions, kinds[problem.finite_actions]),
    ):
        if wanted not in ("any", given):
            found.append(f"{what} that are {SAYS[wanted]}, and here they are {SAYS[given]}")
    if component.setting not in ("any", setting):
        found.append(f"a task that is {component.setting}, and this one is {setting}")
    return found


def require(roots: Mapping[str, Component], problem: Problem) -> None:
    """Refuse parts that do not fit.

    Raises:
        Misfit: with every one of them.
    """
    found = [
        (path, f"{type(part).__name__} needs {' and '.join(wrong)}; choose another one, or another env")
        for name, root in roots.items()
        for path, part in parts_of(root, name)
        if (wrong := misfits(part, problem))
    ]
    if found:
        raise Misfit(found)
