"""Credit for logged data: a reward for every row of a table, from labels on windows of rows; no simulator."""
