"""What a constructor's signature does not allow is refused from Python, too."""

from __future__ import annotations

import re

import numpy as np
import pytest
import torch

from credit.core.errors import UserError
from credit.envs.feedback import BlockSum
from credit.recovery.features.motion import Motion
from credit.recovery.models.linear import LinearModel
from credit.recovery.recovery import Recovery
from credit.recovery.uncertainty.bootstrap import Analytic


@pytest.mark.parametrize("window", [np.int64(3), torch.tensor(3), 3])
def test_a_number_is_a_number_whoever_holds_it(window):
    assert BlockSum(window=window).window == 3


@pytest.mark.parametrize("window", [np.int64(0), np.float64(2.5), np.array([3]), "3", True])
def test_what_is_out_of_range_is_refused(window):
    with pytest.raises(UserError, match=re.escape(f"BlockSum(window={window!r}): ")):
        BlockSum(window=window)


def test_a_component_is_not_its_name():
    with pytest.raises(UserError, match=r"Recovery\(mixer='best'\): 'best' is no component; give an instance of"):
        Recovery(LinearModel("linear", Motion(), Analytic(noise=1.0)), mixer="best")
