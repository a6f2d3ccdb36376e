"""Transition models for planning: counts, and counts shrunk towards a structured estimate where little was seen."""

from credit.transitions.counts import Counts, ObservedCounts
from credit.transitions.exact import Exact
from credit.transitions.factored import FactoredMixture
from credit.transitions.shift import ShiftMixture

__all__ = ["Counts", "Exact", "FactoredMixture", "ObservedCounts", "ShiftMixture"]
