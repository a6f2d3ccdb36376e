"""Formulas over rows: checked, with terms that look back in time, as columns of a design."""
