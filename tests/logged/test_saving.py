"""A model's folder: what is written is read again, and what is damaged or foreign is named."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import torch

import credit
from credit.core.errors import UserError
from credit.core.seams import Mixer
from credit.logged.result import LoggedCredit
from credit.logged.saving import SavedModel
from credit.recovery.mixers import Best, RelativeMSE
from tests.logged.test_recovering import found, table


class Own(Mixer):
    def __init__(self, share: float = 0.25) -> None:
        self.share = share

    def weights(self, mse: torch.Tensor, label_errors: torch.Tensor | None = None) -> torch.Tensor:
        weights = torch.full_like(mse, self.share / (mse.shape[-2] - 1))
        weights[..., 0, :] = 1 - self.share
        return weights


class Forgetful(Own):
    def __init__(self, part: float = 0.25) -> None:
        super().__init__(part)


def small(**words: Any) -> LoggedCredit:
    return found(table(windows=15), **{"draws": 10, "surrogates": {"x": "1 + x"}, **words})


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    small().model.write(tmp_path / "sales" / "model")
    return tmp_path / "sales"


@pytest.mark.parametrize("mixer", [RelativeMSE(alpha=0.2), Best(), Own(0.5)])
def test_the_mixer_is_found_again_with_its_parameters(tmp_path: Path, mixer: Mixer) -> None:
    one = small(mixer=mixer)
    one.model.write(tmp_path / "model")
    again = credit.load_model(tmp_path)
    assert type(again.fitted.mixer) is type(mixer)
    assert vars(again.fitted.mixer) == vars(mixer)
    pd.testing.assert_frame_equal(again.predict(table(windows=15)), one.steps, rtol=1e-12, atol=1e-12)


def test_a_folder_is_that_of_the_recovery_or_of_its_model(folder: Path) -> None:
    for path in (folder, folder / "model", str(folder)):
        assert SavedModel.read(path).fitted.names == ("reference", "x")


def test_nothing_that_runs_is_written_and_numbers_are_those_of_json(folder: Path) -> None:
    names = sorted(path.name for path in (folder / "model").iterdir())
    assert names == ["fits.npz", "model.json"]
    json.loads((folder / "model" / "model.json").read_text(), parse_constant=pytest.fail)  # no NaN
    with np.load(folder / "model" / "fits.npz", allow_pickle=False) as arrays:
        assert arrays["0.theta"].shape == (11, 3)
        assert {values.dtype.kind for values in arrays.values()} <= {"f", "i"}


def test_it_says_how_it_was_fitted(folder: Path) -> None:
    one = SavedModel.read(folder)
    assert one.options["draws"] == 10
    assert one.source == "the frame"
    assert one.known.roles.actions == ("x",)
    assert one.fitted.parts[0].model.terms.formula == "1 + x + z"


def test_candidates_that_no_fit_chose_are_left_out(tmp_path: Path) -> None:
    frame = table(windows=60)
    one = found(frame, reference="1 + adstock(x, [0, .5, .9]) + z", surrogates={}, draws=2)
    one.model.write(tmp_path / "model")
    part = SavedModel.read(tmp_path).fitted.parts[0]
    assert part.theta is not None
    assert part.theta.shape[1] < len(part.model.terms.names)
    assert one.chosen["reference"] == part.chosen
    np.testing.assert_allclose(SavedModel.read(tmp_path).predict(frame)["credit"], one.steps["credit"], rtol=1e-12)


def test_levels_that_json_has_no_form_for_are_known_by_how_they_are_written(tmp_path: Path) -> None:
    frame = table(windows=15)
    levels = pd.IntervalIndex.from_breaks([-9, 0, 9])
    frame["z"] = pd.Categorical.from_codes((frame["z"] > 0).astype(int), categories=levels)
    one = found(frame, draws=2, states=[], actions=["x"], surrogates={}, reference="1 + x")
    one.model.write(tmp_path / "model")
    assert len(SavedModel.read(tmp_path).predict(frame)) == len(frame)


def edited(path: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    whole = json.loads(path.read_text())
    change(whole)
    path.write_text(json.dumps(whole))


PLAIN, FITS = "model/model.json", "model/fits.npz"


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda at: (at / PLAIN).unlink(), "there is no model.json"),
        (lambda at: (at / FITS).unlink(), "fits.npz: this file is missing"),
        (lambda at: (at / FITS).write_bytes(b"PK\x03\x04"), "fits.npz is not the file"),
        (lambda at: (at / PLAIN).write_text("{"), "model.json cannot be read"),
        (lambda at: (at / PLAIN).write_text("[]"), "model.json is no model"),
        (lambda at: edited(at / PLAIN, lambda one: one.update(format=99)), "has format 99"),
        (lambda at: edited(at / PLAIN, lambda one: one.pop("rho")), r"model.json is damaged.*no 'rho'"),
        (lambda at: edited(at / PLAIN, lambda one: one.update(models=[])), "no models"),
        (lambda at: edited(at / PLAIN, lambda one: one["models"][0].update(kind="tree")), "'tree' is no kind"),
        (lambda at: edited(at / PLAIN, lambda one: one["models"][0]["terms"].update(formula="1 + x")), "not those of"),
        (lambda at: edited(at / PLAIN, lambda one: one["models"][0]["terms"].update(formula="open('x')")), "open"),
        (lambda at: edited(at / PLAIN, lambda one: one["known"].update(missing="guess")), "guess"),
        (lambda at: edited(at / PLAIN, lambda one: one["mixer"].update({"class": "os:system"})), "is no mixer"),
        (
            lambda at: edited(at / PLAIN, lambda one: one["mixer"].update({"class": "nowhere:Mix"})),
            "model.json: the mixer nowhere:Mix cannot be imported",
        ),
        (lambda at: edited(at / PLAIN, lambda one: one["mixer"].update(parameters={"alpha": -1})), "alpha"),
    ],
)
def test_what_is_damaged_is_named(folder: Path, damage: Callable[[Path], Any], said: str) -> None:
    damage(folder)
    with pytest.raises(UserError, match=said):
        SavedModel.read(folder)


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"nowhere: there is no model\.json"):
        credit.load_model(tmp_path / "nowhere")


def test_fits_of_another_model_are_not_taken(folder: Path, tmp_path: Path) -> None:
    small(seed=7).model.write(tmp_path / "other")
    (folder / FITS).write_bytes((tmp_path / "other" / "fits.npz").read_bytes())
    with pytest.raises(UserError, match="is not the file that"):
        SavedModel.read(folder)


def test_a_mixer_that_could_not_be_made_again_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="keep its parameter 'part'"):
        small(mixer=Forgetful()).model.write(tmp_path / "model")

    class Inside(Own):
        pass

    with pytest.raises(UserError, match="stands in no module"):
        small(mixer=Inside()).model.write(tmp_path / "other")
