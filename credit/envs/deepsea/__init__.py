"""DeepSea: a grid that asks for deep exploration."""
