"""Models as C99: one header and one source, without allocation."""

from __future__ import annotations

from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from doppelgait import __version__
from doppelgait.classify.export.device import Device, IntegerNetwork, count_work, list_parts
from doppelgait.classify.learned import Network
from doppelgait.classify.model import Model

TEXTS = Path(__file__).parent / "c99"
LINE = 112
TYPES = {"float": 4, "int8_t": 1, "int16_t": 2, "int32_t": 4, "int64_t": 8}
SAMPLES_TOLERANCE = {False: 1e-4, True: 2e-2}
"""Tolerances of probabilities in float32 and in int8. In int8 a level between two integers may be
rounded either way."""


class Sources:
    """Text of an export of a model of networks, with the size of its tables."""

    def __init__(self, model: Model, device: Device) -> None:
        self.model, self.device = model, device
        self.parts = list_parts(model)
        self.networks: list[Network] = [part[0] for part in self.parts]
        self.integers = any(isinstance(network, IntegerNetwork) for network in self.networks)
        weight, total = ("int8_t", "int32_t") if self.integers else ("float", "float")
        self.types = {"dg_weight": weight, "dg_activation": weight, "dg_sum": total}
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
        device = self.device
        ring, levels = device.bins * (2 * device.taper.size + 7), device.n_columns * device.patch.n_velocity
        sizes = {"window": 4 * (ring + device.n_doppler + levels + 4), "buffer": self._buffer_bytes(device)}
        sizes = {"flash_table": self.flash_bytes, "ram": sum(sizes.values()), **sizes}
        work = count_work(device, self.networks)
        return {f"{name}_bytes": size for name, size in sizes.items()} | {
            f"multiply_adds_{name}": round(value) for name, value in work.items()
        }

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
        found: dict[str, Any] = {
            "CLASSES": len(facts.classes),
            "NETWORKS": len(self.networks),
            "INT8": int(self.integers),
            "ABSTAIN_BELOW": _format_float(facts.abstain_below),
        }
        if facts.alarm is not None and facts.alarm_threshold is not None:
            found |= {
                "ALARM_CLASS": facts.classes.index(facts.alarm),
                "ALARM_THRESHOLD": f"{_format_float(facts.alarm_threshold)} /* of the whole model */",
            }
        even, odd = self._count_layer_values(device)
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
        for number, (network, share, slope, shift) in enumerate(self.parts):
            rows.append(self._add_network(network, f"m{number}", share, slope, shift))
        self._tables.append("static const dg_network networks[DG_NETWORKS] = {\n" + ",\n".join(rows) + "\n};")
        text = _format_float(self.model.calibration.slope)
        self._tables.append(f"static const float calibration_slope = {text};")
        self._add_array("calibration_shift", "float", self.model.calibration.shift)
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

    def _add_network(self, learned: Network, name: str, share: float, slope: float, moved: Any) -> str:
        """Add the tables of a network; return its row."""
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
        arrays = [f"{name}_layers", weight, *self._add_arrays(name, "float", scale=last[1], bias=learned.bias)]
        arrays += [_format_float(share), _format_float(slope), self._add_array(f"{name}_shift", "float", moved)]
        return f"    {{{', '.join(arrays)}}}"


def _format_float(value: float) -> str:
    text = str(np.float32(value))
    return f"{text}f" if "." in text or "e" in text else f"{text}.0f"


def _wrap(words: list[str]) -> str:
    text = "".join(f"{word}, " for word in words)
    lines = fill(text, LINE, initial_indent="    ", subsequent_indent="    ", break_on_hyphens=False)
    return lines.removesuffix(",")
