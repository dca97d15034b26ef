"""Contract checks: every built-in plug-in passes, and a broken one is caught."""

import itertools
from contextlib import nullcontext
from typing import Literal

import numpy as np
import pytest

from doppelgait.core.config import FrozenModel
from doppelgait.core.errors import AnalysisError
from doppelgait.features import FEATURES
from doppelgait.radar import WAVEFORMS, Radar
from doppelgait.radar.impairments import IMPAIRMENTS, make_impairment
from doppelgait.radar.waveforms.pulses import Impulse
from doppelgait.testing import check_feature, check_impairment, check_waveform

COMMON = {"carrier_hz": 24e9, "prf_hz": 500.0, "range_stop_m": 9.0, "transmit_phase_rad": 0.4}
RADARS = {
    "impulse": {"sample_rate_hz": 3e9, "bandwidth_hz": 1e9},
    "rectangular": {"sample_rate_hz": 3e9, "sweep_s": 2e-9},
    "lfm": {"sample_rate_hz": 3e9, "sweep_s": 1e-6, "bandwidth_hz": 1e9},
    "fmcw": {"sample_rate_hz": 256e3, "sweep_s": 1e-3, "bandwidth_hz": 1e9},
    "stepped": {"sample_rate_hz": 256e3, "sweep_s": 1e-3, "bandwidth_hz": 1e9},
    "cw": {},
}


# Features ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FEATURES)
def test_every_feature_keeps_its_contract(name):
    check_feature(name)


CALLS = itertools.count()


def _greedy(observed):
    observed.power_v2[0] = 0.0
    return 1.0


BROKEN_FEATURES = {
    "array": ({"unit": "1", "source": "here"}, lambda observed: observed.mean_row, "must be a number or None"),
    "text": ({"unit": "1", "source": "here"}, lambda observed: "much", "must be a number or None"),
    "memory": ({"unit": "1", "source": "here"}, lambda observed: float(next(CALLS)), "changes from call to call"),
    "level": ({"unit": "1", "source": "here"}, lambda observed: float(observed.power_v2.max()), "four times the power"),
    "greedy": ({"unit": "1", "source": "here"}, _greedy, "changes the signature"),
}


@pytest.mark.parametrize("fault", BROKEN_FEATURES)
def test_a_broken_feature_is_caught(register, fault):
    facts, function, message = BROKEN_FEATURES[fault]
    register("feature", "broken", **facts)(function)
    with pytest.raises(AssertionError, match=message):
        check_feature("broken")


# Waveforms -----------------------------------------------------------------------------------------------------------


def test_every_waveform_keeps_its_contract():
    assert set(RADARS) == set(WAVEFORMS)
    for kind, parameters in RADARS.items():
        check_waveform(kind, Radar(waveform=kind, **COMMON, **parameters))


class BrokenImpulse(Impulse):
    kind: Literal["broken"] = "broken"


def _compress(echoes):
    return echoes / (1 + np.abs(echoes) / 1e-6).astype(np.float32)


def _drift(echoes):
    return echoes * np.arange(1, len(echoes) + 1, dtype=np.float32)[:, None]


def _move_scatterers(self, scatterers, radar):
    scatterers["range"] = scatterers["range"] + 0.0001
    return Impulse.synthesise(self, scatterers, radar)


def _ignore_path_phase(self, scatterers, radar):
    return Impulse.synthesise(self, scatterers.drop_vars("path_phase", errors="ignore"), radar)


def _change_echoes(change):
    return lambda self, scatterers, radar: change(Impulse.synthesise(self, scatterers, radar))


@pytest.mark.parametrize(
    ("method", "broken", "message"),
    [
        ("synthesise", _change_echoes(lambda echoes: echoes * np.float32(1.1)), "has amplitude 1.100"),
        ("synthesise", _change_echoes(lambda echoes: echoes.astype(np.complex128)), "complex128, not complex64"),
        ("synthesise", _change_echoes(np.conj), "does not turn the echoes"),
        ("synthesise", _change_echoes(_compress), "do not add up|twice the amplitude"),
        ("synthesise", _change_echoes(_drift), "depend on others"),
        ("synthesise", _ignore_path_phase, "path_phase"),
        ("synthesise", _move_scatterers, "changes the scatterer table"),
        ("resolution_m", lambda self, radar: 0.5 * Impulse.resolution_m(self, radar), "resolution_m is"),
        ("noise_gain", lambda self, radar: 0.5, "noise_gain is 0.5"),
        ("independent_bins", lambda self, radar: 2.0, "independent_bins"),
    ],
)
def test_a_broken_waveform_is_caught(register, monkeypatch, method, broken, message):
    monkeypatch.setattr(BrokenImpulse, method, broken, raising=False)
    register("waveform")(BrokenImpulse)
    with pytest.raises(AssertionError, match=message):
        check_waveform("broken", Radar(waveform="broken", **COMMON, **RADARS["impulse"]))


LFM = Radar(waveform="lfm", **COMMON, **RADARS["lfm"])


@pytest.mark.parametrize(
    ("check", "message"),
    [
        (lambda: check_feature("charm"), "not registered; known are"),
        (lambda: check_waveform("sonar", LFM), "not registered; known are cw, fmcw"),
        (lambda: check_waveform("fmcw", LFM), "the radar has waveform 'lfm'"),
        (lambda: check_impairment(Broken(), LFM), "'broken' is not registered"),
    ],
)
def test_what_is_not_registered_or_not_the_radars_is_caught(check, message):
    with pytest.raises(AssertionError, match=message):
        check()


IMPAIRED = {
    "adc": {}, "dc_leak": {}, "dropped_frames": {"probability": 0.2}, "frame_jitter": {},
    "interference": {"rate_hz": 50}, "iq_imbalance": {}, "leakage": {}, "phase_noise": {"density_dbc_per_hz": -80},
    "static_clutter": {"rcs_per_metre_m2": 0.1}, "thermal_noise": {},
    "coloured_noise": {"levels": [[1.0, -90.0], [50.0, -110.0]]}, "spur": {},
}  # fmt: skip


def test_every_impairment_keeps_its_contract():
    assert {*IMPAIRED, "x4_counts"} == set(IMPAIRMENTS)
    for name, parameters in IMPAIRED.items():
        for kind in RADARS:
            spec = make_impairment({"kind": name, **parameters})
            check_impairment(spec, Radar(waveform=kind, **COMMON, **RADARS[kind]))
    check_impairment(make_impairment({"kind": "x4_counts", "pulses_per_step": 5}), Radar.preset("x4"))


class Broken(FrozenModel):
    kind: Literal["broken"] = "broken"
    level_v: float = 0.5


def _clear(samples, *_):
    samples.matrix[:] = 0
    return samples


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (lambda samples, parameters, *_: samples + parameters.level_v, None),
        (_clear, "not its own"),
        (lambda samples, *_: samples.matrix[:, :-1], "returns samples of shape"),
        (lambda samples, *_: samples * np.nan, "not finite"),
        (lambda samples, *_: samples + np.random.default_rng().normal(), "for the same rng"),
        (lambda samples, *_: samples + (1.0 if samples._planes is None else 2.0), "between the two layouts"),
    ],
)
def test_an_own_impairment_passes_and_a_broken_one_is_caught(register, broken, message):
    register("impairment", parameters=Broken)(broken)
    with pytest.raises((AssertionError, AnalysisError), match=message) if message else nullcontext():
        check_impairment(Broken(), Radar.preset("x4"))


def test_an_impairment_that_moves_pulses_back_is_caught(register):
    register("impairment", parameters=Broken, shift_times=lambda times_s, *_: times_s[::-1])(
        lambda samples, *_: samples
    )
    with pytest.raises(AssertionError, match="pulse times do not rise"):
        check_impairment(Broken(), Radar.preset("x4"))
