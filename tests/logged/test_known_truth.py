"""What a run recovered is recovered again from the table of its windows alone, by the words of a command line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import credit
from credit.cli.main import main

EXACT = "reference.tolerance=1e-13"  # the table of sepsis is solved by conjugate gradient, from the last solution on
RUNS = {
    "advertiser": ("trainer.steps=420", "trainer.windows_per_round=3"),
    "sepsis": ("experiment=sepsis", "feedback=terminal", "trainer.steps=400", EXACT),
}
WORDS = {
    "advertiser": ("experiment=advertiser", "data.sizes={observation: 10, action: 3}"),
    "sepsis": ("experiment=sepsis", EXACT, "data.sizes={observation: 1296, action: 8}"),
}
COLUMNS = ("data.window=window", "data.label=label", "data.states=[observation]", "data.actions=[action]",
           "data.time=false", "data.group=false")  # fmt: skip


@pytest.mark.parametrize("name", ["advertiser", "sepsis"])
def test_the_table_alone_gives_what_the_run_believed(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    place = credit.run([*RUNS[name], "method=disagreement", "seed=3", "tracking=none"]).folders[0]
    credit.export(place, "data.csv")
    assert main(["recover", "data.csv", *WORDS[name], *COLUMNS, "seed=3", "tracking=none"]) == 0
    steps, rows = pd.read_csv("outputs/recover/data/steps.csv"), pd.read_csv("data.csv")
    arrays = credit.load(place).recovery
    assert arrays is not None
    reference, *surrogates = [str(model) for model in arrays["models"]]
    cells = rows["observation"].to_numpy(), rows["action"].to_numpy()
    pairs = {"credit": "reward/mixed"}
    for ours, theirs in (("reference", reference), *((one, one) for one in surrogates)):
        pairs |= {f"credit_{ours}": f"reward/{theirs}", f"weight_{ours}": f"weight/{theirs}"}
    for ours, theirs in pairs.items():
        np.testing.assert_allclose(steps[ours], arrays[theirs][cells], rtol=0, atol=1e-8, err_msg=ours)
    squares = np.stack([arrays[f"mse/{reference}"], *(arrays[f"disagreement/{one}"] for one in surrogates)])
    signal = np.sqrt(np.take_along_axis(squares, arrays["best"][None].astype(int), 0)[0])
    np.testing.assert_allclose(steps["disagreement"], signal[cells], rtol=0, atol=1e-8)
