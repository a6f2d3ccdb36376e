"""What is left of labels: an autoregression of steps, and credit that adds up."""
