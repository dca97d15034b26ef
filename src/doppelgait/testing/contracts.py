"""Contract checks of plug-ins: what the rest of doppelgait takes for granted.

Each check raises an ``AssertionError`` that names the plug-in and the broken rule. Call it in a test of the plug-in.
"""

from __future__ import annotations

import inspect
import math
import os
import shutil
import warnings
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    import xarray as xr

    from doppelgait.core.config import FrozenModel
    from doppelgait.dataset import Dataset
    from doppelgait.radar.parameters import Radar
    from doppelgait.radar.recording import Recording


def require(condition: Any, text: str) -> None:
    """Raise an ``AssertionError`` with ``text`` unless the condition holds."""
    if not condition:
        raise AssertionError(text)


def check_waveform(kind: str, radar: Radar) -> None:
    """Check that a waveform keeps the contract of :class:`doppelgait.radar.Waveform`.

    Parameters
    ----------
    kind : str
        Its name in the group of waveforms.
    radar : Radar
        A radar of this waveform with two or more wavelengths in its frame, in which an echo fits.

    Raises
    ------
    AssertionError
        If a rule is broken: registration, round trip through JSON, shapes and types, superposition, phases, amplitude
        and phase of an echo in the middle of a bin, half-power width, noise gain.

    Examples
    --------
    >>> import doppelgait as dg
    >>> dg.testing.check_waveform("fmcw", dg.Radar.preset("ti-77"))
    """
    from doppelgait.radar.parameters import WAVEFORMS, Radar

    name = f"waveform {kind!r}"
    require(kind in WAVEFORMS, f"{name} is not registered; known are {', '.join(WAVEFORMS)}")
    require(isinstance(radar.waveform, WAVEFORMS[kind].run), f"{name}: the radar has waveform {radar.waveform.kind!r}")
    plain = radar.model_dump(mode="json")
    require(Radar.model_validate(plain) == radar, f"{name}: the radar is another one after JSON")
    _check_waveform_numbers(name, radar)
    _check_synthesis(name, radar)
    _check_point_echo(name, radar)
    _check_noise_gain(name, radar)


def _check_waveform_numbers(name: str, radar: Radar) -> None:
    """Counts, lengths and ratios that every caller divides by or loops over."""
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


def _scatterer_table(radar: Radar, range_m: npt.NDArray[np.float64], **values: Any) -> xr.Dataset:
    import xarray as xr

    columns = {"range": range_m, "rcs": 1.0, "path_gain": 1.0, "radial_velocity": 0.0, **values}
    times_s = np.arange(range_m.shape[0]) / radar.prf_hz
    dims = ("slow_time", "scatterer")
    full = {key: (dims, np.broadcast_to(value, range_m.shape).copy()) for key, value in columns.items()}
    return xr.Dataset(full, coords={"slow_time": times_s})


def _check_close(actual: Any, wanted: Any, text: str, rtol: float = 1e-4) -> None:
    scale = float(np.abs(wanted).max(initial=0.0)) or 1.0
    worst = float(np.abs(np.asarray(actual) - np.asarray(wanted)).max(initial=0.0)) / scale
    require(worst <= rtol, f"{text} (differs by {worst:.2g} of the largest value)")


def _check_synthesis(name: str, radar: Radar) -> None:
    """Shapes, types, linearity, phases, independence of the frames."""
    rng = np.random.default_rng(1)
    waveform = radar.waveform
    near_m, far_m = radar.range_start_m, radar.range_stop_m
    range_m = near_m + (far_m - near_m) * rng.uniform(0.3, 0.7, (5, 3)) + 0.3
    velocity_mps = rng.uniform(-0.3, 0.3, range_m.shape) * radar.unambiguous_velocity_mps
    rcs_m2 = rng.uniform(0.5, 2.0, range_m.shape)
    columns = {"rcs": rcs_m2, "radial_velocity": velocity_mps}
    table = _scatterer_table(radar, range_m, **columns)
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
    _check_close(sum(parts), samples, f"{name}: echoes do not add up")
    _check_close(
        waveform.synthesise(table.isel(slow_time=[3]), radar), samples[3:4], f"{name}: frames depend on others"
    )
    louder = waveform.synthesise(_scatterer_table(radar, range_m, **{**columns, "rcs": 4.0 * rcs_m2}), radar)
    _check_close(louder, 2.0 * samples, f"{name}: four times the cross section is not twice the amplitude")
    silent = waveform.synthesise(table.isel(scatterer=[]), radar)
    require(silent.shape == shape and not silent.any(), f"{name}: no scatterers do not give zeros of shape {shape}")

    own = samples.copy()
    bins = waveform.compress(samples, radar)
    require(np.array_equal(samples, own), f"{name}: compress changes the samples")
    require(bins.shape == (5, radar.n_range_bins), f"{name}: compress gives the shape {bins.shape}")
    require(bins.dtype == np.complex64, f"{name}: compress gives {bins.dtype}, not complex64")
    _check_close(waveform.compress(np.complex64(2j) * samples, radar), 2j * bins, f"{name}: compress is not linear")
    turned_radar = radar.model_copy(update={"transmit_phase_rad": radar.transmit_phase_rad + 0.7})
    turned = waveform.compress(waveform.synthesise(table, turned_radar), turned_radar)
    _check_close(turned, bins * np.exp(0.7j), f"{name}: transmit_phase_rad does not turn the echoes", 1e-3)
    extra = _scatterer_table(radar, range_m, **columns, path_phase=0.7)
    turned = waveform.compress(waveform.synthesise(extra, radar), radar)
    _check_close(turned, bins * np.exp(0.7j), f"{name}: path_phase does not turn the echoes", 1e-3)


def _check_point_echo(name: str, radar: Radar) -> None:
    """Amplitude and phase of an echo in the middle of a bin, and the half-power width of one."""
    from doppelgait.radar.link import echo_amplitude_v

    waveform, axis_m = radar.waveform, radar.range_axis_m()
    place = len(axis_m) // 2
    middle_m = float(axis_m[place])

    def response(range_m: npt.NDArray[np.float64]) -> Any:
        bins = waveform.compress(waveform.synthesise(_scatterer_table(radar, range_m[:, None]), radar), radar)
        return bins[:, place] / echo_amplitude_v(radar, range_m=range_m, rcs_m2=1.0)

    echo = complex(response(np.array([middle_m]))[0])
    phase_rad = radar.transmit_phase_rad - 4.0 * math.pi * math.fmod(middle_m, radar.wavelength_m) / radar.wavelength_m
    require(
        abs(abs(echo) - 1.0) < 0.02, f"{name}: an echo in the middle of its bin has {abs(echo):.3f} of its amplitude"
    )
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


def _check_noise_gain(name: str, radar: Radar) -> None:
    """White noise of mean square 2 in the samples has 2 noise_gain in the bins."""
    rng = np.random.default_rng(2)
    waveform = radar.waveform
    shape = (max(200, 40_000 // radar.n_range_bins), waveform.n_samples(radar))
    noise = (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)).astype(np.complex64)
    gain = float((np.abs(waveform.compress(noise, radar)) ** 2).mean()) / 2.0
    wanted = waveform.noise_gain(radar)
    require(abs(gain - wanted) < 0.1 * wanted, f"{name}: noise_gain is {wanted:.4g}, measured {gain:.4g}")


def check_radar_reader(name: str, path: str | Path, **options: Any) -> None:
    """Check that a reader of radar recordings keeps its contract.

    Parameters
    ----------
    name : str
        Its name in the group of readers.
    path : path-like
        A good file, or folder, of its format, which lies alone in its folder: damaged copies of that folder are made.
    **options
        Options that reading it needs.

    Raises
    ------
    AssertionError
        If a rule is broken: registration, recognition of this and of no other file, keyword-only options, axes and
        values, the same result each time, a ``RecordingError`` at every damaged or missing file.
    """
    from doppelgait.core.errors import RecordingError
    from doppelgait.radar.readers import RADAR_READERS, read_recording
    from doppelgait.radar.recording import Recording

    place, what = Path(path), f"radar reader {name!r}"
    require(name in RADAR_READERS, f"{what} is not registered; known are {', '.join(RADAR_READERS)}")
    reader = RADAR_READERS[name]
    sniff, suffixes = reader.facts.get("sniff"), reader.facts.get("suffixes")
    require(callable(sniff), f"{what} has no function sniff")
    require(isinstance(suffixes, tuple) and suffixes, f"{what} names no suffixes")
    parameters = list(inspect.signature(reader.run).parameters.values())[1:]
    positional = [one.name for one in parameters if one.kind is not inspect.Parameter.KEYWORD_ONLY]
    require(not positional, f"{what}: options {positional} are not keyword-only")
    takers = [one.name for one in RADAR_READERS.values() if _recognises(one, place)]
    require(takers == [name], f"{what}: {place.name} is recognised by {takers or 'no reader'}")
    with TemporaryDirectory() as folder:
        others = {"empty": b"", "text": b"not a recording\n" * 9, "zeros": bytes(4096)}
        for other, content in others.items():
            (Path(folder) / other).write_bytes(content)
        for other in (*others, "absent", "."):
            require(not _recognises(reader, Path(folder) / other), f"{what}: recognises a file that is not its own")

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
            _damage_largest(copy, damage)
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    reader.run(copy / place.name, **options)
            except (RecordingError, OSError):
                continue
            except Exception as error:
                raise AssertionError(
                    f"{what}: a damaged file ({damage}) raises {error!r}, no RecordingError"
                ) from error
            require(damage in ("half", "noise"), f"{what}: an {damage} file raises nothing")


def _recognises(reader: Any, path: Path) -> bool:
    try:
        return bool(reader.facts["sniff"](path))
    except OSError:
        return False
    except Exception as error:
        raise AssertionError(f"radar reader {reader.name!r}: sniff raises {error!r} at {path.name!r}") from error


def _damage_largest(folder: Path, damage: str) -> None:
    """Remove, empty, cut or disturb the largest file of a folder."""
    file = max((one for one in folder.rglob("*") if one.is_file()), key=lambda one: one.stat().st_size)
    content = bytearray(file.read_bytes())
    if damage == "absent":
        file.unlink()
        return
    if damage == "noise":
        rng = np.random.default_rng(len(content))
        for place in rng.integers(0, len(content), 1 + len(content) // 100):
            content[place] = int(rng.integers(256))
    file.write_bytes({"empty": b"", "half": bytes(content[: len(content) // 2]), "noise": bytes(content)}[damage])


def check_radar_writer(name: str, recording: Recording, *, rtol: float = 1e-6, **options: Any) -> None:
    """Check that a writer of radar recordings keeps its contract.

    Parameters
    ----------
    name : str
        Its name in the group of writers.
    recording : Recording
        Any that the format can hold, with its seed, notes and further facts.
    rtol : float
        Largest difference of the baseband when it is read again, of its largest value.
    **options
        Options that writing needs.

    Raises
    ------
    AssertionError
        If a rule is broken: registration, one ending, a recording that is read back, the same bytes
        each time, an ``OutputError`` and no file where it cannot write.
    """
    from doppelgait.core.errors import OutputError
    from doppelgait.radar.readers import RADAR_WRITERS, read_recording

    what = f"radar writer {name!r}"
    require(name in RADAR_WRITERS, f"{what} is not registered; known are {', '.join(RADAR_WRITERS)}")
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
            trees.append(_file_contents(Path(folder) / part))
        require(trees[0], f"{what} makes no file")
        require(trees[0] == trees[1], f"{what}: the same recording gives other bytes")
        again = read_recording(made if made is not None else Path(folder) / part / f"walk{suffix}")
        require(again.baseband.shape == before.shape, f"{what}: read again it has the shape {again.baseband.shape}")
        _check_close(again.baseband.values, before.values, f"{what}: read again the baseband differs", rtol)
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
            raise AssertionError(f"{what}: a place that cannot be written raises {error!r}, no OutputError") from error
        else:
            raise AssertionError(f"{what}: a place that cannot be written raises nothing")
        require(sorted(os.listdir(folder)) == ["file"], f"{what}: leaves files where it cannot write")


def _file_contents(folder: Path) -> dict[str, bytes]:
    return {str(one.relative_to(folder)): one.read_bytes() for one in sorted(folder.rglob("*")) if one.is_file()}


def check_impairment(parameters: FrozenModel, radar: Radar, *, n_pulses: int = 64, seed: int = 0) -> None:
    """Check that an impairment keeps the contract of :class:`doppelgait.radar.impairments.Apply`.

    Parameters
    ----------
    parameters : FrozenModel
        Parameters of the impairment.
    radar : Radar
        A radar that it suits.
    n_pulses : int
        Pulses to try it on.
    seed : int
        Of the samples and of what the impairment draws.

    Raises
    ------
    AssertionError
        If a rule is broken: registration, round trip through JSON, shape, finite values, the same result for the same
        random numbers and in both layouts of the samples, an input that stays as it is unless its memory is given away,
        pulse times that rise.

    Examples
    --------
    >>> import doppelgait as dg
    >>> dg.testing.check_impairment(dg.radar.impairments.DcLeak(), dg.Radar.preset("x4"))
    """
    from doppelgait.core.errors import DoppelgaitWarning
    from doppelgait.core.samples import Samples
    from doppelgait.radar.impairments import IMPAIRMENTS, apply_impairments, pulse_times

    kind = getattr(parameters, "kind", None)
    name = f"impairment {kind!r}"
    require(kind in IMPAIRMENTS, f"{name} is not registered; known are {', '.join(IMPAIRMENTS)}")
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
    _check_close(other, found, f"{name} differs between the two layouts of the samples", rtol=1e-5)
    nominal_s = np.arange(n_pulses) / radar.prf_hz
    times_s = pulse_times(nominal_s, [parameters], radar=radar, rng=np.random.default_rng(seed))
    require(times_s.shape == nominal_s.shape and (np.diff(times_s) >= 0).all(), f"{name}: pulse times do not rise")


def check_feature(name: str) -> None:
    """Check that a feature keeps the contract of :data:`doppelgait.features.FEATURES`.

    Parameters
    ----------
    name : str
        Its name in the group of features.

    Raises
    ------
    AssertionError
        If a rule is broken: registration, unit and source, known needs, a plain number or None, the same value for
        the same signature, a signature that is left alone, no dependence on the level of the signal, no value
        without a signal.

    Examples
    --------
    >>> import doppelgait as dg
    >>> dg.testing.check_feature("limb_share")
    """
    from dataclasses import replace

    from doppelgait.core.plugins import Plugin
    from doppelgait.features import FEATURES, Observed
    from doppelgait.features.observed import REASONS
    from doppelgait.pipeline.target import observe
    from doppelgait.processing import Analysis

    label = f"feature {name!r}"
    require(name in FEATURES, f"{label} is not registered; known are {', '.join(FEATURES)}")
    feature: Plugin[Any] = FEATURES[name]
    for fact in ("unit", "source"):
        text = feature.facts.get(fact)
        require(isinstance(text, str) and text, f"{label}: {fact} is {text!r}; it must be a text")
    needs = feature.facts.get("needs", ())
    known = tuple(need for need in REASONS if need != "signal")
    require(set(needs) <= set(known), f"{label}: needs {needs}; allowed are {', '.join(known)}")

    def measure(observed: Observed) -> float | None:
        if observed.lacks(needs):
            return None
        before = observed.power_v2.copy(), observed.aligned.values.copy()
        value = feature.run(observed)
        unchanged = np.array_equal(before[0], observed.power_v2) and np.array_equal(before[1], observed.aligned.values)
        require(unchanged, f"{label}: changes the signature")
        text = f"{label}: gives {value!r}; it must be a number or None"
        require(value is None or (isinstance(value, int | float | np.number) and np.ndim(value) == 0), text)
        return None if value is None else float(value)

    mu = _walking_signature()
    first, louder = (observe(mu.copy(data=mu.values * gain), Analysis())[0] for gain in (np.float32(1), np.float32(4)))
    value = measure(first)
    fresh = measure(observe(mu, Analysis())[0])
    require(_same_number(value, measure(first)) and _same_number(value, fresh), f"{label}: changes from call to call")
    text = f"{label}: four times the power changes {value} to"
    require(_same_number(value, loud := measure(louder)), f"{text} {loud}")
    if "set_f" in feature.facts:
        return
    empty = replace(first, extraction=replace(first.extraction, torso_doppler_hz=None))
    require(empty.lacks(needs) is not None, f"{label}: is measured without a signal")


def _same_number(one: float | None, other: float | None) -> bool:
    if one is None or other is None:
        return one is other
    return math.isclose(one, other, rel_tol=1e-3, abs_tol=1e-6) or (math.isnan(one) and math.isnan(other))


@lru_cache(maxsize=1)
def _walking_signature() -> xr.DataArray:
    """Signature of a walking person, inside the frame and at the lossless hop."""
    from doppelgait.core.rng import Streams
    from doppelgait.motion import boulic_walk
    from doppelgait.pipeline import analyze, simulate
    from doppelgait.radar import Radar
    from doppelgait.scene import Scene, Target

    scene = Scene([Target(boulic_walk(speed_mps=1.3, duration_s=3.1), label="human", range_m=6.0)], duration_s=3.0)
    recording = simulate(scene, Radar.preset("x4"), rng=Streams(5), snr_db=25.0, angles=False)
    return analyze(recording, gate="truth")[0].signature


def check_classifier(name: str, *, seed: int = 0) -> None:
    """Check that a classifier keeps the contract of :class:`doppelgait.classify.training.Trainer`.

    Parameters
    ----------
    name : str
        Its name in the group of classifiers.
    seed : int
        Of the made-up rows.

    Raises
    ------
    AssertionError
        If a rule is broken: registration, a result in one of the forms that a model file keeps, probabilities of two
        and of three classes, unknown values, no held-out rows, the same model for the same seed, inputs left alone,
        classes that are easily separated.

    Examples
    --------
    >>> import doppelgait as dg
    >>> dg.testing.check_classifier("six-logistic")
    """
    from doppelgait.classify.learned import Constant, Linear, Network, Part, Trees
    from doppelgait.classify.training import CLASSIFIERS

    label = f"classifier {name!r}"
    require(name in CLASSIFIERS, f"{label} is not registered; known are {', '.join(CLASSIFIERS)}")
    train = CLASSIFIERS[name].run
    features, baseline = CLASSIFIERS[name].facts.get("features"), CLASSIFIERS[name].facts.get("baseline", False)
    known = ("six", "extended", "speed", "signature", "nuisance", "nothing")
    text = f"{label}: the fact features is {features!r}; allowed are {', '.join(known)}"
    require(features in known, text)
    for n_classes in (2, 3):
        rows, held = (_classifier_rows(str(features), n_classes, number, seed) for number in (48, 24))
        before: list[Any] = [None if row is None else np.array(row, copy=True) for row in rows.values]
        learned = train(rows, held, n_classes=n_classes, seed=1)
        forms = Constant | Linear | Trees | Network
        require(isinstance(learned, forms), f"{label}: gives {type(learned).__name__}, not one of {forms}")
        same = [
            (one is None and other is None) or np.array_equal(one, other, equal_nan=True)
            for one, other in zip(before, rows.values, strict=True)
        ]
        require(all(same), f"{label}: training changes its inputs")
        found = learned.log_probability(held.values)
        shape = (held.labels.size, n_classes)
        require(found.shape == shape, f"{label}: log_probability gives the shape {found.shape}, not {shape}")
        require(np.isfinite(found).all(), f"{label}: a log-probability is not finite")
        _check_close(np.exp(found).sum(axis=1), np.ones(len(found)), f"{label}: probabilities do not add up to 1", 1e-6)
        again = train(rows, held, n_classes=n_classes, seed=1).log_probability(held.values)
        require(np.array_equal(found, again), f"{label}: the same seed and rows give another model")
        empty = Part(held.values[:0], held.labels[:0])
        alone = train(rows, empty, n_classes=n_classes, seed=1).log_probability(held.values)
        require(np.isfinite(alone).all(), f"{label}: without held-out rows a log-probability is not finite")
        if not baseline:
            whole = np.array([row is not None and not np.isnan(row[:1]).any() for row in held.values])
            right = float((found.argmax(axis=1) == held.labels)[whole].mean())
            require(right > 0.8, f"{label}: only {right:.0%} of rows right, where the classes are far apart")


def _classifier_rows(features: str, n_classes: int, count: int, seed: int) -> Any:
    """Rows of classes that are far apart, a few with unknown features or without a signature."""
    from doppelgait.classify.learned import Part
    from doppelgait.classify.patches import Patch

    rng = np.random.default_rng([seed, n_classes, count])
    labels = np.arange(count, dtype=np.int64) % n_classes
    if features == "signature":
        patch = Patch()
        values = np.empty(count, dtype=object)
        band = patch.n_velocity // (n_classes + 1)
        for number, label in enumerate(labels):
            levels = rng.uniform(0.0, 0.2, (patch.n_velocity, patch.n_time)).astype(np.float32)
            levels[: band * (label + 1)] += np.float32(0.7)
            values[number] = levels
        values[-1] = None
        return Part(values, labels)
    width = {"six": 6, "extended": 9, "speed": 1, "nuisance": 5, "nothing": 0}[features]
    table = rng.standard_normal((count, width)) + 6.0 * labels[:, None]
    if width > 1:
        table[rng.random(table.shape) < 0.05] = np.nan
        table[:, -1] = np.nan  # never known
    return Part(table, labels)


def check_exporter(kind: str, dataset: Dataset) -> None:
    """Check that an exporter keeps the contract of :data:`doppelgait.dataset.export.EXPORTERS`.

    Parameters
    ----------
    kind : str
        Its name in the group of exporters.
    dataset : Dataset
        A dataset with rows that keeps the fields that the exporter needs.

    Raises
    ------
    AssertionError
        If a rule is broken: registration, parameters with defaults, the number of rows that are done, files that do not
        depend on when they are written, nothing outside of the folder.
    """
    import tempfile
    from pathlib import Path

    from doppelgait.core.files import file_sha256
    from doppelgait.dataset.export import EXPORTERS, export_dataset

    def hashes(folder: Path) -> dict[str, str]:
        return {str(p.relative_to(folder)): file_sha256(p) for p in sorted(folder.rglob("*")) if p.is_file()}

    name = f"exporter {kind!r}"
    require(kind in EXPORTERS, f"{name} is not registered; known are {', '.join(EXPORTERS)}")
    parameters = EXPORTERS.parse(kind)  # all of them need a default
    require(EXPORTERS.parse(parameters.model_dump(mode="json")) == parameters, f"{name}: other parameters after JSON")
    require(len(dataset) > 0, f"{name}: the dataset of the check has no rows")
    before = hashes(dataset.directory)
    with tempfile.TemporaryDirectory() as folder:
        found, done = [], {"rows": 0}
        for attempt in ("one", "two"):
            done["rows"] = 0
            report = export_dataset(
                dataset, Path(folder) / attempt, form=kind, on_progress=lambda rows, _: done.update(rows=rows)
            )
            require(done["rows"] == len(dataset), f"{name}: counts {done['rows']} of {len(dataset)} rows as done")
            require(report.n_files > 2, f"{name}: writes no file")
            require(sorted(p.name for p in Path(folder).iterdir())[-1] == attempt, f"{name}: leaves files elsewhere")
            found.append(hashes(Path(folder) / attempt))
        require(found[0] == found[1], f"{name}: the same dataset gives other files")
    require(hashes(dataset.directory) == before, f"{name}: changes the dataset")


def check_motion_model(model: FrozenModel | str, *, duration_s: float = 2.0, seed: int = 0) -> None:
    """Check that a motion model keeps the contract of the group ``motion_model``.

    Parameters
    ----------
    model : parameter model or str
        Parameters, or the kind alone for its default ones.
    duration_s : float
        Time to cover.
    seed : int
        Of the random numbers that it draws.

    Raises
    ------
    AssertionError
        If a rule is broken: parameters with defaults that come back from JSON, frames over the whole time, finite
        positions under unique names, facts of its kind, the same motion for the same seed.

    Examples
    --------
    >>> import doppelgait as dg
    >>> dg.testing.check_motion_model("boulic")
    """
    from doppelgait.motion.models import MOTION_MODELS, generate, parameters_of

    kind = model if isinstance(model, str) else str(getattr(model, "kind", ""))
    name = f"motion model {kind!r}"
    require(kind in MOTION_MODELS, f"{name} is not registered; known are {', '.join(MOTION_MODELS)}")
    parameters = MOTION_MODELS.parse(model)
    parameters_of(kind)()  # every parameter has a default
    plain = parameters.model_dump(mode="json")
    require(MOTION_MODELS.parse(plain) == parameters, f"{name}: its parameters are others after JSON")
    motions = [generate(given, duration_s=duration_s, rng=np.random.default_rng(seed)) for given in (parameters, plain)]
    _check_motion(name, motions[0])
    lasts_s, frame_s = motions[0].duration_s, 1.0 / motions[0].rate_hz
    require(
        -1e-9 <= lasts_s - duration_s < frame_s + 1e-9, f"{name}: lasts {lasts_s:g} s where {duration_s:g} s are wanted"
    )
    require(motions[0].time_s[0] == 0.0, f"{name}: starts at {motions[0].time_s[0]:g} s, must be 0")
    require(motions[0].facts.kind == kind, f"{name}: facts.kind is {motions[0].facts.kind!r}")
    require(np.isfinite(motions[0].position_m).all(), f"{name}: positions are not finite")
    _check_same_motion(name, *motions)


def check_motion_reader(name: str, path: str | Path, **options: Any) -> None:
    """Check that a motion reader keeps the contract of the group ``motion_reader``.

    Parameters
    ----------
    name : str
        Its name in the group.
    path : path-like
        A file of its format of which it alone takes the content.
    **options
        Options of the reader.

    Raises
    ------
    AssertionError
        If a rule is broken: a sniffer that goes by content and takes nothing else, keyword-only options, the same
        motion each time, named markers, facts of the file, a ``MotionError`` for a damaged file or an unknown option.
    """
    import inspect
    import os
    import shutil
    import tempfile
    import warnings
    from pathlib import Path

    from doppelgait.core.errors import DoppelgaitWarning, MotionError
    from doppelgait.motion.readers import HEAD_BYTES, MOTION_READERS, read

    path, what = Path(path), f"motion reader {name!r}"
    require(name in MOTION_READERS, f"{what} is not registered; known are {', '.join(MOTION_READERS)}")
    reader = MOTION_READERS[name]
    missing = [fact for fact in ("sniff", "suffixes") if fact not in reader.facts]
    require(not missing, f"{what}: register it with {' and '.join(f'{fact}=...' for fact in missing)}")
    kinds = [parameter.kind for parameter in inspect.signature(reader.run).parameters.values()]
    require(
        kinds and all(kind is inspect.Parameter.KEYWORD_ONLY for kind in kinds[1:]),
        f"{what}: must take one path and keyword-only options",
    )
    content = path.read_bytes()
    sniff = reader.facts["sniff"]
    require(sniff(path, content[:HEAD_BYTES]), f"{what}: does not recognise {path}")
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", DoppelgaitWarning)
        for other in (b"no motion\n", bytes(range(256)) * 4):
            (Path(folder) / "other").write_bytes(other)
            taken = sniff(Path(folder) / "other", other)
            require(not taken, f"{what}: takes a file that begins with {other[:10]!r}")
        beside = [one for one in path.parent.iterdir() if one.suffix != path.suffix and one.is_file()]
        for one in (one for one in beside if one.stat().st_size < 1e6):
            shutil.copy(one, folder)
        renamed = Path(folder) / f"{path.stem}.unknown"
        renamed.write_bytes(content)
        first, again, other_name = (read(file, clean=False, **options) for file in (path, path, renamed))
        _check_motion(what, first)
        facts = first.facts
        require(facts.source == path.name, f"{what}: facts.source is {facts.source!r}, must be the file's name")
        require(facts.kind == "recording", f"{what}: facts.kind is {facts.kind!r}, must be 'recording'")
        _check_same_motion(what, first, again)
        _check_same_motion(what, first, other_name.with_facts(source=facts.source))
        try:
            read(path, clean=False, no_such_option=1)
        except MotionError:
            pass
        else:
            raise AssertionError(f"{what}: takes the option no_such_option")
        for size in (len(content) // 2, min(len(content), 600)):
            renamed.write_bytes(content[:size])
            try:
                read(renamed, clean=False, **options)
            except MotionError as error:
                require(os.fspath(renamed) in str(error), f"{what}: the error does not name the file: {error}")
    require(path.read_bytes() == content, f"{what}: changed the file")


def check_path(path: FrozenModel) -> None:
    """Check that a kind of path keeps the contract of the group ``path``.

    Parameters
    ----------
    path : Path
        Parameters of a path that a walk of 1.2 m/s follows for 8 s or less.

    Raises
    ------
    AssertionError
        If a rule is broken: a model derived from :class:`doppelgait.motion.paths.Path` that comes back from JSON,
        pieces of positive length with at most the last one endless, stops in order, a walk that follows it.

    Examples
    --------
    >>> import doppelgait as dg
    >>> dg.testing.check_path(dg.motion.make_path({"kind": "arc", "radius_m": 2.0, "turn_deg": 90.0}))
    """
    from doppelgait.motion import boulic_walk, follow
    from doppelgait.motion.paths import PATHS, Path, layout_of

    kind = str(getattr(path, "kind", ""))
    name = f"path {kind!r}"
    require(kind in PATHS, f"{name} is not registered; known are {', '.join(PATHS)}")
    if not isinstance(path, Path):
        raise AssertionError(f"{name}: its model must be derived from doppelgait.motion.paths.Path")
    require(PATHS.parse(path.model_dump(mode="json")) == path, f"{name}: its parameters are others after JSON")
    layout = layout_of(path)
    lengths = [piece.length_m for piece in layout.pieces]
    require(lengths and min(lengths) > 0, f"{name}: needs pieces of positive length, has {lengths}")
    require(all(math.isfinite(length) for length in lengths[:-1]), f"{name}: only its last piece may be endless")
    stops = [stop.at_m for stop in layout.stops]
    require(stops == sorted(stops), f"{name}: its stops are out of order: {stops}")
    walk = boulic_walk(speed_mps=1.2, duration_s=12.0, rate_hz=100.0)
    followed, moved = follow(walk, path), follow(walk, path, start_position_m=(2.0, -1.0), heading_deg=90.0)
    _check_motion(name, followed)
    require(followed.facts.path is not None and followed.facts.path.kind == kind, f"{name}: facts.path is not of it")
    turned = followed.position_m[..., [1, 0, 2]] * (-1.0, 1.0, 1.0) + (2.0, -1.0, 0.0)
    _check_close(moved.position_m, turned, f"{name}: another start or heading changes its shape", rtol=1e-9)


def _check_motion(name: str, motion: Any) -> None:
    """Type, names, times and facts that every motion has."""
    import json

    from doppelgait.motion import Motion

    require(
        isinstance(motion, Motion), f"{name}: returns a {type(motion).__name__}, must be a doppelgait.motion.Motion"
    )
    require(motion.position_m.dtype == np.float64, f"{name}: positions are {motion.position_m.dtype}, must be float64")
    require(motion.n_frames >= 2, f"{name}: holds {motion.n_frames} frames")
    require(not np.isinf(motion.position_m).any(), f"{name}: a position is infinite")
    names = motion.markers
    require(all(names) and len(set(names)) == len(names), f"{name}: markers need unique names, has {names}")
    times = motion.time_s
    require(
        np.allclose(np.diff(times), 1.0 / motion.rate_hz, rtol=1e-6),
        f"{name}: frames are not 1 / rate_hz = {1.0 / motion.rate_hz:g} s apart",
    )
    facts = motion.facts
    require(facts.source, f"{name}: facts.source is empty")
    for fact in ("height_m", "mass_kg", "stride_frequency_hz", "step_frequency_hz", "gait_frequency_hz"):
        value = getattr(facts, fact)
        require(math.isnan(value) or value > 0, f"{name}: facts.{fact} is {value}, must be positive or NaN")
    for foot, touchdowns in facts.footfalls.items():
        inside = all(times[0] - 1e-9 <= t <= times[-1] + 1e-9 for t in touchdowns)
        require(inside and list(touchdowns) == sorted(touchdowns), f"{name}: footfalls of {foot} are not in its time")
    try:
        json.dumps(dict(motion.report))
    except (TypeError, ValueError) as error:
        raise AssertionError(f"{name}: its report is not plain: {error}") from None


def _check_same_motion(name: str, one: Any, other: Any) -> None:
    same = np.array_equal(one.position_m, other.position_m, equal_nan=True) and one.markers == other.markers
    require(same and repr(one.facts) == repr(other.facts), f"{name}: gives another motion the second time")


def check_rcs(parameters: Any) -> None:
    """Check that a kind of radar cross section keeps the contract of :class:`doppelgait.scene.scatterers.Scatter`.

    Parameters
    ----------
    parameters : RcsSpec, table or str
        For example ``{"kind": "bright_head", "share": 0.9}``; its points are those of a walking person.

    Raises
    ------
    AssertionError
        If a rule is broken: registration, round trip through TOML, shapes, values, the same numbers again, no change to
        the motion, a total that scales.

    Examples
    --------
    >>> import doppelgait as dg
    >>> dg.testing.check_rcs("ellipsoids")
    """
    from doppelgait.motion import boulic_walk
    from doppelgait.scene import Scene, Target
    from doppelgait.scene.placement import place
    from doppelgait.scene.rcs import RCS
    from doppelgait.scene.scatterers import View

    target = Target({"kind": "boulic"}, rcs=parameters)
    spec, name = target.rcs, f"rcs {target.rcs.kind!r}"
    scene = Scene([target], duration_s=1.0)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "scene.toml"
        path.write_text(scene.to_toml(), encoding="utf-8")
        require(Scene.from_toml(path) == scene, f"{name}: the parameters are others after TOML")

    walk = boulic_walk(speed_mps=1.2, duration_s=1.0)
    motion = place(Scene([Target(walk, range_m=4.0)])).targets[0].motion
    before, times_s = motion.position_m.copy(), np.arange(40) / 50.0

    def scatter(own: Any) -> tuple[Any, npt.NDArray[np.float64]]:
        return RCS.of(own).run(View(motion, times_s, np.array([0.0, 0.0, 1.0])), own)  # type: ignore[no-any-return]

    points, rcs_m2 = scatter(spec)
    require(np.array_equal(motion.position_m, before), f"{name}: changes the motion")
    n_points = len(points.markers)
    shapes = ((n_points,), (times_s.size, n_points))
    require(rcs_m2.shape in shapes, f"{name}: cross sections of shape {rcs_m2.shape}, not {shapes[0]} or {shapes[1]}")
    require(np.isfinite(rcs_m2).all() and (rcs_m2 >= 0).all(), f"{name}: cross sections are not finite and 0 or larger")
    require(rcs_m2.sum() > 0, f"{name}: nothing scatters")
    again, same_m2 = scatter(spec)
    require(np.array_equal(same_m2, rcs_m2), f"{name}: the same motion gives other cross sections")
    require(np.array_equal(again.position_m, points.position_m), f"{name}: the same motion gives other points")
    one, four = (scatter(spec.model_copy(update={"total_m2": total_m2}))[1] for total_m2 in (1.0, 4.0))
    _check_close(four, 4.0 * one, f"{name}: four times total_m2 is not four times the cross sections")


def check_environment(parameters: Any) -> None:
    """Check that an environment effect keeps the contract of :class:`doppelgait.scene.environment.Apply`.

    Parameters
    ----------
    parameters : parameter model, table or str
        For example ``{"kind": "wall", "loss_db": 3.0}``; it acts on a person who walks to the radar at the origin.

    Raises
    ------
    AssertionError
        If a rule is broken: registration, round trip through JSON, no change to the table, originals first, added rows
        of no target, the same numbers again, finite values, an empty table.

    Examples
    --------
    >>> import doppelgait as dg
    >>> dg.testing.check_environment({"kind": "wall", "loss_db": 3.0})
    """
    from doppelgait.motion import boulic_walk
    from doppelgait.scene import Scene, Target, assemble
    from doppelgait.scene.environment import ENVIRONMENT, Setting

    spec: Any = ENVIRONMENT.parse(parameters)
    effect, name = ENVIRONMENT.of(spec), f"environment effect {spec.kind!r}"
    require(ENVIRONMENT.parse(spec.model_dump(mode="json")) == spec, f"{name}: the parameters are others after JSON")
    setting = Setting(wavelength_m=0.04, radar_position_m=(0.0, 0.0, 1.0))
    times_s = np.arange(20) / 50.0
    scene = Scene([Target(boulic_walk(speed_mps=1.2, duration_s=1.0), range_m=5.0)])
    table = assemble(scene, times_s)
    before = table.copy(deep=True)
    after = effect.run(table, spec, setting)
    require(table.identical(before), f"{name}: changes the table that it is given")
    require(after.identical(effect.run(table, spec, setting)), f"{name}: the same table gives another one")
    n_before, n_after = table.sizes["scatterer"], after.sizes["scatterer"]
    require(n_after >= n_before, f"{name}: drops scatterers")
    require(after.sizes["slow_time"] == times_s.size, f"{name}: changes the number of pulses")
    for column in ("marker", "part", "target"):
        kept = np.array_equal(after[column].values[:n_before], table[column].values)
        require(kept, f"{name}: the scatterers before are not the first rows, in their order ({column})")
    require((after["target"].values[n_before:] == -1).all(), f"{name}: added rows belong to a target")
    for column in ("range", "radial_velocity", "rcs", "path_gain"):
        require(np.isfinite(after[column].values).all(), f"{name}: {column} is not finite")
    for column in ("rcs", "path_gain"):
        require((after[column].values >= 0).all(), f"{name}: {column} is negative")
    nothing = assemble(Scene([], duration_s=1.0), times_s)
    require(effect.run(nothing, spec, setting).sizes["scatterer"] == 0, f"{name}: an empty room gets scatterers")
