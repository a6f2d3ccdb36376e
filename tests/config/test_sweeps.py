"""Several values of a word: the jobs that they stand for, and what stands for none."""

from __future__ import annotations

import pytest

from credit.config import files, sweeps
from credit.core.errors import UserError


def test_expand() -> None:
    jobs = sweeps.expand(["method=delayed,reference", "seed=0", "mixer.alpha=.1,.2"])
    assert len(jobs) == 4
    assert jobs[0] == ["method=delayed", "seed=0", "mixer.alpha=0.1"]
    assert jobs[-1] == ["method=reference", "seed=0", "mixer.alpha=0.2"]
    assert sweeps.expand(["seed=3"]) == [["seed=3"]]
    assert sweeps.expand(["bonus=[count,disagreement]"]) == [["bonus=[count,disagreement]"]]
    assert sweeps.expand(["seed=range(3)"]) == [["seed=0"], ["seed=1"], ["seed=2"]]


def test_a_pattern_stands_for_the_options_that_it_fits() -> None:
    found = [words[0] for words in sweeps.expand(["method=glob(delayed*)"])]
    assert found == [f"method={name}" for name in files.options("method") if name.startswith("delayed")]
    assert len(found) > 1
    assert sweeps.expand(["reward@reference=glob([ridge,dnn],exclude=d*)"]) == [["reward@reference=ridge"]]


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("bonus.count.scale=interval(0,1)", r"interval\(0,1\).*cannot be listed.*range\(0,1,.25\)"),
        ("seed=range(5,3)", r"'seed=range\(5,3\)' has no values: it goes from 5 to 3 in steps of 1"),
        ("mixer.alpha=range(0,1,0)", r"has no values: it goes from 0 to 1 in steps of 0"),
        ("method=glob(dealyed*)", r"'method=glob\(dealyed\*\)' fits no option; did you mean 'delayed'"),
        ("mixer.alpha=glob(.1*)", r"a pattern chooses among the options of a group, and this is none"),
    ],
)
def test_what_stands_for_no_job(word: str, said: str) -> None:
    with pytest.raises(UserError, match=said):
        sweeps.expand([word])
