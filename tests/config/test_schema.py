"""The check: every problem of a configuration, found at once and named, before anything is built."""

from __future__ import annotations

import copy
import dataclasses
import sys
import types
from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar, Literal

import pytest
from annotated_types import Ge, Gt, Interval

from credit.config import classes, schema
from credit.core import signatures
from credit.core.component import Component
from credit.core.errors import UserError, nearest


class Engine(Component):
    """A kind."""


class Petrol(Engine):
    """One engine."""

    def __init__(self, power: Annotated[float, Gt(0)] = 1.0, cylinders: Annotated[int, Ge(1)] = 4) -> None:
        self.power = power
        self.cylinders = cylinders


class Rocket(Engine):
    """Another engine."""


class Curious(Engine):
    """Wants to be given the environment."""

    def __init__(self, env: World) -> None:
        self.env = env


class Wheel(Component):
    """A kind."""

    def __init__(self, size: float = 1.0) -> None:
        self.size = size


class BigWheel(Wheel):
    """Another wheel."""


class World(Component):
    """An environment."""


class Car(Component):
    """What is built at the root."""

    needs: ClassVar = {"wheels": BigWheel}

    def __init__(
        self,
        env: World,
        engine: Engine,
        wheels: Mapping[str, Wheel],
        colour: Literal["red", "blue"] = "red",
        seats: list[int] | None = None,
        spare: Wheel | None = None,
    ) -> None:
        self.env, self.engine, self.wheels, self.colour, self.seats, self.spare = (
            env,
            engine,
            wheels,
            colour,
            seats,
            spare,
        )


class Shop(Component):
    """A root with a nested part, and with a slot that another component asks for too."""

    def __init__(self, car: Car, engine: Engine) -> None:
        self.car, self.engine = car, engine


class Bike(Component):
    """Takes petrol engines, and can do without."""

    def __init__(self, engine: Petrol | None = None) -> None:
        self.engine = engine


class Picky(Component):
    """Refuses its argument when it is built."""

    def __init__(self, value: int) -> None:
        raise UserError(f"picky.value={value}: refused")


@dataclasses.dataclass(frozen=True)
class Order:
    """The plain keys."""

    name: str
    count: Annotated[int, Ge(1)] = 1
    share: Annotated[float, Interval(ge=0, le=1)] = 0.5


PACKAGE = "toy_components"
SLOTS: dict[str, type[Component]] = {"env": World, "engine": Engine, "wheels": Wheel, "car": Car}


@pytest.fixture(autouse=True)
def _announced(monkeypatch: pytest.MonkeyPatch) -> None:
    """Put the classes above into a module of a package that has announced itself."""
    module = types.ModuleType(PACKAGE)
    for cls in (Engine, Petrol, Rocket, Curious, Wheel, BigWheel, World, Car, Shop, Bike, Picky):
        setattr(module, cls.__name__, cls)
    module.not_a_class = 3  # type: ignore[attr-defined]
    module.Order = Order  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, PACKAGE, module)
    monkeypatch.setattr(classes, "allowed_packages", lambda: frozenset({"credit", PACKAGE}))


def node(name: str, **values: Any) -> dict[str, Any]:
    return {"_target_": f"{PACKAGE}.{name}", **values}


def good() -> dict[str, Any]:
    return {
        "name": "order",
        "env": node("World"),
        "engine": node("Petrol", power=2.0, cylinders=3),
        "wheels": {"left": node("BigWheel"), "right": node("BigWheel", size=2.0)},
        "car": node("Car", colour="blue", spare=node("Wheel")),
    }


def problems(change: Callable[[dict[str, Any]], Any], roots: tuple[str, ...] = ("car",)) -> list[str]:
    config = copy.deepcopy(good())
    change(config)
    return schema.Check(config, SLOTS, Order, roots).problems


def setter(path: str, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(config: dict[str, Any]) -> None:
        *parents, last = path.split(".")
        for part in parents:
            config = config[part]
        config[last] = value

    return change


def test_a_good_configuration_has_no_problems() -> None:
    assert problems(lambda config: None) == []


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("engine.powr", 3.0, ["engine.powr", "unknown key", "3.0", "did you mean 'power'", "cylinders"]),
        ("wheels.left.sise", 1, ["wheels.left.sise", "unknown key", "did you mean 'size'"]),
        ("car.spare", {"_target_": f"{PACKAGE}.Wheel", "siz": 1}, ["car.spare.siz", "did you mean 'size'"]),
        ("cont", 3, ["cont", "unknown key", "did you mean 'count'"]),
        ("engne", node("Petrol"), ["engne", "unknown key", "did you mean 'engine'"]),
        ("engine.power", "abc", ["engine.power='abc'", "valid number", "float > 0"]),
        ("engine.power", "2.0", ["engine.power='2.0'", "float > 0"]),
        ("engine.power", True, ["engine.power=True", "float > 0"]),
        ("engine.power", None, ["engine.power=None", "float > 0"]),
        ("engine.power", 0.0, ["engine.power=0.0", "greater than 0", "float > 0"]),
        ("engine.power", float("nan"), ["engine.power=nan", "finite"]),
        ("engine.power", float("inf"), ["engine.power=inf", "finite"]),
        ("engine.cylinders", 2.0, ["engine.cylinders=2.0", "int ≥ 1"]),
        ("engine.cylinders", True, ["engine.cylinders=True", "int ≥ 1"]),
        ("engine.cylinders", 0, ["engine.cylinders=0", "int ≥ 1"]),
        ("car.colour", "green", ["car.colour='green'", "one of red, blue"]),
        ("car.seats", [1, "x"], ["car.seats=[1, 'x']", "list of int or null"]),
        ("count", 0, ["count=0", "int ≥ 1"]),
        ("share", 1.5, ["share=1.5", "float ≥ 0 and ≤ 1"]),
        ("name", "???", ["name", "a value is missing", "name=<str>"]),
        ("engine.power", "???", ["engine.power", "a value is missing", "engine.power=<float > 0>"]),
        ("engine", 7, ["engine=7", "a component belongs here"]),
        ("engine", node("Wheel"), ["engine", "Wheel is not a Engine"]),
        ("wheels.left", node("Petrol"), ["wheels.left", "Petrol is not a Wheel"]),
        ("wheels.left", 7, ["wheels.left=7", "a component belongs here"]),
        ("car.spare", node("Petrol"), ["car.spare", "Petrol is not a Wheel"]),
        ("engine._target_", "os.system", ["engine._target_='os.system'", "only classes of these packages", PACKAGE]),
        ("engine._target_", "system", ["engine._target_='system'", "only classes of these packages"]),
        ("engine._target_", f"{PACKAGE}.Absent", ["engine._target_", "cannot be imported"]),
        ("engine._target_", "credit.absent.Thing", ["engine._target_", "cannot be imported"]),
        ("engine._target_", f"{PACKAGE}.not_a_class", ["engine._target_", "is not a component"]),
        ("engine._target_", f"{PACKAGE}.Order", ["engine._target_", "is not a component"]),
        ("engine._target_", "credit.os.system", ["engine._target_", "cannot be imported"]),
        ("wheels.left", node("Wheel"), ["car", "Car needs a BigWheel in wheels.left", "there is Wheel"]),
    ],
)
def test_a_problem_is_named(path: str, value: Any, said: list[str]) -> None:
    found = problems(setter(path, value))
    assert len(found) == 1, found
    for part in said:
        assert part in found[0], found[0]


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("engine.power", 3),  # an integer is a number
        ("car.seats", None),
        ("car.seats", [1, 2]),
        ("wheels", {}),  # several may be none
        ("share", 1),
        ("share", 0.0),
        ("car.spare", node("BigWheel")),
        ("engine", node("Rocket")),
    ],
)
def test_what_is_allowed(path: str, value: Any) -> None:
    assert problems(setter(path, value)) == []


def test_all_problems_are_reported_at_once() -> None:
    def change(config: dict[str, Any]) -> None:
        config["engine"] |= {"power": -1.0, "cylindres": 3}
        config["wheels"]["left"]["size"] = "big"
        config["car"]["colour"] = "green"
        config["share"] = 2
        config["env"]["_target_"] = "subprocess.Popen"
        del config["name"]

    found = problems(change)
    assert len(found) == 7
    for start in ("engine.power=", "engine.cylindres", "wheels.left.size=", "car.colour=", "share=", "env._target_="):
        assert sum(problem.startswith(start) for problem in found) == 1, start
    assert sum("name: a value is missing" in problem for problem in found) == 1


@pytest.mark.parametrize("value", [None, "absent"])
def test_a_slot_that_is_needed_and_empty(value: Any) -> None:
    def change(config: dict[str, Any]) -> None:
        config["engine"] = None
        if value == "absent":
            del config["engine"]

    found = problems(change)
    assert len(found) == 1
    assert "engine: car needs one, and there is none; add engine=<option>" in found[0]


def test_an_optional_slot_may_be_empty_and_a_group_too() -> None:
    def change(config: dict[str, Any]) -> None:
        del config["wheels"]

    assert problems(change) == []


def test_an_optional_part_that_is_no_slot_may_be_left_out() -> None:
    config = good() | {"car": node("Car")}
    assert schema.Check(config, SLOTS, Order, ("car",)).problems == []


def test_null_for_a_nested_component_that_is_needed() -> None:
    config = good() | {"car": node("Car", engine=None, spare=node("Wheel"))}
    assert schema.Check(config, SLOTS, Order, ("car",)).problems


def test_several_components_where_one_belongs() -> None:
    assert problems(setter("engine", {"first": node("Petrol"), "second": node("Petrol")}))


def test_a_slot_that_nothing_reaches_is_not_used_but_checked() -> None:
    config = good()
    found = schema.Check(config, SLOTS, Order, ("engine",))
    assert (found.problems, found.used) == ([], {"engine"})
    config["wheels"]["left"]["size"] = "big"
    assert schema.Check(config, SLOTS, Order, ("engine",)).problems
    assert schema.Check(good(), SLOTS, Order, ("car",)).used == {"car", "env", "engine", "wheels"}


def test_parts_that_are_not_used_need_not_fit() -> None:
    config = good() | {"engine": node("Rocket")}
    assert schema.Check(config, SLOTS, Order, ("wheels",)).problems == []


def test_an_optional_part_takes_what_is_of_its_kind_alone() -> None:
    slots = SLOTS | {"bike": Bike}
    config = good() | {"bike": node("Bike")}
    assert schema.Check(config, slots, Order, ("bike",)).used == {"bike", "engine"}
    assert type(schema.build(config, "bike").engine) is Petrol
    config["engine"] = node("Rocket")
    assert schema.Check(config, slots, Order, ("car", "bike")).problems == []  # a car takes it
    assert schema.build(config, "bike").engine is None
    (alone,) = schema.Check(config, slots, Order, ("bike",)).problems  # nobody does
    assert "bike: Bike needs a Petrol in engine, and there is Rocket" in alone


def test_only_the_root_is_given_the_environment() -> None:
    assert [text.partition(";")[0] for text in problems(setter("engine", node("Curious")))] == [
        "engine: Curious asks for env, and the environment knows the true reward"
    ]


def test_nothing_is_built_by_the_check() -> None:
    slots = SLOTS | {"picky": Picky}
    assert schema.Check({"name": "x", "picky": node("Picky", value=3)}, slots, Order, ("picky",)).problems == []


def test_build() -> None:
    car = schema.build(good(), "car")
    assert type(car) is Car
    assert (car.engine.power, car.engine.cylinders, car.colour) == (2.0, 3, "blue")
    assert {name: type(wheel) for name, wheel in car.wheels.items()} == {"left": BigWheel, "right": BigWheel}
    assert car.wheels["right"].size == 2.0
    assert type(car.spare) is Wheel
    assert schema.build(good() | {"car": node("Car")}, "car").spare is None
    nested = schema.build(good() | {"car": node("Car", spare=node("Wheel", size=9.0))}, "car")
    assert nested.spare.size == 9.0
    assert nested.engine.power == 2.0


def test_what_two_components_ask_for_is_built_once() -> None:
    shop = schema.build(good() | {"shop": node("Shop")}, "shop")
    assert shop.engine is shop.car.engine
    assert schema.build(good(), "car").engine is not shop.engine


def test_a_part_of_its_own_replaces_the_slot() -> None:
    car = schema.build(good() | {"car": node("Car", engine=node("Petrol", power=7.0), wheels={})}, "car")
    assert car.engine.power == 7.0
    assert car.wheels == {}


def test_a_constructor_may_refuse() -> None:
    with pytest.raises(UserError, match=r"picky\.value=3: refused"):
        schema.build({"picky": node("Picky", value=3)}, "picky")


def test_only_announced_packages_may_be_built() -> None:
    with pytest.raises(UserError, match=r"os\.system.*only classes of these packages"):
        schema.build({"engine": {"_target_": "os.system", "command": "true"}}, "engine")


@pytest.mark.parametrize(
    ("hint", "words"),
    [
        (float, "float"),
        (Annotated[float, Gt(0)], "float > 0"),
        (Annotated[int, Ge(1)], "int ≥ 1"),
        (Annotated[float, Interval(ge=0, lt=1)], "float ≥ 0 and < 1"),
        (Literal["a", "b"], "one of a, b"),
        (str | None, "str or null"),
        (list[float], "list of float"),
        (str | list[int | None], "str or list of (int or null)"),
    ],
)
def test_hints_in_words(hint: Any, words: str) -> None:
    assert signatures.describe(hint) == words


def test_nearest_names() -> None:
    assert nearest("alpa", ["epsilon", "alpha"]) == "did you mean 'alpha'? (valid: alpha, epsilon)"
    assert nearest("xyz", ["alpha"]) == "(valid: alpha)"
    assert nearest("xyz", []) == "(there are none)"


def test_one_component_where_several_are_wanted_is_a_group_of_one() -> None:
    config = good() | {"wheels": node("BigWheel", size=2.0)}
    assert problems(lambda given: given.update(wheels=config["wheels"])) == []
    car = schema.build(config, "car")
    assert {name: wheel.size for name, wheel in car.wheels.items()} == {"wheels": 2.0}
