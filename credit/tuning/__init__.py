"""Settings that are searched for: Optuna's spaces, samplers and store, with runs of credit as trials."""
