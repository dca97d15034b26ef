"""Compiled loops (Numba), one module a kernel. Import them inside functions: compiling and loading takes time.

Each has one implementation; the tests hold it against the literal float64 equation.
"""
