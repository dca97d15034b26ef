"""Names, units, errors, configuration, randomness and kernels for all other layers."""
