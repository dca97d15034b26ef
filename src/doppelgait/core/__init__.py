"""Names, units, errors, configuration, randomness and kernels."""
