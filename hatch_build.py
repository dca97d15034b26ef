"""Builds the native code (native/) into the package, for wheels and for editable installations.

A wheel for Python 3.12 and later serves all of them; Python 3.11 and free-threaded Python need one each. Where no
compiler is found, the build asks for ``ziglang``, a compiler as a wheel.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

COMPILERS = ("c++", "g++", "clang++", "clang-cl", "cl")
MISSING = (
    "doppelgait has native code and found no C++ compiler: install g++ or clang (Debian: apt install g++, "
    "macOS: xcode-select --install, Windows: the C++ workload of Visual Studio with clang), or install a wheel"
)


def find_compiler() -> str | None:
    """Return the C++ compiler of this machine, by ``CXX`` or by its usual names."""
    return os.environ.get("CXX") or next(filter(None, map(shutil.which, COMPILERS)), None)


def wrap_zig(folder: Path) -> list[str]:
    """Write programs that call Zig as compiler and archiver; return the options for CMake."""
    if os.name == "nt":
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
        return needed + (["ziglang"] if find_compiler() is None else [])

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
