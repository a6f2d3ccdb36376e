"""Watch repair: one decision, paid for fifty steps later."""
