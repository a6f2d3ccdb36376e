"""A reference that lacks what moves the labels is named as such, and a good one is not."""

from __future__ import annotations

import numpy as np

from tests.logged.test_recovering import found, table


def test_a_surrogate_that_predicts_far_better_than_the_mixture_is_named() -> None:
    one = found(table(), reference="1 + z", surrogates={"x": "1 + x"})
    alike = {name: scores[0] for name, scores in one.r_squared.items()}
    assert alike["x"] - alike["mixture"] > 0.3
    (said,) = [sentence for sentence in one.said if "held out far better" in sentence]
    assert said.startswith(
        f"x predicts labels that were held out far better than the mixture does (R² {alike['x']:.3f} and "
        f"{alike['mixture']:.3f})"
    )
    assert "the reference has no term of x, which x has" in said
    assert "X predicts labels that were held out far better" in one.report()


def test_a_column_that_the_reference_lacks_is_named_where_the_mixture_is_no_worse() -> None:
    frame = table().assign(v=np.random.default_rng(7).normal(size=200))
    one = found(frame, states=["z", "v"], surrogates={"both": "1 + x + z + v"})
    assert [sentence for sentence in one.said if "reference" in sentence] == [
        "the reference has no term of v, which both has: the mixture believes in little of it; a reference should have "
        "every column"
    ]


def test_a_reference_with_all_columns_raises_no_alarm() -> None:
    one = found(table(), surrogates={"x": "1 + x", "z": "1 + z"})
    assert not any("reference" in sentence for sentence in one.said)
