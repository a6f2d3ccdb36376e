"""Ranges of parameters: the check derives its schema from signatures, so a range is written here and nowhere else."""

from __future__ import annotations

from typing import Annotated, Literal

from annotated_types import Ge, Gt, Interval, Predicate

from credit.core.naming import is_line, is_name

Share = Annotated[float, Interval(ge=0, lt=1)]
Positive = Annotated[float, Gt(0)]
NonNegative = Annotated[float, Ge(0)]
Probability = Annotated[float, Interval(ge=0, le=1)]
PositiveInt = Annotated[int, Ge(1)]
NonNegativeInt = Annotated[int, Ge(0)]
Name = Annotated[str, Predicate(is_name)]  # of something that reaches files, columns and metrics
Line = Annotated[str, Predicate(is_line)]  # for tables, figures and the terminal

Credit = Literal["every_step", "last_step"]  # a hypothesis: which steps of a window share its label
