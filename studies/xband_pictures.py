"""Simulated X-band pictures beside real ones: eight measures of a picture.

    python studies/xband_pictures.py RADAR_DATA OUT --page

Question: do simulated walkers, dogs, horses and cows look like the real ones of the X-band figures?

RADAR_DATA holds `fmcw_xband_manga/decoded_levels.npz`. Simulated are the images of `studies/sim_to_real_xband.py` (same
OUT, same files): one law of speed, place, ground, noise and body for all classes. Judged are the real figures of one
target whose line was read by eye (`studies/xband_readings.py`): five walkers, four dogs, three horses and a cow. No
choice was made on horses and cows. Measures take the speed V of the line, read by eye or known, as positive; *quiet* is
the mean level of -3.4 to -0.8 m/s:

- *fill*: mean level from 0.35 m/s to V - 0.35 m/s over quiet; *1.5 V*, *2 V*, *2.5 V*: level within 0.12 m/s of it;
- *envelope*: 95th percentile over time of the fastest row above -22 dB, over V;
- *wave*: deviation of the line's centroid, without its mean over 40 columns, over V;
- *thickness*: height of the rows above -12 dB within 0.6 m/s of V, m/s;
- *verticality*, for people: correlation in time of the levels at 1.5 V and 2.1 V; *line*, for animals: its level, dB.

A simulated picture is *like* a real figure if its V is within 15 %, and its noise and the level of its line over the
ground (highest row within 0.2 m/s of zero) within 3 dB. OUT/pictures.png shows both side by side; the page shows the
simulated ones. It takes 4 minutes of one core after the X-band study, which makes the images.

Not shown: the figures were seen when the laws of bodies were chosen. A spread of four or five figures is tight, so that
left-out figures stand next to simulated pictures.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import sim_to_real_inputs as store
import sim_to_real_xband_images as images
import xband_measures as measures
from harness import EVIDENCE, finish, make_parser, markdown, quiet
from sim_to_real_xband import COUNT, SEEDS
from xband_gait import DATA_FILE, TIME_S
from xband_measures import VELOCITY_MPS, FloatArray
from xband_readings import IMAGES

CLASSES = {"human": ("human",), "dog": ("dog",), "large": ("horse", "cow")}
"""Simulated classes and the real ones they are compared with."""
SKIPPED = ("RunningTowards", "twopeople", "cowstoward1")
"""A runner beyond the axis and figures of more than one target."""
MEASURES = ("fill", "1.5 V", "2 V", "2.5 V", "envelope", "wave", "thickness")
NEAR_V, NEAR_DB = 0.15, 3.0
SHARE = 0.9
SHOWN = 3
Row = dict[str, float]


def measure_picture(level_db: FloatArray, torso_mps: float) -> Row:
    """Measure a picture (256, columns) by the speed of its line; NaN beyond the axis."""
    level_db = level_db if torso_mps > 0 else level_db[::-1]
    velocity = VELOCITY_MPS if torso_mps > 0 else -VELOCITY_MPS[::-1]
    v = abs(torso_mps)

    def rows(low: float, high: float) -> FloatArray:
        return level_db[(velocity >= low) & (velocity <= high)]

    def level(times: float) -> FloatArray:
        inside = times * v < measures.EDGE_MPS - 0.15
        return rows(times * v - 0.12, times * v + 0.12).mean(axis=0) if inside else np.full(level_db.shape[1], np.nan)

    quiet, line = rows(-3.4, -0.8).mean(), rows(v - 0.12, v + 0.12).max(axis=0).mean()
    fastest = np.where(level_db > -22.0, velocity[:, np.newaxis], 0.0).max(axis=0)
    power = 10.0 ** (rows(v - 0.5, v + 0.5) / 10.0)
    near = velocity[(velocity >= v - 0.5) & (velocity <= v + 0.5)]
    centre = near @ power / power.sum(axis=0)
    slow = np.convolve(np.pad(centre, 20, mode="edge"), np.full(40, 1 / 40), "same")[20:-20]
    thick = (rows(v - 0.6, v + 0.6) > -12.0).sum(axis=0).mean() * (velocity[0] - velocity[1])
    return {
        "fill": rows(0.35, v - 0.35).mean() - quiet if v > 0.8 else np.nan,
        **{f"{times:g} V": level(times).mean() - quiet for times in (1.5, 2.0, 2.5)},
        "envelope": np.percentile(fastest, 95) / v, "wave": (centre - slow).std() / v, "thickness": thick,
        "verticality": np.corrcoef(level(1.5), level(2.1))[0, 1],
        "line": line, "over ground": line - rows(-0.2, 0.2).max(axis=0).mean(), "V": v,
        "noise": measures.noise_db(level_db),
    }  # fmt: skip


def real_pictures(data: Path) -> Iterator[tuple[str, FloatArray, float]]:
    """Yield class, levels and speed of the real figures of one target."""
    found = measures.read_levels(data / DATA_FILE)
    for image in IMAGES:
        if not any(name in image.key for name in SKIPPED):
            shown = (image.until_s or np.inf) >= TIME_S
            label = next(name for name, real in CLASSES.items() if image.label in real)
            yield label, found[image.key][:, shown], image.eye_mps


def simulated_pictures(seed: int, count: int, out: Path) -> Iterator[tuple[str, FloatArray, float]]:
    """Yield class, levels and speed of the simulated images of a seed."""
    for numbers in store.chunks(count):
        echo = images.echo_chunk(images.Plan(seed=seed), numbers, out)
        yield from zip(echo["label"].tolist(), images.pictures(echo, numbers), echo["radial_mps"].tolist(), strict=True)


def resemble(row: Row, real: Row) -> bool:
    """Return whether a simulated picture is like a real one in speed, noise and level of its line."""
    near = all(abs(row[name] - real[name]) < NEAR_DB for name in ("over ground", "noise"))
    return near and abs(row["V"] / real["V"] - 1.0) < NEAR_V


def names_of(label: str) -> tuple[str, ...]:
    """Return the eight measures of a class."""
    return (*MEASURES, "verticality" if label == "human" else "line")


def values_of(rows: list[Row], label: str) -> FloatArray:
    """Return the eight measures of a class (rows, 8)."""
    return np.array([[row[name] for name in names_of(label)] for row in rows])


def count_within(values: FloatArray, others: FloatArray) -> float:
    """Count the measures of a picture within one deviation of the others' median; unknown ones as the rest."""
    near = np.abs(values - np.nanmedian(others, axis=0)) <= np.nanstd(others, axis=0, ddof=1)
    known = np.isfinite(values) & (np.isfinite(others).sum(axis=0) > 1)
    return float(8.0 * near[known].mean())


def compare(real: dict[str, list[Row]], made: dict[str, list[Row]]) -> dict[str, str]:
    """Tabulate coverage, medians and counts."""
    cover: list[tuple[object, ...]] = []
    medians: list[tuple[object, ...]] = []
    counts: list[tuple[object, ...]] = []
    for label, own in real.items():
        like = [row for row in made[label] if any(resemble(row, one) for one in own)]
        speed = [row for row in made[label] if any(abs(row["V"] / one["V"] - 1.0) < NEAR_V for one in own)]
        figures = values_of(own, label)
        outside = []
        for some in (speed, like):
            low, high = np.nanquantile(values_of(some, label), (0.5 - SHARE / 2, 0.5 + SHARE / 2), axis=0)
            known = np.isfinite(figures)
            outside.append(100.0 * (((figures < low) | (figures > high))[known]).mean())
        cover.append((label, len(own), len(speed), f"{outside[0]:.0f}", len(like), f"{outside[1]:.0f}"))
        pictures = values_of(like, label)
        middle, spread = np.nanmedian(figures, axis=0), np.nanstd(figures, axis=0, ddof=1)
        away = (np.nanmedian(pictures, axis=0) - middle) / spread
        table = zip(names_of(label), middle, spread, np.nanmedian(pictures, axis=0), away, strict=True)
        medians += [(label, *row) for row in table]
        medians.append((label, "within one deviation", "", "", "", f"{(np.abs(away) <= 1.0).sum()} of 8"))
        left = [count_within(one, np.delete(figures, n, axis=0)) for n, one in enumerate(figures)]
        single = [count_within(one, figures) for one in pictures]
        shown = [f"{np.mean(some):.1f} ({np.quantile(some, 0.1):.1f} to {np.quantile(some, 0.9):.1f})"
                 for some in (single, left)]  # fmt: skip
        counts.append((label, *shown))
    return {
        f"(Figure, measure) outside the central {SHARE:.0%} of the simulated pictures": markdown(
            ("", "real", "simulated at their speeds", "% outside", "and like them", "% outside"), cover
        ),
        "Medians of pictures like the real ones": markdown(
            ("", "measure", "real, median", "deviation", "simulated, median", "away, deviations"), medians
        ),
        "Measures of 8 within one deviation, mean and 10 to 90 %": markdown(
            ("", "a simulated picture", "a real figure that is left out"), counts
        ),
    }


def draw(columns: dict[str, list[FloatArray]], path: Path) -> None:
    """Draw pictures side by side, a row each class."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.2 * max(map(len, columns.values())), 2.4 * len(columns)), layout="constrained")
    for place, (title, shown) in enumerate(columns.items()):
        for n, level_db in enumerate(shown):
            axes = figure.add_subplot(len(columns), len(shown), place * len(shown) + n + 1)
            extent = (
                0.0,
                level_db.shape[1] * measures.HOP_SWEEPS * measures.PRI_S,
                -measures.EDGE_MPS,
                measures.EDGE_MPS,
            )
            axes.imshow(level_db, extent=extent, aspect="auto", vmin=measures.FLOOR_DB, vmax=measures.CEILING_DB)
            axes.set_title(title if n == 0 else "", fontsize=8)
    figure.savefig(path, dpi=80)


def main() -> None:
    """Read, measure, write and draw."""
    parser = make_parser(__doc__, data=f"folder with {DATA_FILE}", out="folder of the X-band study")
    parser.add_argument("--count", type=int, default=COUNT, help="synthetic images of a seed")
    options = parser.parse_args()
    quiet()
    real: dict[str, list[Row]] = {label: [] for label in CLASSES}
    made: dict[str, list[Row]] = {label: [] for label in CLASSES}
    drawn: dict[str, list[FloatArray]] = {f"{what} {label}": [] for label in CLASSES for what in ("real", "simulated")}
    for label, level_db, torso_mps in real_pictures(options.data):
        real[label].append(measure_picture(level_db, torso_mps))
        drawn[f"real {label}"].append(level_db)
    for seed in SEEDS:
        for label, level_db, torso_mps in simulated_pictures(seed, options.count, options.out):
            row = measure_picture(level_db, torso_mps)
            made[label].append(row)
            if any(resemble(row, one) for one in real[label]) and len(drawn[f"simulated {label}"]) < SHOWN:
                drawn[f"simulated {label}"].append(level_db)
    draw({title: shown[:SHOWN] for title, shown in drawn.items()}, options.out / "pictures.png")
    sections = compare(real, made)
    if options.page:
        name = f"../img/{Path(__file__).stem}.png"
        draw({title: shown for title, shown in drawn.items() if "simulated" in title}, EVIDENCE / name)
        sections["Simulated pictures like the real ones"] = f"![Simulated X-band pictures]({name})"
    finish(__file__, __doc__, sections, page=options.page)


if __name__ == "__main__":
    main()
