"""Compiled loops (Numba), one module per kernel.

Import them inside functions: compiling and loading takes time.

Each has one implementation; the tests hold it against the literal float64 equation.
"""

from __future__ import annotations


def use_widest_vectors() -> None:
    """Let Numba compile for the processor's widest vectors.

    LLVM keeps to half of them (256 of 512 bits) on several Intel processors, for fear of their clock; the signature
    then takes 1.3 times as long, the synthesis 1.8 times. The setting is Numba's and counts for all it compiles in
    this process; whoever sets ``NUMBA_CPU_FEATURES``, ``NUMBA_CPU_NAME`` or ``NUMBA_ENABLE_AVX`` is left alone. It
    comes too late where something was compiled before: the kernels are slower then, their bytes the same, since none
    of them leaves the order of a sum to the compiler.
    """
    from numba import config
    from numba.core.codegen import get_host_cpu_features

    chosen = config.CPU_NAME is not None or config.CPU_FEATURES is not None  # type: ignore[attr-defined]
    features: str = get_host_cpu_features()  # type: ignore[no-untyped-call]
    if "+avx512f" in features.split(",") and not chosen:  # with NUMBA_ENABLE_AVX=0 there is none
        config.CPU_FEATURES = features + ",-prefer-256-bit"  # type: ignore[attr-defined]


use_widest_vectors()  # before the first kernel is compiled or looked up among the compiled ones
