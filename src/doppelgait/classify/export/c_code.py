"""Models as C99: one header and one source, without allocation."""

from __future__ import annotations

from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from doppelgait import __version__
from doppelgait.classify.export.device import Device, IntegerNetwork, count_work, list_parts
from doppelgait.classify.export.onnx_graph import round_threshold
from doppelgait.classify.learned import Constant, Kernel, Linear, Network, Trees
from doppelgait.classify.model import Model

TEXTS = Path(__file__).parent / "c99"
LINE = 112
TYPES = {"float": 4, "int8_t": 1, "uint8_t": 1, "int16_t": 2, "uint16_t": 2, "int32_t": 4, "uint32_t": 4, "int64_t": 8}
SAMPLES_TOLERANCE = {False: 1e-4, True: 2e-2}
"""Tolerances of probabilities in float32 and in int8. In int8 a level between two integers may be rounded either
way."""


class Sources:
    """Text of an export, with the size of its tables."""

    def __init__(self, model: Model, device: Device | None) -> None:
        self.model, self.device = model, device
        self.parts = list_parts(model)
        self.networks = [part[0] for part in self.parts if isinstance(part[0], Network)]
        self.integers = any(isinstance(network, IntegerNetwork) for network in self.networks)
        most_nodes = max((part[0].feature.size for part in self.parts if isinstance(part[0], Trees)), default=0)
        weight, total = ("int8_t", "int32_t") if self.integers else ("float", "float")
        self.types = {
            "dg_weight": weight,
            "dg_activation": weight,
            "dg_sum": total,
            "dg_node": "uint16_t" if most_nodes < 2**16 else "uint32_t",
        }
        self.flash_bytes = 0
        self._tables: list[str] = []
        self.tables = self._make_tables()

    def header(self) -> str:
        """Return the text of the header."""
        macros = "\n".join(f"#define DG_{name} {value}" for name, value in self._collect_macros().items())
        about = f"/* {self.model.facts.name}, trained on {self.model.facts.dataset_name}; doppelgait {__version__} */"
        types = "\n".join(f"typedef {kind} {name};" for name, kind in self.types.items())
        engine = (TEXTS / "engine.h").read_text(encoding="utf-8")
        return engine.replace("/* @MACROS@ */", f"{about}\n{macros}\n\n{types}")

    def source(self) -> str:
        """Return the text of the source."""
        return (TEXTS / "engine.c").read_text(encoding="utf-8").replace("/* @TABLES@ */", self.tables)

    def facts(self) -> dict[str, Any]:
        """Return table flash and RAM in bytes, and work."""
        found: dict[str, Any] = {"flash_table_bytes": self.flash_bytes, "ram_bytes": 0}
        if (device := self.device) is not None:
            ring = device.bins * (2 * device.taper.size + 7)
            levels = device.n_columns * device.patch.n_velocity
            found["window_bytes"] = 4 * (ring + device.n_doppler + levels + 4)
            found["buffer_bytes"] = self._buffer_bytes(device)
            found["ram_bytes"] = found["window_bytes"] + found["buffer_bytes"]
            work = count_work(device, self.networks)
            found |= {f"multiply_adds_{name}": round(value) for name, value in work.items()}
        return found

    def _count_layer_values(self, device: Device) -> tuple[int, int]:
        cells = device.patch.n_velocity * device.patch.n_time
        layers = zip(*(network.biases for network in self.networks), strict=True)
        sizes = [cells, *(cells // 4**n * max(map(len, biases)) for n, biases in enumerate(layers, 1))]
        return max(sizes[0::2]), max(sizes[1::2])

    def _buffer_bytes(self, device: Device) -> int:
        layers = sum(self._count_layer_values(device)) * (1 if self.integers else 4)
        return layers + 4 * (4 * device.n_doppler + max(device.n_doppler, device.n_columns))

    def _collect_macros(self) -> dict[str, Any]:
        facts, device = self.model.facts, self.device
        learned = [part[0] for part in self.parts]
        told = [len(one.told) for one in learned if isinstance(one, Linear | Kernel)]
        found: dict[str, Any] = {
            "CLASSES": len(facts.classes),
            "FEATURES": len(facts.names),
            "MEMBERS": len(self.parts),
            "NETWORKS": len(self.networks),
            "HAS_COLUMNS": int(bool(told)),
            "MOST_TOLD": max(told, default=0) or 1,
            "HAS_TREES": int(any(isinstance(one, Trees) for one in learned)),
            "INT8": int(self.integers),
            "ABSTAIN_BELOW": _format_float(facts.abstain_below),
        }
        if facts.alarm is not None and facts.alarm_threshold is not None:
            found |= {
                "ALARM_CLASS": facts.classes.index(facts.alarm),
                "ALARM_THRESHOLD": f"{_format_float(facts.alarm_threshold)} /* of the whole model */",
            }
        if device is None:
            return found
        even, odd = self._count_layer_values(device)
        shares = sum(part[1] for part in self.parts if isinstance(part[0], Network))
        return found | {
            "PRF_HZ": _format_float(device.prf_hz),
            "WAVELENGTH_M": _format_float(device.wavelength_m),
            "EXPORTED_BINS": device.bins,
            "CPI": device.taper.size,
            "DOPPLER": device.n_doppler,
            "HOP": device.hop,
            "STFT_COLUMNS": device.n_stft,
            "WINDOW_PULSES": device.window_pulses,
            "COLUMNS_PER_CELL": repr(float(device.columns_per_cell)),
            "COLUMNS": device.n_columns,
            "VELOCITIES": device.patch.n_velocity,
            "TIMES": device.patch.n_time,
            "PICTURES": len(device.picture_starts),
            "STAGES": len(device.factors),
            "LAYERS": len(self.networks[0].kernels),
            "MOST_CHANNELS": max(len(bias) for network in self.networks for bias in network.biases),
            "EVEN_VALUES": even,
            "ODD_VALUES": odd,
            "BUFFER_BYTES": self._buffer_bytes(device),
            "RANGE_DB": _format_float(device.patch.range_db),
            "LOWEST_SHARE": _format_float(10.0 ** (-device.patch.range_db / 10.0)),
            "REMOVE_STILL": int(device.still_time_s is not None),
            "STILL_SHARE": _format_float(device.mean_weight),
            "NETWORK_SHARE": _format_float(1.0 / shares),
            "SAMPLES_TOLERANCE": _format_float(SAMPLES_TOLERANCE[self.integers]),
        }

    def _add_array(self, name: str, kind: str, values: Any) -> str:
        """Add a constant array and return its name."""
        flat = np.ravel(values)
        sized = self.types.get(kind, kind)
        self.flash_bytes += flat.size * TYPES[sized]
        words = [_format_float(each) if sized == "float" else str(int(each)) for each in flat.tolist()]
        self._tables.append(f"static const {kind} {name}[{flat.size}] = {{\n{_wrap(words)}\n}};")
        return name

    def _add_arrays(self, name: str, kind: str, **values: Any) -> list[str]:
        return [self._add_array(f"{name}_{key}", kind, each) for key, each in values.items()]

    def _make_tables(self) -> str:
        facts, device, rows = self.model.facts, self.device, []
        named = ", ".join(f'"{name}"' for name in facts.classes)
        self._tables.append(f"const char *const dg_class_names[DG_CLASSES] = {{{named}}};")
        if facts.names:
            words = _wrap([f'"{name}"' for name in facts.names])
            self._tables.append(f"const char *const dg_feature_names[DG_FEATURES] = {{\n{words}\n}};")
        for number, (learned, weight, slope, shift) in enumerate(self.parts):
            kind, model = self._add_member(learned, f"m{number}")
            moved = self._add_array(f"m{number}_shift", "float", shift)
            rows.append(f"    {{{kind}, {model}, {_format_float(weight)}, {_format_float(slope)}, {moved}}}")
        self._tables.append("static const dg_part parts[DG_MEMBERS] = {\n" + ",\n".join(rows) + "\n};")
        if facts.names or len(self.networks) == len(self.parts):
            text = _format_float(self.model.calibration.slope)
            self._tables.append(f"static const float calibration_slope = {text};")
            self._add_array("calibration_shift", "float", self.model.calibration.shift)
        if device is not None:
            self._add_array("taper", "float", device.taper)
            # store integer and fraction separately: the rounding of their sum would be visible next to a strong row
            self._add_array("edge_rows", "int16_t", np.floor(device.row_edges))
            self._add_array("edge_parts", "float", device.row_edges - np.floor(device.row_edges))
            self._add_array("picture_starts", "int16_t", device.picture_starts)
            self._add_array("factors", "int16_t", device.factors)
            turns = np.exp(2j * np.pi * np.arange(device.n_doppler) / device.n_doppler)
            pairs = _wrap([f"{{{_format_float(each.real)},~{_format_float(each.imag)}}}" for each in turns])
            self.flash_bytes += 8 * turns.size
            self._tables.append(f"static const float turns[DG_DOPPLER][2] = {{\n{pairs.replace('~', ' ')}\n}};")
        return "\n\n".join(self._tables)

    def _add_member(self, learned: Any, name: str) -> tuple[int, str]:
        """Add the tables of a trained model; return the number of its kind and its pointer."""
        match learned:
            case Constant():
                return 0, self._add_array(f"{name}_shares", "float", learned.log_share)
            case Linear() | Kernel():
                number, kind, values = 1, "dg_columns", self._add_columns(learned, name)
            case Trees():
                number, kind, values = 2, "dg_trees", self._add_trees(learned, name)
            case _:
                number, kind, values = 3, "dg_network", self._add_network(learned, name)
        self._tables.append(f"static const {kind} {name} = {{{', '.join(map(str, values))}}};")
        return number, f"&{name}"

    def _add_columns(self, learned: Linear | Kernel, name: str) -> list[Any]:
        floor = learned.floor if learned.floor.size else np.zeros(learned.median.size)
        told = self._add_array(f"{name}_told", "int16_t", learned.told) if learned.told.size else "0"
        standard = {"floor": floor, "median": learned.median, "mean": learned.mean, "scale": learned.scale}
        arrays = self._add_arrays(name, "float", **standard)
        support, count = "0", 0
        if isinstance(learned, Kernel):
            support, count = self._add_array(f"{name}_support", "float", learned.support), len(learned.support)
        scored = self._add_arrays(name, "float", weight=learned.weight, bias=learned.bias)
        return [*arrays, told, learned.told.size, support, *scored, count, learned.bias.size]

    def _add_trees(self, learned: Trees, name: str) -> list[Any]:
        inner = learned.feature >= 0
        value = np.where(inner, np.clip(round_threshold(learned.threshold), -3e38, 3e38), learned.value)
        arrays = [
            self._add_array(f"{name}_feature", "int16_t", learned.feature),
            self._add_array(f"{name}_value", "float", value),
            self._add_array(f"{name}_unknown_left", "uint8_t", learned.unknown_left),
            *self._add_arrays(name, "dg_node", left=learned.left, right=learned.right, root=learned.root),
        ]
        return [*arrays, *learned.root.shape, self._add_array(f"{name}_start", "float", learned.start)]

    def _add_network(self, learned: Network, name: str) -> list[Any]:
        size = learned.patch.n_velocity * learned.patch.n_time / 4 ** len(learned.kernels)
        last: tuple[Any, Any] = (learned.weight, np.full(learned.bias.size, 1.0 / size))
        layers: Any = zip(learned.kernels, learned.scales, learned.biases, strict=True)
        kinds = {"scale": "float", "bias": "float"}
        if isinstance(learned, IntegerNetwork):
            layers, last = learned.layers, (learned.last_weight, learned.last_scale)
            kinds = {"multiplier": "int32_t", "offset": "int64_t"}
        rows = []
        for n, (kernel, first, second, *shift) in enumerate(layers):
            scales = zip(kinds.items(), (first, second), strict=True)
            others = [self._add_array(f"{name}_{key}{n}", kind, values) for (key, kind), values in scales]
            weights = self._add_array(f"{name}_kernel{n}", "dg_weight", kernel.transpose(0, 2, 3, 1))
            rows.append(f"    {{{', '.join(map(str, [weights, *others, *shift, kernel.shape[1], kernel.shape[0]]))}}}")
        self._tables.append(f"static const dg_layer {name}_layers[DG_LAYERS] = {{\n" + ",\n".join(rows) + "\n};")
        weight = self._add_array(f"{name}_weight", "dg_weight", last[0])
        return [f"{name}_layers", weight, *self._add_arrays(name, "float", scale=last[1], bias=learned.bias)]


def _format_float(value: float) -> str:
    text = str(np.float32(value))
    return f"{text}f" if "." in text or "e" in text else f"{text}.0f"


def _wrap(words: list[str]) -> str:
    text = "".join(f"{word}, " for word in words)
    lines = fill(text, LINE, initial_indent="    ", subsequent_indent="    ", break_on_hyphens=False)
    return lines.removesuffix(",")
