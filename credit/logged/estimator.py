"""The recovery as an estimator of scikit-learn, for cross-validation, searches and pipelines."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.metrics import r2_score
from sklearn.utils import check_array, check_consistent_length, column_or_1d
from sklearn.utils.validation import check_is_fitted, validate_data

from credit.logged.asking import Ask
from credit.logged.panel import Floats, LabelIs
from credit.logged.recovering import recover
from credit.logged.saving import SavedModel
from credit.logged.tables.opening import opened
from credit.recovery.mixers import RelativeMSE

if TYPE_CHECKING:
    import pandas as pd

    from credit.core.seams import Mixer

Name = str | int  # of a column; its place where X is an array


class CreditRegressor(RegressorMixin, BaseEstimator):
    """Credit of every row, from labels that windows of rows share.

    `fit` takes labels of windows on rows, `predict` gives each row its share, and `score` adds these up again: R² of
    the labels, which is all that was seen. Windows must not be split between folds: give `GroupKFold` the windows. What
    is carried from row to row (lag, adstock) begins anew in the rows of each call.

    Args:
        window, time, group: columns of X that say it, which are no features. window None: each row is its own window.
            time None: rows have no order. group None: one series.
        actions: features that were done; all others were there. label_is: sum, mean, last, or binary: then credit is
            in log-odds. formula: of the reference; None: all columns. regularization: λ in windows; None: by contiguous
            folds. sign: column → positive or negative. surrogates: name → formula; None: none. mixer: of reference and
            surrogates; None: relative MSE. residual: ar1 or uniform; None: ar1 where there is time. draws: refits by
            which models are weighed; without surrogates there are none. folds, gap: on which λ is chosen. seed: of the
            draws.

    Attributes:
        model_: what was fitted; `model_.predict` has intervals, too, and `model_.write` saves it.
        n_features_in_, feature_names_in_: columns of X.

    Example:
        >>> import numpy as np, pandas as pd
        >>> from credit import CreditRegressor
        >>> from sklearn.model_selection import GridSearchCV, GroupKFold
        >>> random = np.random.default_rng(0)
        >>> frame = pd.DataFrame({"week": np.repeat(np.arange(60), 7), "tv": random.gamma(2.0, size=420)})
        >>> sales = (1 + 3 * frame["tv"]).groupby(frame["week"]).transform("sum")
        >>> estimator = CreditRegressor(window="week").fit(frame, sales)
        >>> bool(np.allclose(estimator.predict(frame), 1 + 3 * frame["tv"], atol=0.01))
        True
        >>> grid = {"formula": ["1", "1 + tv"]}
        >>> search = GridSearchCV(CreditRegressor(window="week"), grid, cv=GroupKFold(5))
        >>> search.fit(frame, sales, groups=frame["week"]).best_params_
        {'formula': '1 + tv'}
    """

    def __init__(
        self,
        window: Name | None = None,
        time: Name | None = None,
        group: Name | None = None,
        *,
        actions: Sequence[Name] | None = None,
        label_is: LabelIs = "sum",
        formula: str | None = None,
        regularization: float | None = None,
        sign: Mapping[str, str] | None = None,
        surrogates: Mapping[str, Any] | None = None,
        mixer: Mixer | None = None,
        residual: str | None = None,
        draws: int = 50,
        folds: int = 5,
        gap: int | None = None,
        seed: int = 0,
    ) -> None:
        self.window = window
        self.time = time
        self.group = group
        self.actions = actions
        self.label_is = label_is
        self.formula = formula
        self.regularization = regularization
        self.sign = sign
        self.surrogates = surrogates
        self.mixer = mixer
        self.residual = residual
        self.draws = draws
        self.folds = folds
        self.gap = gap
        self.seed = seed

    def fit(self, X: Any, y: Any) -> CreditRegressor:
        """Fit to labels of windows.

        Args:
            X: a frame or array [n, k]. y: label of each row's window [n]; the same in all of its rows, or NaN in some;
                NaN in all: the window has none.

        Raises:
            UserError, ValueError: what is wrong with X, y or a parameter.
        """
        frame = self._frame(X, reset=True)
        frame, words = self._with_labels(frame, X, y)
        named = {word: self._column(getattr(self, word), X) for word in ("time", "group")}
        actions = [self._column(name, X) for name in self.actions or ()]
        used = {words["window"], words["label"], *named.values(), *actions}
        states = [name for name in frame.columns if name not in used]
        data = {**words, **{word: name or False for word, name in named.items()}}
        asked = Ask.of(
            {
                "data": data | {"actions": actions, "states": states, "label_is": self.label_is},
                "reference": {"formula": self.formula, "regularization": self.regularization, "sign": self.sign or {}},
                "surrogates": self.surrogates or {},
                "draws": self.draws if self.surrogates else 1,
                "residual": self.residual or ("uniform" if self.time is None else "ar1"),
                "folds": self.folds,
                "gap": self.gap,
                "seed": self.seed,
            },
            self.mixer,
        )
        panel = opened(frame, asked.data)
        asked.require(panel)
        found = recover(panel, asked.models(panel), asked.mixer or RelativeMSE(), asked.options)
        self.model_ = SavedModel.of(found)
        return self

    def predict(self, X: Any) -> Floats:
        """Credit of rows [n].

        Args:
            X: as it was fitted, in any order and number of rows.
        """
        check_is_fitted(self)
        credit: Floats = self.model_.predict(self._frame(X)).loc[:, "credit"].to_numpy()
        return credit

    def score(self, X: Any, y: Any) -> float:
        """R² of the labels of windows, predicted by the credit of their rows; of bits, by the Brier score.

        Args:
            X: rows of whole windows. y: labels, as for `fit`.
        """
        check_is_fitted(self)
        frame, words = self._with_labels(self._frame(X), X, y)
        table = self.model_.scored(frame, **words)
        labels = table.panel.windows.label
        known = np.isfinite(labels)
        return float(r2_score(labels[known], table.sums[known]))

    def _frame(self, X: Any, reset: bool = False) -> pd.DataFrame:
        """Rows as a frame with texts as names; frames may hold words, arrays hold numbers."""
        import pandas as pd

        if isinstance(X, pd.DataFrame):
            validate_data(self, X, reset=reset, skip_check_array=True)
            return X.set_axis(X.columns.map(str), axis=1).reset_index(drop=True)
        values = validate_data(self, X, reset=reset, dtype="numeric", ensure_min_samples=2 if reset else 1)
        return pd.DataFrame(np.asarray(values, np.float64), columns=[f"x{at}" for at in range(values.shape[1])])

    def _with_labels(self, frame: pd.DataFrame, X: Any, y: Any) -> tuple[pd.DataFrame, dict[str, str]]:
        """Rows with window and label, and what these columns are called."""
        if y is None:
            raise ValueError(f"{type(self).__name__} requires y to be passed, but the target y is None: give labels")
        check_consistent_length(X, y)
        label = check_array(
            column_or_1d(y, warn=True), ensure_2d=False, dtype=np.float64, ensure_all_finite="allow-nan"
        )
        name = _free("y", frame.columns)
        window = self._column(self.window, X)
        if window is None:
            window = _free("row_number", frame.columns)
            frame = frame.assign(**{window: np.arange(len(frame))})
        return frame.assign(**{name: label}), {"window": window, "label": name}

    @staticmethod
    def _column(name: Name | None, X: Any) -> str | None:
        """A column's name in the frame."""
        return None if name is None else str(name) if hasattr(X, "columns") else f"x{name}"


def _free(name: str, taken: Iterable[str]) -> str:
    """A name that no column has."""
    names = set(taken)
    while name in names:
        name += "_"
    return name
