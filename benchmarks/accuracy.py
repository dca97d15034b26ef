"""Relative L2 error of the fast path against the float64 NumPy equations."""

from __future__ import annotations

from typing import Any

import numpy as np
from obvious import obvious_edge_signature, obvious_signature, obvious_synthesis
from scenario import Case, fill_planes, new_planes, prepare, scenario
from stages import sharp_gate

from doppelgait.processing import signature
from doppelgait.radar import synthesise
from doppelgait.radar.simulate import label_baseband


def measure_accuracy() -> dict[str, float]:
    """Errors of both forms of the synthesis, and of the hop-1 signature with both kinds of gate edges."""
    case = prepare(*scenario())
    exact = obvious_synthesis(case.table, case.radar, case.amplitude_v)
    fast, planes = synthesise(case.table, case.radar), new_planes(case)
    fill_planes(case, planes)
    of_planes = (planes[0] + 1j * planes[1])[:, : case.slow_time_s.size].T
    rounded = label_baseband(exact.astype(np.complex64), case.slow_time_s, case.radar)
    return {
        "synthesis, data matrix": relative_error(fast.values, exact),
        "synthesis, planes": relative_error(of_planes, exact),
        **signature_errors(case, exact, "of exact data rounded to complex64", rounded),
        **signature_errors(case, exact, "of the synthesis, end to end", fast),
    }


def signature_errors(case: Case, exact: Any, name: str, baseband: Any) -> dict[str, float]:
    """Errors of the hop-1 signature of a baseband against the equations on the exact one."""
    cut, rows = case.cut(1), {}
    window, n_doppler = cut.transform.window, cut.transform.n_doppler_bins
    wanted = {
        "sharp": obvious_signature(exact, *sharp_gate(case), window, n_doppler),
        "fractional": obvious_edge_signature(exact, cut.low, cut.high, window, n_doppler),
    }
    for edges, reference in wanted.items():
        settings = case.analysis.model_copy(update={"gate_edges": edges})
        mu = signature(baseband, case.gate, settings, wavelength_m=case.radar.wavelength_m)
        rows[f"signature, hop 1, {edges} gate, {name}"] = relative_error(mu.values, reference)
    return rows


def relative_error(values: Any, reference: Any) -> float:
    """L2 norm of the difference over that of the reference."""
    return float(np.linalg.norm(values - reference) / np.linalg.norm(reference))
