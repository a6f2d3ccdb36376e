"""What may be a name, and what becomes of one on its way to MLflow."""

from __future__ import annotations

import pytest
import torch

from credit.core.errors import UserError
from credit.core.naming import is_line, is_metric, is_name, metric_name
from credit.recovery.features.tabular import Identity
from credit.recovery.models.linear import LinearModel
from credit.recovery.recovery import names_of
from credit.recovery.uncertainty.bootstrap import Bootstrap
from credit.runs.journal import Journal

BAD = ["a,b", "a\nb", "a//b", "a/b", "../x", "x" * 260, "ü" * 60, "", " a", "a ", 'a"b', "_a", "a[/b]", "\x1b[2J"]


@pytest.mark.parametrize("name", ["ridge", "linear_last", "Größe 2", "v1.2+x", "0-9", "x" * 100])
def test_names(name: str) -> None:
    assert is_name(name)
    assert metric_name(f"weight/{name}").startswith("weight/")


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_name_is_refused_where_it_enters(name: str) -> None:
    assert not is_name(name)
    with pytest.raises(UserError, match=r"LinearModel\(name=.*not allowed; allowed: str \(letters, digits"):
        LinearModel(name, Identity(), Bootstrap(2))


def test_a_model_of_ones_own_is_asked_too() -> None:
    model = LinearModel("fine", Identity(), Bootstrap(2))
    model.name = "a,b"
    with pytest.raises(UserError, match="a reward model is called 'a,b'; allowed: letters"):
        names_of([model])


def test_metrics_are_paths_of_names(tmp_path) -> None:
    assert is_metric("eval/success_averaged")
    for name in ("eval/a,b", "eval//b", "a\nb", "../x"):
        assert not is_metric(name)
        journal = Journal([tmp_path])
        with pytest.raises(ValueError, match="a metric is called"):
            journal.log(1, {name: torch.zeros(1).tolist()})


def test_titles_are_lines() -> None:
    assert is_line("a[/b] [v2] $x_{$ → ü")
    assert not is_line("a\nb")
    assert not is_line("\x1b[2J")
    assert not is_line("x" * 201)


def test_what_mlflow_would_take_for_another_path_gets_a_name_of_its_own() -> None:
    assert metric_name("interval/weight_dnn_low") == "interval/weight_dnn_low"
    assert metric_name("a=b") == "a_b"
    odd = ["a//b", "../x", "/x", "x/", "x/.", "y" * 251, "y" * 252]
    assert len({metric_name(name) for name in odd}) == len(odd)
    for name in map(metric_name, odd):
        assert len(name) <= 250
        assert not any(part in ("", ".", "..") for part in name.split("/"))
