"""The linear estimator on the identity map when there are many cells: conjugate gradient on those that were visited."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import torch
from torch import Tensor

from credit.core.belief import Estimate
from credit.core.cells import PAIRS, Axis, Cells
from credit.core.checks import require_equal_lengths
from credit.core.errors import UserError
from credit.core.problem import FLOAT, Problem
from credit.core.ranges import Credit, Name, Positive, PositiveInt
from credit.core.seams import Places
from credit.core.state import Stateful
from credit.core.steps import Steps
from credit.core.store import Store
from credit.core.tensors import grown
from credit.core.windows import Windows
from credit.recovery.models.conjugate import Design, Normal
from credit.recovery.models.ridge import RidgeModel
from credit.recovery.uncertainty.bootstrap import FitUncertainty

PARTS = ("cells", "blocks", "squares", "index", "weights")  # of the state of a fit
PASS = 1e-10  # how much smaller the energy of a residual becomes in one pass of single precision


class TableModel(RidgeModel):
    """Tabular ridge reference (4) for thousands of cells, batched over draws.

    (XᵀWX + λI)θ = XᵀWY is solved after every `observe` by conjugate gradient, from the last solution on. The
    preconditioner is diagonal: XᵀW1 + λ, the weighted visits of each cell. Where no cell occurs twice in a window that
    is the diagonal of the matrix, Jacobi's, and elsewhere it is less. Only visited cells have unknowns (θ is 0
    elsewhere), and X is kept as its T indices a window: memory is O(K·(T + B) + visited cells·B) a replica. Replicas
    are solved one after the other.

    Args:
        uncertainty: further fits with other weights.
        name: the model's name in metrics, files and figures.
        looks_at: the axes of the table.
        credit: which steps of a window share its label: every one alike, or the last alone.
        regularization: λ > 0.
        tolerance: relative residual, in the norm of the preconditioner, at which a fit stops; 1e-2 goes stale.
        iterations: most iterations a solve.
    """

    observations: ClassVar = "finite"
    actions: ClassVar = "finite"
    keeps: ClassVar = ("_fits",)

    def __init__(
        self,
        uncertainty: FitUncertainty,
        name: Name = "ridge",
        looks_at: Sequence[Axis] = PAIRS,
        credit: Credit = "every_step",
        regularization: Positive = 10.0,
        tolerance: Positive = 1e-5,
        iterations: PositiveInt = 200,
    ) -> None:
        self.name = name
        self.uncertainty = uncertainty
        self.looks_at = {*looks_at, "step"} if credit == "last_step" else looks_at
        self.credit = credit
        self.regularization = regularization
        self.tolerance = tolerance
        self.iterations = iterations

    def start(self, problem: Problem, places: Places) -> None:
        """No cell was visited.

        Raises:
            UserError: the uncertainty asks for residuals, which are not kept.
        """
        assert places.cells is not None
        if self.uncertainty.sees_residuals:
            raise UserError(
                f"reward model {self.name!r}: a table of many cells keeps no account of its residuals; give the "
                "uncertainty its noise, or choose uncertainty=bootstrap"
            )
        self._problem = problem
        self.uncertainty.start(problem)
        self._all = places.cells
        self._cells = Cells.over(self.looks_at, problem.horizon, problem.states, problem.actions)
        self._own = self._cells.index(places.cells.steps(problem.device))  # cell → the table's own
        self._first = problem.window - 1 if self.credit == "last_step" else 0
        sizes = self._cells.count, problem.window - self._first, 1 + self.uncertainty.draws
        self._fits = [_Fit(*sizes, problem.device) for _ in problem.seeds]

    def observe(self, store: Store) -> None:
        """Add the newest windows and solve; or forget all, and fit all anew from the last solution on.

        Raises:
            RunError: windows have different lengths, and the credit is the last step's.
        """
        if self.credit == "last_step":
            require_equal_lengths(self.name, store.new)
        weights, anew = self.uncertainty.weights(store)
        if anew:
            for fit in self._fits:
                fit.forget()
        self.fit(store.windows if anew else store.new, weights)

    def fit(self, windows: Windows, weights: Tensor) -> None:
        """Add windows with weights [R, k, 1+B] and solve."""
        cells = self._side_by_side(windows)[..., self._first :]
        for fit, *new in zip(self._fits, cells, weights, windows.labels, strict=True):
            fit.add(*new)
            fit.solve(self.regularization, self.tolerance, self.iterations)

    def _side_by_side(self, windows: Windows) -> Tensor:
        """The cell of every step of every window [R, k, T]; behind the end of a shorter one, one that is none."""
        index = self._cells.index(windows)
        if windows.length is not None:
            return windows.grid(index)
        step, lengths = torch.arange(self._problem.window, device=index.device), windows.lengths.unsqueeze(-1)
        rows = (windows.ends.unsqueeze(-1) - lengths + 1 + step).clamp(0, index.shape[1] - 1)
        found = index.unsqueeze(1).expand(-1, lengths.shape[1], -1).gather(2, rows)
        return torch.where(step < lengths, found, self._cells.count)

    def looks(self) -> Tensor:
        """All unvisited cells have 0, unless the table tells less apart than other models do."""
        return self._own if self._cells != self._all else torch.zeros_like(self._own)

    def estimate(self, at: Tensor | None = None) -> Estimate:
        """θ for some cells [R, n], or for all: the point fit and the B draws."""
        own = self._own.expand(self._problem.replicas, -1) if at is None else self._own[at]
        return self._predict(own)

    def believe(self, steps: Steps) -> Estimate:
        """θ for other steps [n]."""
        return self._predict(self._cells.index(steps).expand(self._problem.replicas, -1))

    def _predict(self, own: Tensor) -> Estimate:
        table = torch.stack([fit.predict(of_replica) for fit, of_replica in zip(self._fits, own, strict=True)])
        draws = table[:, 1:]
        variance = self.uncertainty.variance(draws, lambda: self._widths(own), self._problem.zeros)
        return Estimate(table[:, 0], variance, draws)

    def leverage(self, steps: Steps | None = None) -> Tensor:
        """1/(λ + Σ x²), the diagonal's lower bound on φᵀV⁻¹φ [R, N]: V⁻¹ itself is dense.

        After 3,000 episodes of sepsis its root is within 2% of the exact width for half of the visited cells, and at
        least .67 of it for 95%.
        """
        own = self._own if steps is None else self._cells.index(steps)
        return self._widths(own.expand(self._problem.replicas, -1))

    def _widths(self, own: Tensor) -> Tensor:
        """The leverage of the table's own cells [R, n]."""
        widths = self._problem.zeros(self._cells.count + 1) + 1 / self.regularization
        for row, fit in zip(widths, self._fits, strict=True):
            row[fit.cells] = 1 / (self.regularization + fit.squares)
        widths = widths[:, :-1]  # without what is no cell
        counts = self._cells.steps(self._problem.device).times >= self._first  # the reward before is 0 for sure
        return (widths * counts).gather(1, own)


class _Fit(Stateful):
    """The windows of one replica and its 1 + B solutions; small enough to stay in the processor's cache."""

    def __init__(self, cells: int, width: int, fits: int, device: torch.device) -> None:
        self._column = torch.full((cells + 1,), -1, device=device)  # cell → unknown; the last is none: it stays 0
        self.cells = torch.zeros(0, dtype=torch.int64, device=device)  # unknown → cell
        # a row an unknown: θ, and sums over the windows, XᵀWY and XᵀW1 (close to the diagonal of XᵀWX)
        self._blocks = torch.zeros(3, 256, fits, dtype=FLOAT, device=device)
        self._squares = torch.zeros(1, 256, dtype=FLOAT, device=device)  # Σ x²
        self._row: dict[tuple[int, ...], int] = {}  # windows with the same unknowns, in any order, share a row of X
        self._index = torch.zeros(1, 256, width, dtype=torch.int64, device=device)
        self._weights = torch.zeros(1, 256, fits, dtype=FLOAT, device=device)

    def add(self, cells: Tensor, weights: Tensor, labels: Tensor) -> None:
        """Append windows [K, T] with weights [K, 1+B] and labels [K]; cells seen for the first time become unknowns."""
        fresh = torch.unique(cells[self._column[cells] < 0])
        self._column[fresh] = torch.arange(len(self.cells), len(self.cells) + len(fresh), device=cells.device)
        self.cells = torch.cat([self.cells, fresh])
        if len(self.cells) > self._blocks.shape[1]:
            self._blocks, self._squares = grown(self._blocks, len(self.cells)), grown(self._squares, len(self.cells))
        index = self._column[cells]
        rows = [self._row_of(window) for window in index.sort(-1).values.tolist()]
        places = torch.tensor(rows, dtype=torch.int64, device=cells.device)
        if self.rows > self._index.shape[1]:
            self._index, self._weights = grown(self._index, self.rows), grown(self._weights, self.rows)
        self._index[0, places] = index
        self._weights[0].index_add_(0, places, weights)
        shared = (index.unsqueeze(-1) == index.unsqueeze(-2)).sum(-1)  # a step's part of x²: how often its cell occurs
        self.squares.index_add_(0, index.flatten(), shared.flatten().to(FLOAT))
        _, target, visits = self._blocks
        for column in index.T:
            target.index_add_(0, column, weights * labels.unsqueeze(-1))
            visits.index_add_(0, column, weights)
        if (none := self.none) is not None:
            target[none] = 0

    def state_dict(self) -> dict[str, Any]:
        """Unknowns, sums, and the rows of X."""
        used, rows = len(self.cells), self.rows
        parts = self.cells, *(x[:, :used] for x in (self._blocks, self._squares))
        parts += tuple(x[:, :rows] for x in (self._index, self._weights))
        return dict(zip(PARTS, (part.cpu().clone() for part in parts), strict=True))

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Hold these windows and no others."""
        self.cells, blocks, squares, index, weights = (state[name].to(self._column.device) for name in PARTS)
        used, rows = len(self.cells), index.shape[1]
        self._column[self.cells] = torch.arange(used, device=self.cells.device)
        self._blocks, self._squares = grown(self._blocks, used), grown(self._squares, used)
        self._index, self._weights = grown(self._index, rows), grown(self._weights, rows)
        self._blocks[:, :used], self._squares[:, :used] = blocks, squares
        self._index[:, :rows], self._weights[:, :rows] = index, weights
        self._row = {tuple(window): row for row, window in enumerate(index[0].sort(-1).values.tolist())}

    @property
    def none(self) -> int | None:
        """The unknown that stands behind the end of shorter windows, where there are any."""
        found = int(self._column[-1])
        return None if found < 0 else found

    @property
    def theta(self) -> Tensor:
        """The solutions [V, 1+B]."""
        return self._blocks[0, : len(self.cells)]

    @property
    def squares(self) -> Tensor:
        """Σ x² [V]."""
        return self._squares[0, : len(self.cells)]

    @property
    def rows(self) -> int:
        """The rows of X."""
        return len(self._row)

    def _row_of(self, window: list[int]) -> int:
        return self._row.setdefault(tuple(window), len(self._row))

    def predict(self, cells: Tensor) -> Tensor:
        """θ of some cells [F, n], 0 where a cell is no unknown."""
        padded = torch.nn.functional.pad(self.theta.T, (0, 1))  # column −1 is 0
        return padded[:, self._column[cells]]

    def forget(self) -> None:
        """Drop the windows; the solution stays as a first guess."""
        self._row.clear()
        for block in (self._weights, self._blocks[1:], self._squares):
            block.zero_()

    def solve(self, regularization: float, tolerance: float, iterations: int) -> None:
        """Preconditioned conjugate gradient for all fits at once, until the slowest has converged.

        Residuals are taken in double precision, and the correction that removes one is found in single, in half the
        time; a tolerance that single precision cannot reach in one pass takes another.
        """
        theta, target, visits = self._blocks[:, : len(self.cells)]
        design = Design(self._index[0, : self.rows], len(self.cells), self.none)
        weights = self._weights[0, : self.rows]
        inverse = (visits + regularization).reciprocal_()
        enough = tolerance**2 * (target.square() * inverse).sum(0)
        single = Normal(design, weights.float(), regularization)
        double = Normal(design, weights, regularization)
        while iterations > 0:
            residual = target - double(theta)
            energy = (residual.square() * inverse).sum(0)
            goal = torch.maximum(enough, PASS * energy)
            correction, taken = single.solve(residual.float(), inverse.float(), goal.float(), iterations)
            theta += correction
            iterations -= max(taken, 1)
            if torch.equal(goal, enough):
                break
