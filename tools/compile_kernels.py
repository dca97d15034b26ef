"""Make the object code of the kernels that ships with the package.

For every level of processors a process of its own runs examples of datasets, recordings and radars with Numba told to
compile for that level. The LLVM modules of all kernels that were called, for the types they were called with, are
linked into one, with an entry for each that takes Python's arrays and checks their types, and with the few functions of
Numba's run time that allocate memory. `doppelgait.core.kernels.compiled` loads the result.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
FEATURES = {"x86-64-v4": "-prefer-256-bit", "x86-64-v3": ""}
"""LLVM keeps to half of the widest vectors for fear of the clock of old processors; the signature then takes 1.3 times
as long, the synthesis 1.8 times."""
TRIPLE = "x86_64-unknown-linux-gnu"
ALLOWED = {"malloc", "free", "memcpy", "memset", "memmove", "abort"}
ALLOWED |= {
    "exp",
    "exp2",
    "log",
    "log2",
    "sin",
    "cos",
    "sincos",
    "pow",
    "hypot",
    "atan2",
    "acos",
    "asin",
    "fmod",
    "floor",
}
ALLOWED |= {
    "ceil",
    "sqrt",
    "expf",
    "logf",
    "sinf",
    "cosf",
    "sincosf",
    "powf",
    "log10",
    "rint",
    "atan",
    "tan",
    "ldexp",
    "sqrtf",
}

# Numba's blocks of memory begin with: references, destructor, its argument, data, size, external allocator.
RUN_TIME = """
declare ptr @malloc(i64)
declare void @free(ptr)
declare void @abort()

define ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align) {
  %spare = zext i32 %align to i64
  %head = add i64 %size, 48
  %total = add i64 %head, %spare
  %block = call ptr @malloc(i64 %total)
  %missing = icmp eq ptr %block, null
  br i1 %missing, label %none, label %some
none:
  ret ptr null
some:
  %address = ptrtoint ptr %block to i64
  %first = add i64 %address, 48
  %over = urem i64 %first, %spare
  %to_next = sub i64 %spare, %over
  %aligned = add i64 %first, %to_next
  %data = inttoptr i64 %aligned to ptr
  store i64 1, ptr %block
  %at1 = getelementptr i8, ptr %block, i64 8
  store ptr null, ptr %at1
  %at2 = getelementptr i8, ptr %block, i64 16
  store ptr null, ptr %at2
  %at3 = getelementptr i8, ptr %block, i64 24
  store ptr %data, ptr %at3
  %at4 = getelementptr i8, ptr %block, i64 32
  store i64 %size, ptr %at4
  %at5 = getelementptr i8, ptr %block, i64 40
  store ptr null, ptr %at5
  ret ptr %block
}

define ptr @NRT_MemInfo_alloc_safe_aligned(i64 %size, i32 %align) {
  %block = call ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align)
  ret ptr %block
}

define ptr @NRT_MemInfo_alloc_aligned_external(i64 %size, i32 %align, ptr %allocator) {
  %block = call ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align)
  ret ptr %block
}

define ptr @NRT_MemInfo_alloc_safe_aligned_external(i64 %size, i32 %align, ptr %allocator) {
  %block = call ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align)
  ret ptr %block
}

define void @NRT_MemInfo_call_dtor(ptr %block) {
  call void @free(ptr %block)
  ret void
}
"""


def run_examples() -> None:
    """Run what calls the kernels with the types that users' commands call them with."""
    import doppelgait as dg
    from doppelgait.dataset import load_plan, plan_dataset
    from doppelgait.dataset.shard import BuildContext, build_planned

    for name, overrides in (
        ("home-alarm", []), ("home-alarm", ["dataset.gate='track'"]), (str(ROOT / "examples/rooms-plan.toml"), []),
    ):  # fmt: skip
        config, folder = load_plan(name, overrides=["dataset.examples_per_class=12", *overrides])
        plan = plan_dataset(config, folder=folder)
        context = BuildContext(plan.config, str(plan.folder), ".")
        for entry in plan.examples:
            build_planned(entry, context)
    walk = dg.motion.human_gait(speed_mps=1.2, duration_s=3.0)
    scene = dg.Scene([dg.Target(walk, label="human")], duration_s=3.0)
    for preset in ("x4", "ancortek-24", "ti-60", "xband-cw"):
        recording = dg.simulate(scene, dg.Radar.preset(preset), rng=dg.rng(1), snr_db=15)
        dg.analyze(recording)
    impairments = [
        {"kind": "phase_noise", "density_dbc_per_hz": -90.0}, {"kind": "dropped_frames", "probability": 0.01},
        {"kind": "adc", "full_scale_v": 1.0}, {"kind": "x4_counts", "pulses_per_step": 6},
    ]  # fmt: skip
    conditions = dg.Conditions(impairments=impairments)
    dg.simulate(scene, dg.Radar.preset("x4"), rng=dg.rng(1), conditions=conditions)
    sweep = dg.Conditions(impairments=[{"kind": "iq_imbalance", "gain_db": 1.0}])  # looks at the samples of a sweep
    dg.simulate(scene, dg.Radar.preset("ti-60"), rng=dg.rng(1), conditions=sweep)
    chirp = {"waveform": "lfm", "sweep_s": 5e-7, "bandwidth_hz": 1.4e9, "bandwidth_level_db": 10}
    for options in (chirp, {"waveform": "rectangular", "sweep_s": 1e-9}):
        plain = dg.Radar.preset("x4").model_dump(
            include={"carrier_hz", "prf_hz", "sample_rate_hz", "decimation", "range_stop_m"}
        )
        dg.simulate(scene, dg.Radar(**{**plain, **options}), rng=dg.rng(1), snr_db=15)
    bodies = dg.Scene([dg.Target(walk, label="human", rcs={"kind": "ellipsoids", "occlusion": True})], duration_s=1.0)
    dg.simulate(bodies, dg.Radar.preset("x4"), rng=dg.rng(1), snr_db=15)


def type_of(argument: Any) -> dict[str, Any] | None:
    """Describe a Numba type; None for what an entry cannot take."""
    from numba import types

    if isinstance(argument, types.Array):
        dtype = np.dtype(str(argument.dtype))
        return {
            "number": dtype.num, "dims": argument.ndim, "layout": argument.layout, "mutable": argument.mutable,
        }  # fmt: skip
    return {"scalar": str(argument)} if str(argument) in ("int64", "uint64", "float64", "none") else None


def entry_code(symbol: str, native: str, arguments: list[dict[str, Any]], returns: str) -> str:
    """Write the entry of a kernel in LLVM's language."""
    scalar = {"int64": "i64", "uint64": "i64", "float64": "double"}
    given = [scalar.get(a.get("scalar", ""), "ptr") for a in arguments]
    result = scalar.get(returns, "ptr")
    lines, passed, types = [], [], []
    for number, (argument, kind) in enumerate(zip(arguments, given, strict=True)):
        if "scalar" in argument:
            passed.append(f"{kind} %a{number}")
            types.append(kind)
            continue
        n, dims = f"a{number}", argument["dims"]
        flags = 0x100 | {"C": 1, "F": 2, "A": 0}[argument["layout"]] | (0x400 if argument["mutable"] else 0)

        def load(name: str, kind: str, base: str, offset: int) -> None:
            lines.append(f"  %{name}.at = getelementptr i8, ptr %{base}, i64 {offset}")
            lines.append(f"  %{name} = load {kind}, ptr %{name}.at")

        def need(name: str, condition: str) -> None:
            lines.append(f"  %{name}.is = {condition}\n  br i1 %{name}.is, label %{name}.ok, label %other\n{name}.ok:")

        load(f"{n}.type", "ptr", n, 8)
        need(f"{n}.type", f"icmp eq ptr %{n}.type, %ndarray")
        load(f"{n}.nd", "i32", n, 24)
        need(f"{n}.nd", f"icmp eq i32 %{n}.nd, {dims}")
        load(f"{n}.flags", "i32", n, 64)
        lines.append(f"  %{n}.masked = and i32 %{n}.flags, {flags}")
        need(f"{n}.masked", f"icmp eq i32 %{n}.masked, {flags}")
        load(f"{n}.descr", "ptr", n, 56)
        load(f"{n}.num", "i32", f"{n}.descr", 28)
        need(f"{n}.num", f"icmp eq i32 %{n}.num, {argument['number']}")
        load(f"{n}.order", "i8", f"{n}.descr", 26)
        need(f"{n}.order", f"icmp ne i8 %{n}.order, {ord('>')}")
        load(f"{n}.data", "ptr", n, 16)
        load(f"{n}.dims", "ptr", n, 32)
        load(f"{n}.strides", "ptr", n, 40)
        count = "1"
        for d in range(dims):
            load(f"{n}.n{d}", "i64", f"{n}.dims", 8 * d)
            load(f"{n}.s{d}", "i64", f"{n}.strides", 8 * d)
            lines.append(f"  %{n}.c{d} = mul i64 {count}, %{n}.n{d}")
            count = f"%{n}.c{d}"
        passed += ["ptr null", "ptr null", f"i64 {count}", f"i64 {argument['itemsize']}", f"ptr %{n}.data"]
        passed += [f"i64 %{n}.n{d}" for d in range(dims)] + [f"i64 %{n}.s{d}" for d in range(dims)]
        types += ["ptr", "ptr", "i64", "i64", "ptr", *["i64"] * (2 * dims)]
    declared = f'declare i32 @"{native}"({", ".join(["ptr", "ptr", *types])})\n'
    heads = ", ".join(["ptr %ndarray", "ptr %place", *(f"{k} %a{i}" for i, k in enumerate(given))])
    store = "" if result == "ptr" else f"  %value = load {result}, ptr %result\n  store {result} %value, ptr %place\n"
    call = ", ".join(["ptr %result", "ptr %why", *passed])
    return declared + (
        f"define i32 @{symbol}({heads}) {{\n  %result = alloca {result}\n  %why = alloca ptr\n"
        "  br label %begin\nbegin:\n"
        + "\n".join(lines)
        + f'\n  %status = call i32 @"{native}"({call})\n  %fine0 = icmp eq i32 %status, 0\n'
        "  %fine1 = icmp eq i32 %status, -2\n  %fine = or i1 %fine0, %fine1\n"
        f"  br i1 %fine, label %done, label %raised\ndone:\n{store}  ret i32 0\nraised:\n  ret i32 1\n"
        "other:\n  ret i32 2\n}\n"
    )


def build(level: str, target: Path) -> None:
    """Compile for one level and write the file; the environment has told Numba the level."""
    import llvmlite.binding as llvm
    from numba import types

    from doppelgait.core.kernels import compiled

    run_examples()
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    module = llvm.parse_assembly(RUN_TIME)
    entries: dict[str, Any] = {}
    sources: dict[str, str] = {}
    for members in compiled.modules.values():
        for member in members:
            dispatcher = member.__dict__.get("_dispatcher")
            if dispatcher is None or member.inline or member.call is not dispatcher:
                continue
            path = Path(member.function.__code__.co_filename)
            sources[path.stem] = hashlib.sha256(path.read_bytes()).hexdigest()
            for signature, compiled_result in dispatcher.overloads.items():
                if any(isinstance(argument, types.Literal) for argument in signature):
                    continue  # called by another kernel
                arguments = [type_of(argument) for argument in signature]
                returns = str(compiled_result.signature.return_type)
                if None in arguments or returns not in ("none", "int64", "float64"):
                    print(f"{member.name}{signature} -> {returns}: left to Numba")
                    continue
                for argument, given in zip(arguments, signature, strict=True):
                    if "number" in argument:
                        argument["itemsize"] = np.dtype(str(given.dtype)).itemsize
                symbol = f"entry_{len(entries)}"
                entries[symbol] = {
                    "kernel": member.name, "returns": returns,
                    "arguments": [argument.get("scalar", "array") for argument in arguments],
                }  # fmt: skip
                module.link_in(llvm.parse_assembly(dispatcher.inspect_llvm(signature)))
                native = compiled_result.fndesc.llvm_func_name
                module.link_in(llvm.parse_assembly(entry_code(symbol, native, arguments, returns)))
    for member in (*module.functions, *module.global_variables):
        if not member.is_declaration and member.name not in entries:
            member.linkage = "internal"
    machine = llvm.Target.from_triple(TRIPLE).create_target_machine(
        cpu=level, features=FEATURES[level], opt=3, reloc="pic", codemodel="default"
    )
    module.triple, module.data_layout = TRIPLE, str(machine.target_data)
    options = llvm.create_pipeline_tuning_options(speed_level=1)
    options.loop_vectorization = options.slp_vectorization = False  # the kernels are optimised already
    builder = llvm.create_pass_builder(machine, options)
    manager = llvm.create_new_module_pass_manager()
    manager.add_global_dead_code_eliminate_pass()
    manager.run(module, builder)
    unknown = {f.name for f in module.functions if f.is_declaration and not f.name.startswith("llvm.")} - ALLOWED
    if unknown:
        sys.exit(f"object code would need {', '.join(sorted(unknown))}")
    code = machine.emit_object(module)
    header = json.dumps({"level": level, "sources": sources, "entries": entries}, sort_keys=True)
    target.write_bytes(header.encode() + b"\n" + zlib.compress(code, 9))
    print(f"{target.name}: {len(entries)} entries, {len(code)} bytes, {target.stat().st_size} packed")


def main() -> None:
    """Compile for every level, each in a process of its own."""
    if len(sys.argv) == 3:
        build(sys.argv[1], Path(sys.argv[2]))
        return
    objects = ROOT / "src/doppelgait/core/kernels/objects"
    objects.mkdir(exist_ok=True)
    for level, features in FEATURES.items():
        with tempfile.TemporaryDirectory() as cache:
            told = {"NUMBA_CPU_NAME": level, "NUMBA_CPU_FEATURES": features, "NUMBA_CACHE_DIR": cache}
            command = [sys.executable, __file__, level, str(objects / f"linux-{level}.bin")]
            subprocess.run(command, env={**os.environ, **told}, check=True)


if __name__ == "__main__":
    main()
