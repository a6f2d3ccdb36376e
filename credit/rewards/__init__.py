"""Two estimators, many feature maps."""
