"""Fit gain and noise figure to the measured levels."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from doppelgait.core.config import validate
from doppelgait.core.units import db_to_amplitude, power_to_db
from doppelgait.radar.fit.measure import SensorMeasurement
from doppelgait.radar.fit.model import PLAUSIBLE_NOISE_FIGURE_DB
from doppelgait.radar.fit.population import MATTERS, PooledQuantity, pool
from doppelgait.radar.fit.static import DB_PER_NEPER, Estimate
from doppelgait.radar.link import echo_amplitude_v, find_noise_slope, noise_power_v2
from doppelgait.radar.parameters import Radar

PERSON_M2 = 0.8
"""Radar cross section of a person, from which the gain follows by the level of the echoes."""


def rescale_radar(radar: Radar, scale_db: float) -> Radar:
    """Return a radar with volts scaled up.
    Echoes, noise and the step of a counter are scaled together, so that the SNR does not change.
    """
    changes = {"receiver_gain_db": radar.receiver_gain_db + scale_db}
    if radar.threshold_step_v is not None:
        changes["threshold_step_v"] = radar.threshold_step_v * float(db_to_amplitude(scale_db))
    return radar.model_copy(update=changes)


def fit_gain(
    radar: Radar,
    same: Sequence[SensorMeasurement],
    pooled: dict[str, PooledQuantity],
    people_at_m: float | None,
    *,
    radar_is_known: bool,
) -> Radar:
    """Return a radar with fitted gain and noise figure.
    The spread of both is added to ``pooled``.
    """
    if "noise_level_db" not in pooled:
        return radar
    direct = pooled.get("direct_path_db")
    by_gain = direct is not None and direct.count == len(same) and direct.spread_is_known
    channels = "noise_iq_gain_db" if is_noise_separate(pooled) else "iq_gain_db"
    quadrature_db = pooled[channels].mean.value if channels in pooled else 0.0
    added_db = DB_PER_NEPER * math.log((1.0 + 10.0 ** (quadrature_db / 10.0)) / 2.0)
    gain_db = 0.0
    echoes = [m.echo_db for m in same if math.isfinite(m.echo_db)]
    if people_at_m is not None and echoes:
        expected_v = float(echo_amplitude_v(radar, range_m=people_at_m, rcs_m2=PERSON_M2))
        gain_db = float(np.median(echoes)) - 20.0 * math.log10(expected_v)

    def figures() -> PooledQuantity:
        found = []
        for one in same:
            if "noise_level_db" not in one.estimates:
                continue
            level = one.estimates["noise_level_db"]
            own, own_db, own_sd = one.recording.radar, 0.0, 0.0
            if radar_is_known:
                own = radar.model_copy(update={"prf_hz": own.prf_hz})
            if by_gain and direct is not None:
                own_db = one.estimates["direct_path_db"].value - direct.mean.value
                own_sd = one.estimates["direct_path_db"].sd
            own = rescale_radar(own, gain_db)  # units differ in gain, but not in the step of a counter
            own = own.model_copy(update={"receiver_gain_db": own.receiver_gain_db + own_db})
            figure = find_noise_figure(own, Estimate(level.value - added_db, level.sd))
            found.append(Estimate(figure.value, math.hypot(figure.sd, own_sd)))
        return pool(found)

    figure = figures()
    low_db, high_db = PLAUSIBLE_NOISE_FIGURE_DB
    if people_at_m is None and not low_db <= figure.mean.value <= high_db:
        # such a noise figure is impossible: the scale of the file to volts is unknown, so that the gain is changed
        plausible_db = max(radar.noise_figure_db, MATTERS * (figure.spread if figure.spread_is_known else 0.0))
        gain_db = (figure.mean.value - plausible_db) * find_noise_slope(radar)
        figure = figures()
    if by_gain and direct is not None:
        pooled["gain_db"] = direct
        # no level shows the difference between the mean gain of these units and that of their kind
        mean = Estimate(figure.mean.value, math.hypot(figure.mean.sd, direct.mean.sd))
        figure = replace(figure, mean=mean)
    pooled["noise_figure_db"] = figure
    limited_db = min(max(figure.mean.value, 0.0), 100.0)
    fitted = {**rescale_radar(radar, gain_db).model_dump(), "noise_figure_db": limited_db}
    return validate(Radar, fitted, where=f"the radar fitted to {len(same)} recordings; its values should be in V")


def is_noise_separate(pooled: Mapping[str, PooledQuantity]) -> bool:
    """Return True if noise and echo images differ.
    They differ in gain or phase of Q relative to I if the noise arises behind the mixer.
    """
    for name, least in (("iq_gain_db", 0.5), ("iq_phase_deg", 3.0)):
        if name not in pooled:
            return False
        echo, noise = pooled[name].mean, pooled[f"noise_{name}"].mean
        if abs(echo.value - noise.value) > max(MATTERS * math.hypot(echo.sd, noise.sd), least):
            return True
    return False


def find_noise_figure(radar: Radar, level_db: Estimate) -> Estimate:
    """Return the noise figure for a measured level.
    It is found by bisection, because the level behind a threshold counter is not proportional to it.
    """
    from scipy.optimize import brentq

    def level_at(figure_db: float) -> float:
        return float(power_to_db(noise_power_v2(radar.model_copy(update={"noise_figure_db": figure_db}))))

    lowest, highest = -1000.0, 1000.0  # the scale of a file may be anything
    if not level_at(lowest) < level_db.value < level_at(highest):
        return Estimate(math.nan, math.inf)
    value = float(brentq(lambda figure_db: level_at(figure_db) - level_db.value, lowest, highest))
    slope = level_at(value + 0.5) - level_at(value - 0.5)
    return Estimate(value, level_db.sd / slope)
