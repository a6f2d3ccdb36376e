"""Coordinates cut into equal cells: a table for what is no table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite, prod
from typing import ClassVar, TypeVar

import torch
from torch import Tensor

from credit.core.errors import UserError
from credit.core.problem import FLOAT, Problem
from credit.core.ranges import PositiveInt
from credit.core.seams import FeatureMap
from credit.core.steps import Steps
from credit.recovery.features.coordinates import Coordinate, Coordinates

LARGEST = 10_000  # features
T = TypeVar("T")


class EqualCells(FeatureMap):
    """One feature a cell: the product of coordinates, each cut into equal cells, and of the action.

    A coordinate x with n cells between bounds l and h is in cell ⌊n·(x − l)/(h − l)⌋; what lies outside is in the cell
    at the border. A state or an action that is a number is a coordinate, too (`s`, `a`), with bounds 0 and its count.

    Args:
        cells: coordinate → number of its cells, by name (`s0`, `a1`, or as the environment calls it) or by its place in
            the state (0, 1, …); one number for every coordinate of the state.
        bounds: coordinate → [lowest, highest], where the environment says none, or others are wanted.
        actions: whether finite actions are told apart, each with cells of its own; coordinates of actions that are
            vectors are named in `cells`.

    Raises:
        UserError: at `start`: a coordinate that is not there, without bounds, or named twice; too many cells.

    Example:
        >>> EqualCells({"s0": 8, "s1": 8}, bounds={"s0": [-6, 6], "s1": [-6, 6]}, actions=False)
    """

    keeps: ClassVar = ()

    def __init__(
        self,
        cells: PositiveInt | dict[int | str, PositiveInt] = 8,
        bounds: dict[int | str, Sequence[float]] | None = None,
        actions: bool = True,
    ) -> None:
        self.cells = cells
        self.bounds = bounds
        self.per_action = actions  # `actions` is what every component says of spaces

    def start(self, problem: Problem) -> None:
        """Find the coordinates, and lay out their cells."""
        named = Coordinates(problem)
        counts: dict[int | str, int] = {}
        if isinstance(self.cells, Mapping):
            counts |= self.cells
        else:
            counts |= dict.fromkeys(range(len(named.states)), self.cells)
        sizes = _found("cells", counts, named)
        bounds = {key: _pair(key, pair) for key, pair in _found("bounds", self.bounds or {}, named).items()}
        if unused := [key.name for key in bounds if key not in sizes]:
            raise UserError(f"features.bounds: {', '.join(unused)} has bounds and no cells; name it in features.cells")
        self._cut = [_Cut(key, size, *bounds.get(key, (key.low, key.high))) for key, size in sizes.items()]
        if self.per_action and not any(key.of == "actions" for key in sizes):
            if not problem.finite_actions:
                raise UserError(
                    "features.actions=true: actions are vectors here, and there is no cell for each; name their "
                    f"coordinates in features.cells ({', '.join(key.name for key in named.actions)}), or give "
                    "features.actions=false"
                )
            self._cut.append(_Cut(named.actions[0], problem.actions, 0.0, float(problem.actions)))
        self._count = prod(cut.size for cut in self._cut)
        if self._count > LARGEST:
            shown = " × ".join(f"{cut.size} ({cut.coordinate.name})" for cut in self._cut)
            raise UserError(f"features.cells: {shown} are {self._count} cells, at most {LARGEST}; cut less finely")
        self._kind = FLOAT if problem.finite_states else torch.bool

    def __call__(self, steps: Steps) -> Tensor:
        """One-hot vectors [..., cells]: the last coordinate changes fastest, the action last of all."""
        index = torch.zeros((), dtype=torch.int64, device=steps.states.device)
        for cut in self._cut:
            index = index * cut.size + cut(steps)
        return (index.unsqueeze(-1) == torch.arange(self._count, device=index.device)).to(self._kind)


class _Cut:
    """A coordinate in `size` equal cells between two bounds."""

    def __init__(self, coordinate: Coordinate, size: int, low: float, high: float) -> None:
        self.coordinate, self.size, self._low, self._high = coordinate, size, low, high
        name = coordinate.name
        if not (isfinite(low) and isfinite(high)):
            raise UserError(
                f"features.cells: the environment says no bounds for {name}; give features.bounds={{{name}: [lowest, "
                "highest]} (what lies outside is in the cell at the border)"
            )
        if coordinate.levels is not None and size > coordinate.levels:
            raise UserError(f"features.cells: {name} in {size} cells, and it has {coordinate.levels} values only")

    def __call__(self, steps: Steps) -> Tensor:
        """The cell [...], from 0 on."""
        share = (self.coordinate(steps) - self._low) * self.size / (self._high - self._low)  # exact for whole numbers
        return share.clamp(0, self.size - 1).floor().to(torch.int64)


def _found(key: str, given: Mapping[int | str, T], named: Coordinates) -> dict[Coordinate, T]:
    """What is given for each coordinate."""
    found: dict[Coordinate, T] = {}
    for name, value in given.items():
        try:
            coordinate = named.find(name)
        except UserError as error:
            raise UserError(f"features.{key}: {error}") from None
        if coordinate in found:
            raise UserError(f"features.{key}: {coordinate.name} is there twice; name it once")
        found[coordinate] = value
    return found


def _pair(coordinate: Coordinate, bounds: Sequence[float]) -> tuple[float, float]:
    if len(bounds) != 2 or not bounds[0] < bounds[1]:
        raise UserError(f"features.bounds: {coordinate.name}: {list(bounds)}; allowed: [lowest, highest], two numbers")
    return float(bounds[0]), float(bounds[1])
