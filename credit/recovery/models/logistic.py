"""Labels that are bits: what a reward model fits then, and what the rest of a recovery sees of it.

A window i has the label Y_i ∈ {0, 1}, and its log-odds are a sum over its steps and an intercept:

    P(Y_i = 1) = σ(z_i),  z_i = b + Σ_{t∈i} f(s_t, a_t),  σ(z) = 1 / (1 + e^{−z})                    (a)
    minimised is  Σ_i w_i [log(1 + e^{z_i}) − Y_i z_i] + a penalty,  with the gradient w_i (σ(z_i) − Y_i) by z_i   (b)

*A step's pseudo-reward* is its contribution f to the log-odds: r̂(s, a) = f(s, a). b belongs to no step, and no agent
sees it. *Mixture and gap* (9), (11), (15) compare and mix such contributions, so that all models of a recovery must
have one likelihood. *Uncertainty*: draws refit (b) with weights w of their own, and networks differ as ever; what is
Gaussian in closed form becomes Laplace's approximation around the fit, for ridge and for a network's last layer alike,

    Var̂ r̂ = φᵀ H⁻¹ φ,  H = Σ_i w_i σ(z_i)(1 − σ(z_i)) x_i x_iᵀ + Λ,  x_i = Σ_{t∈i} φ(s_t, a_t)                 (c)

where no deviation σ of the label's noise appears: the likelihood has none. *Label errors* (stacking) compare Y with the
probability: of window i, the mean over the draws that did not see it of σ(b_draw + Σ_t f_draw), less Y_i.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import torch
from torch import Tensor
from torch.nn.functional import pad, softplus

from credit.core.errors import RunError, UserError
from credit.core.problem import FLOAT, Problem
from credit.core.state import Stateful
from credit.core.tensors import grown
from credit.core.windows import Windows

WIDE = 100.0  # variance of the intercept's prior: a label that is always the same must not lead to infinity
NEWTON = 100  # steps at most; five to ten are usual
ROUNDING = 1e-12  # of a loss, relative: at its least no step is downhill by more
HALVINGS = 40  # of a step at most
CLOSE = 1e-20  # squared Newton decrement at which a fit is done


def require_bits(model: str, problem: Problem) -> None:
    """Refuse labels that are declared to be no bits.

    Raises:
        UserError: they are.
    """
    if problem.labels == "real":
        raise UserError(
            f"reward model {model!r}: likelihood=logistic is for labels that are 0 or 1, and this feedback's labels "
            "are real numbers; use likelihood=gaussian, or feedback=success (a feedback of your own says kind = 'bits')"
        )


def check_bits(model: str, windows: Windows) -> None:
    """Refuse a label that is no bit.

    Raises:
        RunError: with the first one.
    """
    labels = windows.labels if windows.labelled is None else windows.labels[windows.labelled]
    if len(strange := labels[(labels != 0) & (labels != 1)]):
        raise RunError(
            f"reward model {model!r}: likelihood=logistic is for labels that are 0 or 1, and one is "
            f"{float(strange[0]):.6g}; use likelihood=gaussian"
        )


class LogisticFits(Stateful):
    """R × F linear fits of log-odds by Newton's method, with all their windows: no update by the newest is exact.

    Args:
        problem: R. fits: F. size: d, numbers in φ. regularization: λ, precision of each coefficient's prior.

    Attributes:
        intercept: b [R, F].
    """

    keeps: ClassVar = ("intercept", "_sums", "_labels", "_weights", "_count")

    def __init__(self, problem: Problem, fits: int, size: int, regularization: float) -> None:
        self._prior = torch.full((size + 1,), regularization, dtype=FLOAT, device=problem.device)
        self._prior[-1] = 1 / WIDE
        self.intercept = problem.zeros(fits)
        self._sums, self._weights = problem.zeros(0, size), problem.zeros(0, fits)
        self._labels, self._count = problem.zeros(0), 0

    def filled(self) -> Mapping[str, int]:
        """As many columns as windows."""
        return dict.fromkeys(("_sums", "_labels", "_weights"), self._count)

    def fit(
        self, theta: Tensor, sums: Tensor, labels: Tensor, weights: Tensor, anew: bool = False
    ) -> tuple[Tensor, Tensor]:
        """Take in windows, and fit all that came, from the last coefficients on.

        Args:
            theta: the last θ [R, F, d]. sums: x [R, k, d]. labels: Y [R, k]. weights: w [R, k, F].
            anew: forget what was before.

        Returns:
            θ [R, F, d], and its covariance [R, F, d, d], the block of H⁻¹ (c).
        """
        count = 0 if anew else self._count
        whole = count + labels.shape[1]
        if whole > self._sums.shape[1]:
            self._sums, self._labels, self._weights = (
                grown(kept, whole) for kept in (self._sums, self._labels, self._weights)
            )
        for kept, new in ((self._sums, sums), (self._labels, labels), (self._weights, weights)):
            kept[:, count:whole] = new
        self._count = whole
        found, covariances = torch.empty_like(theta), []
        for replica in range(len(theta)):  # one after the other: each stops by itself
            start = torch.cat([theta[replica], self.intercept[replica].unsqueeze(-1)], dim=-1)
            x, y, w = (kept[replica, :whole] for kept in (self._sums, self._labels, self._weights))
            fit, covariance = newton(x, y, w, self._prior, start)
            found[replica], self.intercept[replica] = fit[:, :-1], fit[:, -1]
            covariances.append(covariance[:, :-1, :-1])
        return found, torch.stack(covariances)


def newton(x: Tensor, y: Tensor, w: Tensor, prior: Tensor, start: Tensor) -> tuple[Tensor, Tensor]:
    """The least of Σ_i w_i [log(1 + e^{z_i}) − y_i z_i] + ½ Σ_j prior_j θ_j² with z = (x, 1)·θ, and H⁻¹ there.

    Newton's method is iteratively reweighted least squares; a step that leads uphill is halved.

    Args:
        x: [K, d]. y: [K]. w: [K, F]. prior: [d+1]. start: [F, d+1], the intercept last.

    Returns:
        θ [F, d+1], and H⁻¹ [F, d+1, d+1].
    """
    x, w, theta = pad(x, (0, 1), value=1.0), w.mT, start

    def loss(theta: Tensor) -> Tensor:
        z = theta @ x.mT
        return (w * (softplus(z) - y * z)).sum(-1) + 0.5 * (prior * theta.square()).sum(-1)

    for _ in range(NEWTON):
        step, decrement = _step(x, y, w, prior, theta)
        going = decrement > CLOSE
        if not going.any():
            break
        before, length = loss(theta), going.to(x.dtype)
        for _ in range(HALVINGS):
            uphill = loss(theta - length.unsqueeze(-1) * step) > before + ROUNDING * before.abs()
            if not uphill.any():
                break
            length = torch.where(uphill, length / 2, length)
        theta = theta - length.unsqueeze(-1) * step
    return theta, torch.linalg.inv(_hessian(x, w, prior, theta)).contiguous()


def _step(x: Tensor, y: Tensor, w: Tensor, prior: Tensor, theta: Tensor) -> tuple[Tensor, Tensor]:
    """Newton's step H⁻¹g [F, d+1], and gᵀH⁻¹g [F]."""
    gradient = (w * (torch.sigmoid(theta @ x.mT) - y)) @ x + prior * theta
    step = torch.linalg.solve(_hessian(x, w, prior, theta), gradient.unsqueeze(-1)).squeeze(-1)
    return step, (step * gradient).sum(-1)


def _hessian(x: Tensor, w: Tensor, prior: Tensor, theta: Tensor) -> Tensor:
    weighted = x * (w * curvature(theta @ x.mT)).unsqueeze(-1)  # [F, K, d+1]
    return weighted.mT @ x + torch.diag(prior)


def curvature(z: Tensor) -> Tensor:
    """σ(z)(1 − σ(z)), the second derivative of (b) by z."""
    return torch.sigmoid(z) * torch.sigmoid(-z)


def drawn_odds(labels: Tensor, labelled: Tensor | None, batch: int, bits: bool) -> Tensor:
    """By how much the log-odds of a label are larger in a batch than among all windows [M].

    A batch of which half are successes knows nothing of how frequent they are; with this added to z in training, b is
    that of all windows. 0 where halves are not by bits, and where all labels are the same.

    Args:
        labels: Y [M, K], bits. labelled: which have one [M, K]. batch: B. bits: whether ⌊B/2⌋ of a batch are successes.
    """
    known = torch.ones_like(labels, dtype=torch.bool) if labelled is None else labelled
    ones, zeros = ((labels == bit) & known for bit in (1, 0))
    high, low = ones.sum(1), zeros.sum(1)
    if not bits or batch < 2:
        return torch.zeros_like(labels[:, 0])
    odds = torch.log(torch.full_like(labels[:, 0], batch // 2 / (batch - batch // 2)))
    return torch.where((high > 0) & (low > 0), odds - (high / low.clamp(min=1)).clamp(min=1e-9).log(), 0.0)
