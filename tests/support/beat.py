"""Beat samples of frequency sweeps, from the text-book equation, and files that hold them."""

import numpy as np

C_MPS = 299_792_458.0


def beat(range_m, velocity_mps, *, carrier_hz, bandwidth_hz, sweep_s, n_samples):
    """exp(+2 pi j (f_c t_d + S u t_d)), u from the sweep's middle: the phase grows with range.

    ``range_m`` and ``velocity_mps`` (approaching) have the shape (sweeps, points), for the sweep's middle; the points
    are summed. The residual video phase is left out: 0.01 rad at 10 m.
    """
    u = (np.arange(n_samples) - (n_samples - 1) / 2) * sweep_s / n_samples
    total = np.zeros((len(range_m), n_samples), complex)
    for r, v in zip(np.transpose(range_m), np.transpose(velocity_mps), strict=True):
        delay_s = 2.0 / C_MPS * (r[:, None] - v[:, None] * u)
        total += np.exp(2j * np.pi * delay_s * (carrier_hz + bandwidth_hz / sweep_s * u))
    return total


def approaching(n_sweeps, prf_hz, start_m, speed_mps):
    """Ranges and velocities of one point that approaches evenly, each (sweeps, 1)."""
    times_s = np.arange(n_sweeps) / prf_hz
    return start_m - speed_mps * times_s[:, None], np.full((n_sweeps, 1), speed_mps)


def walker(n_sweeps, prf_hz, *, start_m=8.0, speed_mps=1.2, seed=1):
    """Ranges and velocities of the markers of a walking model that approaches, from the radar's height of 1 m."""
    import doppelgait as dg

    walk = dg.motion.human_gait(speed_mps=speed_mps, duration_s=n_sweeps / prf_hz + 0.2)
    times_s = np.arange(n_sweeps) / prf_hz
    places = np.stack(
        [
            [np.interp(times_s, walk.time_s, walk.position_m[:, m, k]) for k in range(3)]
            for m in range(walk.position_m.shape[1])
        ]
    )  # (markers, space, sweeps); it walks along +x
    away = places - np.array([places[:, 0, 0].mean() + start_m, places[:, 1].mean(), 1.0])[None, :, None]
    range_m = np.linalg.norm(away, axis=1).T
    return range_m, -np.gradient(range_m, 1.0 / prf_hz, axis=0)


def write_glasgow(path, samples, *, carrier_hz=5.8e9, sweep_ms=1, bandwidth_hz=400e6, step=400.0):
    """The beat in steps of a 12-bit converter around 2048, as the Ancortek program writes it."""
    codes = np.round(samples * step) + 2048 + 2048j
    lines = [f"{carrier_hz:.0f}", f"{sweep_ms:g}", f"{samples.shape[1]}", f"{bandwidth_hz:.0f}"]
    lines += [f"{z.real:.0f}{z.imag:+.0f}i" for z in codes.ravel()]
    path.write_text("\n".join(lines) + "\n")
    return path
