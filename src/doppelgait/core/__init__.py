"""Names, units, errors, configuration, randomness and kernels: what every other layer stands on."""
