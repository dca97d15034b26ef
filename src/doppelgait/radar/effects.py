"""Noise, integration, folding and receiver errors in words."""

from __future__ import annotations

from collections.abc import Collection

from doppelgait.radar.parameters import Radar

RECEIVER_ERRORS = {
    "I/Q and clipping": ("iq_imbalance", "adc", "x4_counts"),
    "DC": ("dc_leak", "leakage"),
    "phase noise and jitter": ("phase_noise", "frame_jitter"),
}
"""Impairments that model an effect without a radar parameter, by the name of the effect."""


def describe_effects(radar: Radar, impairments: Collection[str] = ()) -> dict[str, str]:
    """Describe noise, integration, folding and receiver errors by name.
    ``impairments`` are the kinds that act on the radar's samples.
    """
    waveform = radar.waveform
    folding_m = waveform.unambiguous_range_m(radar)
    if radar.threshold_step_v is not None:
        noise = f"counter, {1e3 * radar.threshold_step_v:.3g} mV a step"
    else:
        noise = "one sample" if radar.pulse_rate_hz is None else f"mean of {radar.averages_per_frame}"
    if radar.noise_correlation:
        correlation = ", ".join(f"{share:.2f}" for share in radar.noise_correlation)
    else:
        correlation = "none" if waveform.samples_are_bins else f"of the window ({radar.range_window})"
    if radar.integration_share > 0:
        integration = f"{radar.integration_share:g} of the frame"
    else:
        integration = "none" if waveform.samples_are_bins else "motion in the sweep"
    if not waveform.ranged:
        folding = "no range"
    else:
        folding = "none" if waveform.samples_are_bins and not radar.fold_echoes else f"at {folding_m:.4g} m"
    return {
        "noise law": noise,
        "noise correlation": correlation,
        "frame integration": integration,
        "folding": folding,
        **{
            effect: ", ".join(kind for kind in kinds if kind in impairments) or "none"
            for effect, kinds in RECEIVER_ERRORS.items()
        },
    }
