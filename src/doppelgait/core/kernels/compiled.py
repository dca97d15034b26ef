"""Kernels as machine code, from the package or by Numba.

Compiling all kernels takes half a minute and importing Numba half a second. Object code of the kernels, made from the
same functions by ``make kernels``, lies beside this file in ``objects`` and is loaded in some hundredths of a second.
It is used where the processor has what it needs and the kernel's source file is the one it was made from; for anything
else (another system, an edited kernel, arrays of other types) Numba compiles the function and keeps the result in its
own cache. Whoever sets ``NUMBA_CPU_NAME``, ``NUMBA_CPU_FEATURES``, ``NUMBA_ENABLE_AVX`` or ``NUMBA_DISABLE_JIT`` gets
Numba.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import os
import platform
import sys
import threading
import zlib
from collections.abc import Callable
from functools import lru_cache, partial, update_wrapper
from operator import index
from pathlib import Path
from types import FunctionType
from typing import Any, Literal

import numpy as np

OBJECTS = Path(__file__).parent / "objects"
OTHER_WISHES = ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "NUMBA_ENABLE_AVX", "NUMBA_DISABLE_JIT")
LEVELS = {
    "x86-64-v4": ("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl", "avx2", "fma", "bmi2"),
    "x86-64-v3": ("avx2", "fma", "bmi", "bmi2", "f16c", "lzcnt", "movbe"),
}
"""Levels of processors that there is object code for, the best first, with what they need."""
DONE, RAISED, OTHER_TYPES = 0, 1, 2
"""What the entry of a kernel returns."""
SCALARS: dict[str, Any] = {"int64": ctypes.c_longlong, "uint64": ctypes.c_ulonglong, "float64": ctypes.c_double}

modules: dict[str, list[Kernel]] = {}
"""Kernels by the name of their module, as it was imported."""
_making = threading.RLock()


def kernel(
    *, fastmath: tuple[str, ...] = (), apart: bool = False, inline: Literal["numba", "llvm"] | None = None
) -> Callable[[Callable[..., Any]], Any]:
    """Mark a function as a kernel."""

    def mark(function: Callable[..., Any]) -> Kernel:
        return Kernel(function, fastmath, apart, inline)

    return mark


class Kernel:
    """Function that is compiled at its first call."""

    def __init__(self, function: Callable[..., Any], fastmath: tuple[str, ...], apart: bool, inline: str | None):
        self.function = function
        self.fastmath = fastmath
        self.apart = apart
        self.inline = inline
        self.call: Callable[..., Any] = self._first_call
        update_wrapper(self, function)
        modules.setdefault(function.__module__, []).append(self)

    def __call__(self, *args: Any) -> Any:
        """Run the kernel."""
        return self.call(*args)

    @property
    def name(self) -> str:
        """The kernel's name within the package's kernels."""
        return f"{self.function.__module__.rpartition('.')[2]}.{self.function.__name__}"

    def _first_call(self, *args: Any) -> Any:
        with _making:
            entries = _entries_of(self)
            call = (lambda *others: self.dispatcher(*others)) if entries else self.dispatcher
            for entry in reversed(entries):  # one, nearly always; each is for its own types of arguments
                call = entry(call)
            self.call = call
        return self.call(*args)

    @property
    def dispatcher(self) -> Any:
        """Numba's compiled form of the function."""
        with _making:
            made = self.__dict__.get("_dispatcher")
            if made is None:
                _compile_by_numba(self.function.__module__)
                made = self.__dict__["_dispatcher"]
            return made


def _compile_by_numba(module: str) -> None:
    from numba import njit
    from numba.core.compiler import Compiler

    class Apart(Compiler):
        def define_pipelines(self) -> Any:
            self.state.flags.noalias = True
            return super().define_pipelines()  # type: ignore[no-untyped-call]

    namespace = dict(sys.modules[module].__dict__)
    for member in modules[module]:
        options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": set(member.fastmath)}
        options |= {"pipeline_class": Apart} if member.apart else {}
        how: dict[str | None, dict[str, Any]] = {"numba": {"inline": "always"}, "llvm": {"forceinline": True}}
        options |= how.get(member.inline, {"cache": True})
        given = member.function
        function = FunctionType(given.__code__, namespace, given.__name__, given.__defaults__)
        function.__module__, function.__qualname__ = module, given.__qualname__
        namespace[given.__name__] = member.__dict__["_dispatcher"] = njit(**options)(function)


def level_of(features: dict[str, bool]) -> str | None:
    """Find the best level that a processor with these features has."""
    return next((level for level, needs in LEVELS.items() if all(features.get(need) for need in needs)), None)


def _entries_of(member: Kernel) -> list[Callable[[Callable[..., Any]], Callable[..., Any]]]:
    code = _object_code()
    if code is None:
        return []
    facts, engine = code
    source = Path(member.function.__code__.co_filename)
    stem = member.name.partition(".")[0]
    try:
        if facts["sources"].get(stem) != hashlib.sha256(source.read_bytes()).hexdigest():
            return []
    except OSError:
        return []
    return [
        partial(_entry, engine.get_function_address(symbol), entry["arguments"], entry["returns"])
        for symbol, entry in facts["entries"].items()
        if entry["kernel"] == member.name
    ]


def _entry(address: int, arguments: list[str], returns: str, other: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap the address of a kernel's entry, which checks the types of arrays itself; others are for ``other``."""
    scalars = [SCALARS.get(kind) for kind in arguments]
    types: list[Any] = [ctypes.py_object, ctypes.c_void_p, *(kind or ctypes.py_object for kind in scalars)]
    function = ctypes.CFUNCTYPE(ctypes.c_int, *types)(address)
    whole = [place for place, kind in enumerate(arguments) if kind in ("int64", "uint64")]
    none = [place for place, kind in enumerate(arguments) if kind == "none"]
    n_arguments = len(arguments)
    result_type = SCALARS.get(returns)

    def run(*args: Any) -> Any:
        if len(args) != n_arguments or (none and any(args[place] is not None for place in none)):
            return other(*args)
        result = None if result_type is None else result_type()
        place = None if result is None else ctypes.addressof(result)
        try:
            status = function(np.ndarray, place, *args)
        except ctypes.ArgumentError:  # NumPy's whole numbers; nothing has been called yet
            given = list(args)
            try:
                for number in whole:
                    given[number] = index(given[number])
                status = function(np.ndarray, place, *given)
            except (TypeError, ctypes.ArgumentError):
                return other(*args)
        if status == OTHER_TYPES:
            return other(*args)
        if status == RAISED:
            raise ValueError("a kernel refused its arguments")
        return None if result is None else result.value

    return run


def _arrays_are_laid_out_as_known() -> bool:
    """Check that arrays have the memory layout of the entries."""
    if object.__basicsize__ != 16:  # as in free-threaded Python
        return False
    array = np.zeros((2, 3), dtype=np.float32)
    at = id(array)  # CPython's address

    def read(kind: Any, address: int) -> int:
        found: int = kind.from_address(address).value
        return found

    if read(ctypes.c_ssize_t, at + 8) != id(np.ndarray) or read(ctypes.c_ssize_t, at + 16) != array.ctypes.data:
        return False
    shape = [read(ctypes.c_ssize_t, read(ctypes.c_ssize_t, at + 32) + 8 * dim) for dim in range(2)]
    strides = [read(ctypes.c_ssize_t, read(ctypes.c_ssize_t, at + 40) + 8 * dim) for dim in range(2)]
    whole = 0x1 | 0x100 | 0x400  # in C's order, aligned, writeable
    return (
        (read(ctypes.c_int, at + 24), shape, strides) == (2, [2, 3], [12, 4])
        and read(ctypes.c_ssize_t, at + 56) == id(array.dtype)
        and read(ctypes.c_int, id(array.dtype) + 28) == array.dtype.num
        and read(ctypes.c_int, at + 64) & whole == whole
    )


@lru_cache(maxsize=1)
def _object_code() -> tuple[dict[str, Any], Any] | None:
    """Load the object code for this processor; None where there is none."""
    if (
        sys.platform != "linux"
        or platform.machine() != "x86_64"
        or any(os.environ.get(name) for name in OTHER_WISHES)
        or not _arrays_are_laid_out_as_known()
    ):
        return None
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    level = level_of(llvm.get_host_cpu_features())
    path = OBJECTS / f"linux-{level}.bin"
    if level is None or not path.is_file():
        return None
    header, _, packed = path.read_bytes().partition(b"\n")
    engine = llvm.create_mcjit_compiler(
        llvm.parse_assembly(""), llvm.Target.from_default_triple().create_target_machine(), use_lmm=True
    )
    engine.add_object_file(llvm.ObjectFileRef.from_data(zlib.decompress(packed)))
    engine.finalize_object()
    return json.loads(header), engine
