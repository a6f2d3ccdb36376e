"""Labels → a pseudo-reward for every step: reference, surrogates, proxies, mixture, optimism."""
