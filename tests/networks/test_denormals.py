"""Denormal numbers are zero within, and what they were outside."""

from __future__ import annotations

import pytest
import torch

from credit.networks.denormals import flushed


def kept() -> bool:
    return bool(torch.tensor(1e-39) * 1 > 0)


def test_flushed_within_and_as_before_outside() -> None:
    assert kept()
    with flushed():
        assert not kept()
        with flushed():
            pass
        assert not kept()
    assert kept()


def test_as_before_after_an_error() -> None:
    with pytest.raises(KeyError), flushed():
        raise KeyError
    assert kept()
