"""Contract checks of waveforms, impairments, radar readers and radar writers."""

from __future__ import annotations

import inspect
import math
import os
import shutil
import warnings
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from doppelgait.core.plugins import read_head
from doppelgait.testing.contracts import require, require_close, require_registered

if TYPE_CHECKING:
    import xarray as xr

    from doppelgait.core.config import FrozenModel
    from doppelgait.radar.parameters import Radar
    from doppelgait.radar.recording import Recording


def check_waveform(kind: str, radar: Radar) -> None:
    """Check the contract of a waveform, :class:`doppelgait.radar.Waveform`.

    ``radar`` has this waveform, and two or more wavelengths in its frame, in which an echo fits.
    An ``AssertionError`` names the broken rule: registration, round trip through JSON, shapes and
    types, superposition, phases, amplitude and phase of an echo in the middle of a bin, half-power
    width, noise gain.

    >>> import doppelgait as dg
    >>> dg.testing.check_waveform("fmcw", dg.Radar.preset("ti-77"))
    """
    from doppelgait.radar.parameters import WAVEFORMS, Radar

    name = require_registered(WAVEFORMS, "waveform", kind)
    require(isinstance(radar.waveform, WAVEFORMS[kind].run), f"{name}: the radar has waveform {radar.waveform.kind!r}")
    plain = radar.model_dump(mode="json")
    require(Radar.model_validate(plain) == radar, f"{name}: the radar is another one after JSON")
    waveform = radar.waveform
    for label in ("n_samples", "n_range_bins"):
        count = getattr(waveform, label)(radar)
        require(isinstance(count, int) and count >= 1, f"{name}: {label} is {count!r}, not an integer of 1 or more")
    for label in ("bin_spacing_m", "resolution_m", "noise_bandwidth_hz", "noise_gain", "unambiguous_range_m"):
        value = getattr(waveform, label)(radar)
        require(value > 0, f"{name}: {label} is {value!r}, not positive")
    require(0 < waveform.independent_bins(radar) <= 1, f"{name}: independent_bins is not in 0 to 1")
    require(math.isfinite(waveform.coupling_s(radar)), f"{name}: coupling_s is not finite")
    require(all(isinstance(key, str) for key in waveform.figures(radar)), f"{name}: figures are not named")
    axis_m = radar.range_axis_m()
    require(axis_m.shape == (radar.n_range_bins,) and np.isfinite(axis_m).all(), f"{name}: range axis {axis_m.shape}")
    inside = (axis_m >= radar.range_start_m - 1e-9) & (axis_m <= radar.range_stop_m + 1e-9)
    require(inside.all(), f"{name}: range bins lie outside the frame")
    _check_synthesis(name, radar)
    _check_point_echo(name, radar)
    # The noise gain, with white noise.
    rng = np.random.default_rng(2)
    shape = (max(200, 40_000 // radar.n_range_bins), waveform.n_samples(radar))
    noise = (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)).astype(np.complex64)
    gain = float((np.abs(waveform.compress(noise, radar)) ** 2).mean()) / 2.0
    wanted = waveform.noise_gain(radar)
    require(abs(gain - wanted) < 0.1 * wanted, f"{name}: noise_gain is {wanted:.4g}, measured {gain:.4g}")


def _make_scatterer_table(radar: Radar, range_m: npt.NDArray[np.float64], **values: Any) -> xr.Dataset:
    import xarray as xr

    columns = {"range": range_m, "rcs": 1.0, "path_gain": 1.0, "radial_velocity": 0.0, **values}
    times_s = np.arange(range_m.shape[0]) / radar.prf_hz
    dims = ("slow_time", "scatterer")
    full = {key: (dims, np.broadcast_to(value, range_m.shape).copy()) for key, value in columns.items()}
    return xr.Dataset(full, coords={"slow_time": times_s})


def _check_synthesis(name: str, radar: Radar) -> None:
    """Check shapes, types, linearity, phases and independence of the frames."""
    rng = np.random.default_rng(1)
    waveform = radar.waveform
    near_m, far_m = radar.range_start_m, radar.range_stop_m
    range_m = near_m + (far_m - near_m) * rng.uniform(0.3, 0.7, (5, 3)) + 0.3
    velocity_mps = rng.uniform(-0.3, 0.3, range_m.shape) * radar.unambiguous_velocity_mps
    rcs_m2 = rng.uniform(0.5, 2.0, range_m.shape)
    columns = {"rcs": rcs_m2, "radial_velocity": velocity_mps}
    table = _make_scatterer_table(radar, range_m, **columns)
    before = table.copy(deep=True)
    samples = waveform.synthesise(table, radar)
    require(table.identical(before), f"{name}: synthesise changes the scatterer table")
    shape = (5, waveform.n_samples(radar))
    require(samples.shape == shape, f"{name}: synthesise gives the shape {samples.shape}, not {shape}")
    require(samples.dtype == np.complex64, f"{name}: synthesise gives {samples.dtype}, not complex64")
    require(np.isfinite(samples).all(), f"{name}: samples are not finite")
    require(np.abs(samples).max() > 0, f"{name}: scatterers inside the frame give no signal")
    again = waveform.synthesise(table, radar)
    require(np.array_equal(samples, again), f"{name}: the same scatterers give other samples")

    parts = [waveform.synthesise(table.isel(scatterer=[one]), radar) for one in range(3)]
    require_close(sum(parts), samples, f"{name}: echoes do not add up")
    require_close(
        waveform.synthesise(table.isel(slow_time=[3]), radar), samples[3:4], f"{name}: frames depend on others"
    )
    louder = waveform.synthesise(_make_scatterer_table(radar, range_m, **{**columns, "rcs": 4.0 * rcs_m2}), radar)
    require_close(louder, 2.0 * samples, f"{name}: four times the cross section is not twice the amplitude")
    silent = waveform.synthesise(table.isel(scatterer=[]), radar)
    require(silent.shape == shape and not silent.any(), f"{name}: no scatterers do not give zeros of shape {shape}")

    own = samples.copy()
    bins = waveform.compress(samples, radar)
    require(np.array_equal(samples, own), f"{name}: compress changes the samples")
    require(bins.shape == (5, radar.n_range_bins), f"{name}: compress gives the shape {bins.shape}")
    require(bins.dtype == np.complex64, f"{name}: compress gives {bins.dtype}, not complex64")
    require_close(waveform.compress(np.complex64(2j) * samples, radar), 2j * bins, f"{name}: compress is not linear")
    turned_radar = radar.model_copy(update={"transmit_phase_rad": radar.transmit_phase_rad + 0.7})
    turned = waveform.compress(waveform.synthesise(table, turned_radar), turned_radar)
    require_close(turned, bins * np.exp(0.7j), f"{name}: transmit_phase_rad does not turn the echoes", 1e-3)
    extra = _make_scatterer_table(radar, range_m, **columns, path_phase=0.7)
    turned = waveform.compress(waveform.synthesise(extra, radar), radar)
    require_close(turned, bins * np.exp(0.7j), f"{name}: path_phase does not turn the echoes", 1e-3)


def _check_point_echo(name: str, radar: Radar) -> None:
    """Check amplitude, phase and half-power width of a point echo."""
    from doppelgait.radar.link import echo_amplitude_v

    waveform, axis_m = radar.waveform, radar.range_axis_m()
    place = len(axis_m) // 2
    middle_m = float(axis_m[place])

    def response(range_m: npt.NDArray[np.float64]) -> Any:
        bins = waveform.compress(waveform.synthesise(_make_scatterer_table(radar, range_m[:, None]), radar), radar)
        return bins[:, place] / echo_amplitude_v(radar, range_m=range_m, rcs_m2=1.0)

    echo = complex(response(np.array([middle_m]))[0])
    phase_rad = radar.transmit_phase_rad - 4.0 * math.pi * math.fmod(middle_m, radar.wavelength_m) / radar.wavelength_m
    require(abs(abs(echo) - 1.0) < 0.02, f"{name}: an echo in its bin's middle has amplitude {abs(echo):.3f}")
    wrong_rad = float(np.angle(echo * np.exp(-1j * phase_rad)))
    require(abs(wrong_rad) < 0.05, f"{name}: an echo's phase is off theta - 4 pi R / lambda by {wrong_rad:.3f} rad")
    if not waveform.ranged:
        return
    width_m = waveform.resolution_m(radar)
    offsets_m = np.linspace(-1.5, 1.5, 601) * width_m
    keep = (middle_m + offsets_m > 0.3) & (middle_m + offsets_m < radar.range_stop_m)
    power = np.abs(response(middle_m + offsets_m[keep])) ** 2
    measured_m = float((power > 0.5).mean() * np.ptp(offsets_m[keep]))
    text = f"{name}: resolution_m is {width_m:.4g} m, but an echo is {measured_m:.4g} m wide at half power"
    require(abs(measured_m - width_m) < 0.1 * width_m, text)


def check_impairment(parameters: FrozenModel, radar: Radar, *, n_pulses: int = 64, seed: int = 0) -> None:
    """Check the contract of an impairment, :class:`doppelgait.radar.impairments.Apply`.

    ``radar`` supports the impairment; ``seed`` is that of its samples and random numbers. An
    ``AssertionError`` names the broken rule: registration, round trip through JSON, shape, finite
    values, the same result for the same random numbers and in both layouts of the samples, an
    input that stays unchanged unless its memory is released, pulse times that rise.

    >>> import doppelgait as dg
    >>> from doppelgait.radar.impairments import DcLeak
    >>> dg.testing.check_impairment(DcLeak(), dg.Radar.preset("x4"))
    """
    from doppelgait.core.errors import DoppelgaitWarning
    from doppelgait.core.samples import Samples
    from doppelgait.radar.impairments import IMPAIRMENTS, apply_impairments, shift_pulse_times

    kind = getattr(parameters, "kind", None)
    name = require_registered(IMPAIRMENTS, "impairment", kind)
    model = IMPAIRMENTS[str(kind)].parameters
    require(model is not None and isinstance(parameters, model), f"{name} takes {model}, not {type(parameters)}")
    again = IMPAIRMENTS.parse(parameters.model_dump(mode="json"))
    require(again == parameters, f"{name}: the parameters are others after JSON")

    generator = np.random.default_rng([seed, 1])
    shape = (n_pulses, radar.waveform.n_samples(radar))
    matrix = (generator.standard_normal(shape) + 1j * generator.standard_normal(shape)).astype(np.complex64)
    planes = np.ascontiguousarray(np.stack([matrix.real.T, matrix.imag.T]))

    def run(samples: Samples) -> npt.NDArray[np.complex64]:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DoppelgaitWarning)
            return apply_impairments(samples, [parameters], radar=radar, rng=np.random.default_rng(seed)).matrix

    kept = matrix.copy()
    found = run(Samples(matrix))
    require(np.array_equal(matrix, kept), f"{name} changes samples that are not its own: use samples = samples + ...")
    require(np.isfinite(found).all(), f"{name} makes values that are not finite")
    same = run(Samples(matrix))
    require(np.array_equal(found, same), f"{name} is another one for the same rng: take all random numbers from rng")
    other = run(Samples.from_planes(planes, n_pulses))
    require_close(other, found, f"{name} differs between the two layouts of the samples", rtol=1e-5)
    nominal_s = np.arange(n_pulses) / radar.prf_hz
    times_s = shift_pulse_times(nominal_s, [parameters], radar=radar, rng=np.random.default_rng(seed))
    require(times_s.shape == nominal_s.shape and (np.diff(times_s) >= 0).all(), f"{name}: pulse times do not rise")


def check_radar_reader(name: str, path: str | Path, **options: Any) -> None:
    """Check that a reader of radar recordings keeps its contract.

    ``path`` is a valid file or folder, alone in its parent folder: the check makes damaged copies
    of that folder. An ``AssertionError`` names the broken rule: registration, recognition of this
    and of no other file, keyword-only options, axes and values, the same result each time, a
    ``RecordingError`` at every damaged or missing file.

    >>> import doppelgait as dg
    >>> from pathlib import Path
    >>> Path("walks").mkdir()
    >>> recording = dg.data.sample()
    >>> dg.radar.write_recording(recording, "walks/walk.h5")
    >>> dg.testing.check_radar_reader("doppelgait", "walks/walk.h5")
    """
    from doppelgait.core.errors import RecordingError
    from doppelgait.core.readers import find_readers
    from doppelgait.radar.readers import RADAR_READERS, read_recording
    from doppelgait.radar.recording import Recording

    place, what = Path(path).absolute(), require_registered(RADAR_READERS, "radar reader", name)
    reader = RADAR_READERS[name]
    parameters = list(inspect.signature(reader.run).parameters.values())[1:]
    positional = [one.name for one in parameters if one.kind is not inspect.Parameter.KEYWORD_ONLY]
    require(not positional, f"{what}: options {positional} are not keyword-only")
    takers = find_readers(RADAR_READERS, place)
    require(takers == [name], f"{what}: {place.name} is recognised by {takers or 'no reader'}")
    with TemporaryDirectory() as folder:
        others = {"empty": b"", "text": b"not a recording\n" * 9, "zeros": bytes(4096)}
        for other, content in others.items():
            (Path(folder) / other).write_bytes(content)
        for other in (*others, "absent", "."):
            require(not _is_recognised(reader, Path(folder) / other), f"{what}: recognises a file that is not its own")

    recording = read_recording(place, **options)
    require(isinstance(recording, Recording), f"{what} returns {type(recording).__name__}, not a Recording")
    values = recording.baseband.values
    require(values.dtype == np.complex64 and values.ndim == 2, f"{what}: baseband is {values.dtype}, {values.shape}")
    require(np.isfinite(values).all(), f"{what}: the baseband is not finite")
    for axis_name, axis in (("slow time", recording.slow_time_s), ("range", recording.range_m)):
        require((np.diff(axis) > 0).all(), f"{what}: {axis_name} does not rise")
    again = read_recording(place, **options)
    require(again.baseband.identical(recording.baseband), f"{what}: the same file gives another recording")

    for damage in ("absent", "empty", "half", "noise"):
        with TemporaryDirectory() as folder:
            copy = Path(folder) / place.parent.name
            shutil.copytree(place.parent, copy)
            largest = max((one for one in copy.rglob("*") if one.is_file()), key=lambda one: one.stat().st_size)
            content = largest.read_bytes()
            if damage == "absent":
                largest.unlink()
            elif damage == "noise":
                rng, noisy = np.random.default_rng(len(content)), bytearray(content)
                for position in rng.integers(0, len(content), 1 + len(content) // 100):
                    noisy[position] = int(rng.integers(256))
                largest.write_bytes(noisy)
            else:
                largest.write_bytes(content[: len(content) // 2 if damage == "half" else 0])
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    reader.run(copy / place.name, **options)
            except (RecordingError, OSError):
                continue
            except Exception as error:
                raise AssertionError(
                    f"{what}: a damaged file ({damage}) raises {error!r}, not a RecordingError"
                ) from error
            require(damage in ("half", "noise"), f"{what}: an {damage} file raises nothing")


def _is_recognised(reader: Any, path: Path) -> bool:
    try:
        return bool(reader.facts["sniff"](path, read_head(path)))
    except OSError:
        return False
    except Exception as error:
        raise AssertionError(f"radar reader {reader.name!r}: sniff raises {error!r} at {path.name!r}") from error


def check_radar_writer(name: str, recording: Recording, *, rtol: float = 1e-6, **options: Any) -> None:
    """Check that a writer of radar recordings keeps its contract.

    ``recording`` is one that the format can store, with its seed, notes and further facts. Read
    again, its baseband differs by at most ``rtol`` of its largest value. An ``AssertionError``
    names the broken rule: registration, one ending, a recording that is read back, the same bytes
    each time, an ``OutputError`` and no file where it cannot write.

    >>> import doppelgait as dg
    >>> recording = dg.data.sample()
    >>> dg.testing.check_radar_writer("sigmf", recording)
    """
    from doppelgait.core.errors import OutputError
    from doppelgait.radar.readers import RADAR_WRITERS, read_recording

    what = require_registered(RADAR_WRITERS, "radar writer", name)
    writer = RADAR_WRITERS[name]
    suffix = writer.facts.get("suffix")
    require(isinstance(suffix, str), f"{what} names no suffix")
    taken = [one.name for one in RADAR_WRITERS.values() if one.facts.get("suffix") == suffix]
    require(taken == [name], f"{what}: the suffix {suffix!r} is taken by {taken}")
    before = recording.baseband
    with TemporaryDirectory() as folder:
        trees = []
        for part in ("first", "second"):
            (Path(folder) / part).mkdir()
            made = writer.run(recording, Path(folder) / part / f"walk{suffix}", **options)
            files = sorted(one for one in (Path(folder) / part).rglob("*") if one.is_file())
            trees.append({str(one.relative_to(Path(folder) / part)): one.read_bytes() for one in files})
        require(trees[0], f"{what} makes no file")
        require(trees[0] == trees[1], f"{what}: the same recording gives other bytes")
        again = read_recording(made if made is not None else Path(folder) / part / f"walk{suffix}")
        require(again.baseband.shape == before.shape, f"{what}: read again it has the shape {again.baseband.shape}")
        require_close(again.baseband.values, before.values, f"{what}: read again the baseband differs", rtol)
        step_m = float(np.diff(recording.range_m).min(initial=1.0))
        far_m = float(np.abs(again.range_m - recording.range_m).max())
        require(far_m < 1e-3 * step_m, f"{what}: read again the range axis differs by {far_m:.2g} m")
        late_s = float(np.abs(np.diff(again.slow_time_s) - np.diff(recording.slow_time_s)).max())
        require(late_s * recording.radar.prf_hz < 1e-3, f"{what}: read again the slow time differs by {late_s:.2g} s")
        own_hz, read_hz = recording.radar.carrier_hz, again.radar.carrier_hz
        require(abs(read_hz - own_hz) < 1e-6 * own_hz, f"{what}: read again the carrier is {read_hz:g} Hz")

    with TemporaryDirectory() as folder:
        (Path(folder) / "file").write_bytes(b"")
        try:
            writer.run(recording, Path(folder) / "file" / f"walk{suffix}", **options)
        except OutputError:
            pass
        except Exception as error:
            raise AssertionError(f"{what}: an unwritable path raises {error!r}, not an OutputError") from error
        else:
            raise AssertionError(f"{what}: an unwritable path raises nothing")
        require(sorted(os.listdir(folder)) == ["file"], f"{what}: leaves files where it cannot write")
