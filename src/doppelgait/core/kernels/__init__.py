"""Compiled loops, one module per kernel.

Each has one implementation; the tests hold it against the literal float64 equation. How they become machine code is in
:mod:`doppelgait.core.kernels.compiled`.
"""
