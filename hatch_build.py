"""Builds the native code (native/) into the package, for wheels and for editable installations.

Every version of Python needs a wheel of its own. Where no compiler is found, or one that is too old, the build asks for
``ziglang``, a compiler as a wheel.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

COMPILERS = ("c++", "g++", "clang++", "clang-cl")
PROBE = "typedef double V __attribute__((vector_size(16))); V f(V a) { return __builtin_shufflevector(a, a, 1, 2); }"
MISSING = (
    "doppelgait has native code and found no C++ compiler for it: install g++ 12 or clang (Debian: apt install g++, "
    "macOS: xcode-select --install, Windows: the C++ workload of Visual Studio with clang), or "
    "ziglang (pip install ziglang), or a wheel"
)


def find_compiler() -> str | None:
    """Return the C++ compiler of this machine, by ``CXX`` or by its usual names, if it is new enough."""
    stated = shlex.split(os.environ.get("CXX", ""))
    for command in [stated] if stated else [[path] for path in filter(None, map(shutil.which, COMPILERS))]:
        if os.name == "nt":  # its options have other names
            return command[0]
        line = [*command, "-std=c++17", "-fsyntax-only", "-x", "c++", "-"]
        with suppress(OSError):
            if subprocess.run(line, input=PROBE, text=True, capture_output=True, check=False).returncode == 0:
                return command[0]
    return None


def wrap_zig(folder: Path) -> list[str]:
    """Write programs that call Zig as compiler and archiver; return the options for CMake."""
    if find_spec("ziglang") is None:
        raise RuntimeError(MISSING)
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("c++", "ar", "ranlib"):
        path = folder / name
        path.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m ziglang {name} "$@"\n')
        path.chmod(0o755)
    names = {"CMAKE_CXX_COMPILER": "c++", "CMAKE_AR": "ar", "CMAKE_RANLIB": "ranlib"}
    return ["-DDOPPELGAIT_ZIG=ON", *(f"-D{key}={folder / name}" for key, name in names.items())]


def build_native(root: Path, *, build: Path, out: Path) -> None:
    """Build the modules of all processor levels into a folder."""
    if shutil.which("cmake") is None:
        raise RuntimeError("doppelgait has native code: install cmake (pip install cmake), or a wheel")
    options = [f"-DPython_EXECUTABLE={sys.executable}", f"-DDOPPELGAIT_OUTPUT={out}", "-DCMAKE_BUILD_TYPE=Release"]
    if find_compiler() is None:
        options += wrap_zig(build / "zig")
    if shutil.which("ninja"):
        options += ["-G", "Ninja"]
    (build / "CMakeCache.txt").unlink(missing_ok=True)  # it may name the Python of another environment
    for command in (["-S", root / "native", "-B", build, *options], ["--build", build, "--parallel"]):
        done = subprocess.run(["cmake", *map(str, command)], capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(f"the native code cannot be built:\n{(done.stdout + done.stderr)[-4000:]}")


class NativeBuild(BuildHookInterface[Any]):
    """Hook of hatchling: the built modules become part of the wheel."""

    def dependencies(self) -> list[str]:
        """Ask for what this machine lacks."""
        needed = [name for name in ("cmake", "ninja") if shutil.which(name) is None]
        if find_compiler() is not None:
            return needed
        if os.name == "nt":
            raise RuntimeError(MISSING)
        return [*needed, "ziglang"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build for this interpreter and name the wheel after it."""
        root = Path(self.root)
        build = root / "build" / f"native-{sys.implementation.cache_tag}-{sysconfig.get_platform()}"
        editable = version == "editable"
        out = root / "src" / "doppelgait" / "_core" if editable else build / "modules"
        build_native(root, build=build, out=out)
        build_data |= {"pure_python": False, "infer_tag": True}
        if not editable:
            build_data["force_include"] |= {str(path): f"doppelgait/_core/{path.name}" for path in out.glob("_level*")}
