"""Comparing finished runs: statistics, tables and figures made from run folders alone."""
