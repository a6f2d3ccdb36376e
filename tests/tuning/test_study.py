"""A study: what it keeps, how it goes on, and what it refuses."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import optuna
import pytest
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import TrialState

from credit.core.errors import UserError
from credit.tuning.space import read
from credit.tuning.study import STORE, Study

WORDS = ["mixer.alpha=interval(.1,1)", "bonus.count.scale=tag(log,interval(.05,1))"]


@pytest.fixture
def opened(tmp_path: Path, composed: Callable[..., dict[str, Any]]) -> Callable[..., Study]:
    def study(*words: str, fixed: tuple[str, ...] = (), metric: str = "regret/cumulative", place: str = "") -> Study:
        config = composed("method=disagreement", "replicas=3", *fixed)
        space = read([*fixed, *(words or WORDS)], config)
        return Study(tmp_path / place, "mine", space, config, metric, False, "tpe")

    return study


def loaded(study: Study) -> optuna.Study:
    """As Optuna's tools open it."""
    storage = JournalStorage(JournalFileBackend(str(study.folder / STORE)))
    return optuna.load_study(study_name="mine", storage=storage)


def values(study: Study) -> list[tuple[Any, ...]]:
    return [(*trial.params.values(), trial.value) for trial in study.trials()]


def score(params: dict[str, float]) -> list[float]:
    return [abs(params["mixer.alpha"] - 0.3) + seed for seed in (0.0, 0.1)]


def test_the_default_is_first_and_the_best_is_found(opened: Callable[..., Study]) -> None:
    with opened() as study:
        assert study.best is None
        for _ in range(4):
            trial = study.ask()
            study.tell(trial, score(trial.params), folder="there")
        assert study.trials()[0].params == {"mixer.alpha": 0.5, "bonus.count.scale": 0.35}
        best = study.best
        assert best is not None
        assert best.value == min(trial.value for trial in study.trials() if trial.value is not None)
        assert study.ended == 4
        frame = study.frame
    assert frame.index.tolist() == [0, 1, 2, 3]
    assert frame.loc[0, "default"]
    assert frame.loc[0, "scores"] == [0.2, pytest.approx(0.3)]
    assert frame.loc[0, "words"] == "mixer.alpha=0.5 bonus.count.scale=0.35"
    assert frame["folder"].tolist() == ["there"] * 4


def test_one_that_was_interrupted_goes_on_as_if_nothing_had_happened(
    opened: Callable[..., Study], tmp_path: Path
) -> None:
    with opened(place="whole") as study:
        for _ in range(15):
            trial = study.ask()
            study.tell(trial, score(trial.params))
        whole = values(study)
    (tmp_path / "parts").mkdir()
    while True:
        with opened(place="parts") as study:
            for trial in study.interrupted():
                study.tell(trial, score(trial.params))
            if study.ended == 15:
                break
            study.ask()  # and then it is killed
    with opened(place="parts") as study:
        assert values(study) == whole


def test_optuna_opens_the_store(opened: Callable[..., Study]) -> None:
    with opened() as study:
        trial = study.ask()
        study.tell(trial, [1.0, 2.0], words=["a=1"])
    theirs = loaded(study)
    assert theirs.best_value == 1.5
    assert theirs.best_trial.user_attrs["words"] == ["a=1"]
    assert theirs.direction is optuna.study.StudyDirection.MINIMIZE


@pytest.mark.parametrize("name", ["plain", "q?x", "a%20b", "it's", "d${x}", "h#x", "grüße"])
def test_a_folder_of_any_name(opened: Callable[..., Study], tmp_path: Path, name: str) -> None:
    with opened(place=name) as study:
        study.ask()
    assert [path.name for path in tmp_path.iterdir()] == [name]
    with opened(place=name) as study:
        assert len(study.trials()) == 1


def test_no_number_is_a_failure(opened: Callable[..., Study]) -> None:
    with opened() as study:
        study.tell(study.ask(), [1.0, math.nan])
        study.tell(study.ask(), [], error="why")
        assert [trial.state for trial in study.trials()] == [TrialState.FAIL] * 2
        assert study.trials()[1].user_attrs["error"] == "why"
        assert study.best is None
        assert study.ended == 2


def test_one_that_was_killed_at_its_birth_has_failed(opened: Callable[..., Study]) -> None:
    with opened() as study:
        study.tell(study.ask(), [1.0])
        loaded(study).ask()  # without a value of any key
        assert study.interrupted() == []
        assert study.trials()[1].state is TrialState.FAIL


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"words": ["mixer.alpha=interval(.1,2)", WORDS[1]]}, r"mixer.alpha: interval\(.1,1\) → interval\(.1,2\)"),
        ({"words": [WORDS[0]]}, r"bonus.count.scale: tag\(log,interval\(.05,1\)\) → one value"),
        ({"words": [*WORDS, "uncertainty.draws=5,20"]}, "uncertainty.draws: one value → 5,20"),
        ({"fixed": ("trainer.steps=70",)}, "trainer.steps: 14000 → 70"),
        ({"fixed": ("seed=1",)}, "seeds: 0–2 → 1–3"),
        ({"metric": "reward/mse"}, "metric: regret/cumulative → reward/mse"),
    ],
)
def test_a_study_of_something_else(opened: Callable[..., Study], changed: dict[str, Any], said: str) -> None:
    with opened() as study:
        study.ask()
    words = changed.pop("words", WORDS)
    with pytest.raises(UserError, match=f"is a study of something else: .*{said}.*study=NAME"):
        opened(*words, **changed)
    with opened("mixer.alpha=interval(0.10,1.)", WORDS[1]) as again:  # the same in other letters
        assert len(again.trials()) == 1


def test_two_at_once(opened: Callable[..., Study]) -> None:
    with opened(), pytest.raises(UserError, match="is being gone on with by process"):
        opened()


def test_a_damaged_store(opened: Callable[..., Study], tmp_path: Path) -> None:
    file = tmp_path / "tuning" / "mine" / STORE
    file.parent.mkdir(parents=True)
    file.write_text("no journal\nat all\n")
    with pytest.raises(UserError, match=r"study.log: Optuna cannot open it .*restore it, or move its folder away"):
        opened()
    assert file.exists()


def test_a_line_that_a_power_cut_left_is_taken_away(opened: Callable[..., Study]) -> None:
    with opened() as study:
        study.tell(study.ask(), [1.0])
    with (study.folder / STORE).open("a") as file:
        file.write('{"op_code":5,"tri')
    with opened() as study:
        study.tell(study.ask(), [2.0])
    with opened() as study:
        assert [trial.value for trial in study.trials()] == [1.0, 2.0]


def test_a_study_that_comes_to_nothing_leaves_nothing(opened: Callable[..., Study], tmp_path: Path) -> None:
    with opened() as study:
        study.ask()
        study.forget()
    assert not study.folder.exists()
    with opened() as study:
        study.tell(study.ask(), [1.0])
        study.forget()  # not what is known
    with opened() as study:
        study.forget()
        assert study.ended == 1
