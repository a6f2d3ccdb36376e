"""Formulas against formulaic's own model matrix, and what they refuse."""

from __future__ import annotations

import sys
from dataclasses import replace

import formulaic
import numpy as np
import pandas as pd
import pytest
import torch

from credit.core.errors import RunError, UserError
from credit.core.problem import Problem
from credit.core.steps import Steps
from credit.core.windows import Windows
from credit.recovery.features.formula import Formula
from credit.recovery.features.tabular import Bilinear

FINITE = Problem.finite(5, 3, 7, (0, 1))
VECTORS = replace(Problem.vectors(2, 1, 4, (0, 1)), names=("x", "v"))


def of(formula: str, problem: Problem) -> Formula:
    features = Formula(formula)
    features.start(problem)
    return features


@pytest.mark.parametrize(
    "formula",
    [
        "1 + s + a + s:a",
        "s*a",
        "0 + C(a)",
        "C(s)*C(a)",
        "C(a):s - 1",
        "0 + C(s):C(a)",
        "a + C(s):a",
        "2.5:s:C(a)",
        "a/s",
        "log(1 + s) + {s**2} + I(a/2)",
        "(s + C(a))**2",
        "C(a):exp(-s/4) + C(s)",
        "0 + s:C(a) + C(s)",
    ],
)
def test_columns_are_those_of_formulaic(formula: str) -> None:
    steps = FINITE.cells.steps(torch.device("cpu"))
    frame = pd.DataFrame({"s": steps.states.numpy(), "a": steps.actions.numpy()})
    wanted = np.asarray(formulaic.model_matrix(formula, frame), dtype=float)
    features = of(formula, FINITE)
    np.testing.assert_allclose(features(steps).numpy(), wanted, rtol=1e-14)
    one = Steps(*(part[7:8].expand(2, 1) for part in (steps.states, steps.actions, steps.next_states)))
    np.testing.assert_allclose(features(one).numpy(), wanted[None, 7:8].repeat(2, 0), rtol=1e-14)  # whatever the batch


def test_coordinates_of_vectors_have_names() -> None:
    generator = torch.Generator().manual_seed(0)
    states, actions = torch.rand(2, 6, 2, generator=generator), torch.rand(2, 6, 1, generator=generator)
    values = of("x + v:a0 + tanh(s1)", VECTORS)(Steps(states, actions, states))
    x, v, a = states[..., 0], states[..., 1], actions[..., 0]
    torch.testing.assert_close(values, torch.stack([torch.ones_like(x), x, torch.tanh(v), v * a], -1))


def test_the_default_is_bilinear() -> None:
    steps, bilinear = FINITE.cells.steps(torch.device("cpu")), Bilinear()
    bilinear.start(FINITE)
    assert torch.equal(of("1 + s + a + s:a", FINITE)(steps), bilinear(steps))


@pytest.mark.parametrize(
    ("formula", "said"),
    [
        ("s +", "at character 3: '\\+'"),
        ("s + (a", "at character 5"),
        (" ", "nothing in it"),
        ("0", "no term"),
        ("y ~ s", "several formulas"),
        ("lgo(s)", "did you mean 'log'"),
        ("poly(s, 2)", "'poly' is no function"),
        ("__import__('os').system('x')", "invalid syntax"),
        ("{s.__class__}", "s.__class__"),
        ("s[0]", "no arithmetic"),
        ("I(s ^ 2)", "no arithmetic"),
        ("log(C(a))", "categories are no numbers"),
        ("(s + a)**20", "at most 5"),
        ("*".join(f"s{i}" for i in range(40)), "more than 10000 terms"),  # 2⁴⁰
        ("(" + " + ".join(f"s{i}" for i in range(30)) + ")**5", "more than 10000 terms"),
        ("1 + s**2 + a", r"s\*\*2, at character 5, is a power of a term.*\{s\*\*2\} or I\(s\*\*2\)"),
        ("s^2", r"I\(s\*\*2\)"),
        ("(s + a)**2 + log(1 + s)**3", r"which is log\(1 \+ s\) itself"),
    ],
)
def test_what_is_no_formula_is_refused_when_made(formula: str, said: str) -> None:
    with pytest.raises(UserError, match=said) as caught:
        Formula(formula)
    assert repr(formula) in str(caught.value)
    assert "allowed" in str(caught.value) or "one coordinate" in str(caught.value)


@pytest.mark.parametrize(
    ("formula", "problem", "said"),
    [
        ("s0 + s", FINITE, "no coordinate 's0' here; did you mean 's'"),
        ("s", VECTORS, "did you mean 's0'.*valid: x, v, s0, s1, a0"),
        ("C(x)", VECTORS, "real number"),
        ("log(s)", FINITE, "log\\(s\\) is not a finite number where s = 0"),
        ("{9**9**9}", FINITE, "not a finite number;"),
        ("s", replace(VECTORS, names=("x",)), "names 1 coordinates"),
        ("s", replace(VECTORS, names=("x", "s0")), "each is there once"),
    ],
)
def test_what_does_not_fit_is_refused_at_the_start(formula: str, problem: Problem, said: str) -> None:
    with pytest.raises(UserError, match=said):
        of(formula, problem)


def test_steps_that_were_taken_have_finite_features() -> None:
    states = torch.tensor([[[1.0, 1.0], [0.0, 1.0]]] * 2)
    windows = Windows(states, states[..., :1], states, labels=torch.zeros(2, 1), length=2)
    features = of("log(x)", VECTORS)
    with pytest.raises(RunError, match="log\\(x\\) is not a finite number where s0 = 0"):
        features(windows)
    rest = replace(windows, length=None, last=torch.zeros(2, 1).long(), count=torch.ones(2).long())
    assert features(rest).isfinite().all()  # a row that means nothing may be anything


def test_without_formulaic_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "formulaic", None)
    with pytest.raises(UserError, match="pip install 'credit-rl\\[formula\\]'"):
        Formula()
