"""Train on synthetic X-band images, test on 21 real ones, five seeds.

    python studies/sim_to_real_xband.py RADAR_DATA OUT [--count N] [--ablations] [--quick]

RADAR_DATA holds ``fmcw_xband_manga/decoded_levels.npz`` (:mod:`xband_measures`): 7 people, 4 dogs, 5 horses, 5 cows.

Protocol. Earlier plans were tested on the same images; their scores are in ``docs/sim-to-real.md``. What this plan has
otherwise (more images, motions of the models alone, no stretched axis) was settled by held synthetic rows and physics:

1. Each of five seeds makes its own synthetic images, by :class:`sim_to_real_xband_images.Plan` as it stands, and
   trains on them. One law for all classes in speed, direction, range, cross section, noise and ground. A fifth of the
   targets is held back. Scores are ranges over the seeds.
2. A real image enters whole and as it is. Real and synthetic images pass the same functions.
3. The model is the package's ensemble: the mean of the calibrated log-odds of extended-logistic, extended-boosting and
   the network. Its members, six features, speed alone and chance are reported next to it. The network's settings are
   those of :mod:`sim_to_real_models`. No real image trains, stops, calibrates, ranks or sets a threshold.
4. Two protocols. ``people and dogs``: two classes; horses and cows are unknown. ``with large quadrupeds``: horses and
   cows of the gait model are a third class. Both are trained on the same images of people and dogs.
5. Decisions by :data:`RULES`, all reported. Thresholds are those of the package (p = 0.8) or shares of held synthetic
   rows (95 % kept by the novelty score; 5 % of the held animals called human). The rule of the package, p and novelty
   together, is the one that counts.
6. Unknown kinds for the open-set scores are synthetic too: a person with a dog, a person who stands and waves and, for
   models that know people and dogs, large quadrupeds. They choose nothing here.
7. The first scores stand.

No protocol makes these images unseen: the display of the sensor model, floor and fluctuation were once chosen while
looking at eight of them (``xband_sensor``), and whoever wrote the plan knew that figure and the scores of earlier
plans.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt
import sim_to_real_inputs as store
import sim_to_real_models as models
import sim_to_real_tables as tables
import sim_to_real_xband_images as images
import xband_measures as measures
from sim_to_real_inputs import Inputs
from sim_to_real_xband_images import Display, Plan
from xband_gait import DATA_FILE
from xband_measures import FloatArray

from doppelgait.classify.model import ABSTAIN_BELOW
from doppelgait.classify.scores import auc

IntArray = npt.NDArray[np.int64]

SEEDS = (1, 2, 3, 4, 5)
COUNT, QUICK = 1200, 30
PROTOCOLS: dict[str, tuple[str, ...]] = {
    "people and dogs": ("human", "dog"),
    "with large quadrupeds": ("human", "dog", "large"),
}
UNKNOWN, UNKNOWN_COUNT = Plan(kinds=("pair", "waving"), seed=900), 150
KEPT = 0.95
"""Share of the held synthetic rows on the known side of the novelty threshold."""
FALSE_PEOPLE = 0.05
"""Share of the held synthetic animals that may be called human by the rule of that name."""
ABSTAINED = -1
REPORT = "sim-to-real-xband.md"
ABLATED, ABLATED_SEEDS = 150, (1, 2, 3)
ABLATIONS: dict[str, tuple[Plan, Display]] = {
    "nothing": (Plan(), Display()),
    "sizes, gaits, changes of speed": (Plan(gait_variation=False), Display()),
    "speckle": (Plan(speckle=False), Display()),
    "reflection from the ground": (Plan(bounce=False), Display()),
    "variety of cross sections": (Plan(rcs_random=False), Display()),
    "ground echo": (Plan(), Display(ground=False)),
    "noise": (Plan(), Display(noise=False)),
    "noise and clipping of levels": (Plan(), Display(noise=False, clipped=False)),
    "added: variation of the motion": (Plan(motion_variation=True), Display()),
    "added: companions": (Plan(groups=0.25), Display()),
}


@dataclass(frozen=True)
class Size:
    """Size of a run.

    Examples a seed, seeds, unknown examples, ablations, and whether networks are trained.
    """

    count: int = COUNT
    seeds: tuple[int, ...] = SEEDS
    unknown: int = UNKNOWN_COUNT
    network: bool = True
    ablations: tuple[str, ...] = ()


@dataclass(frozen=True)
class Scored:
    """Answers of the models of one seed.

    Parameters
    ----------
    held_accuracy : dict
        By model: balanced, of the held synthetic targets.
    probability : dict
        By model: of the real images, shape (n, n_classes).
    parts : dict
        By set (``real``, ``held``, and unknown kinds): probabilities of the ensemble and novelty (n,), in columns.
    held : ndarray of int
        Classes of the held rows.
    """

    held_accuracy: dict[str, float]
    probability: dict[str, FloatArray]
    parts: dict[str, FloatArray]
    held: IntArray

    def decide(self, name: str, rule: str) -> IntArray:
        """Return the class of every row of a set, or :data:`ABSTAINED`."""
        probability, novelty = self.parts[name][:, :-1], self.parts[name][:, -1]
        chosen = probability.argmax(axis=1)
        return np.where(RULES[rule](self, probability, novelty), ABSTAINED, chosen)


Rule = Callable[[Scored, FloatArray, FloatArray], npt.NDArray[np.bool_]]


def unsure(scored: Scored, probability: FloatArray, novelty: FloatArray) -> npt.NDArray[np.bool_]:
    """Abstain where the likeliest class is below the package's threshold."""
    return np.asarray(probability.max(axis=1) < ABSTAIN_BELOW)


def novel(scored: Scored, probability: FloatArray, novelty: FloatArray) -> npt.NDArray[np.bool_]:
    """Abstain beyond the novelty of most held rows."""
    return np.asarray(novelty > np.quantile(scored.parts["held"][:, -1], KEPT))


def rarely_human(scored: Scored, probability: FloatArray, novelty: FloatArray) -> npt.NDArray[np.bool_]:
    """Abstain from people that too many held animals resemble."""
    animals = scored.parts["held"][scored.held != 0, 0]
    least = np.quantile(animals, 1.0 - FALSE_PEOPLE)
    return np.asarray((probability.argmax(axis=1) == 0) & (probability[:, 0] < least))


RULES: dict[str, Rule] = {
    "none": lambda scored, probability, novelty: np.zeros(novelty.size, dtype=bool),
    f"p < {ABSTAIN_BELOW:g}": unsure,
    f"novelty, {KEPT:.0%} kept": novel,
    "p and novelty": lambda *given: unsure(*given) | novel(*given),
    f"{FALSE_PEOPLE:.0%} of held-out animals human": rarely_human,
    "that and novelty": lambda *given: rarely_human(*given) | novel(*given),
}


def real_images(data: Path) -> dict[str, FloatArray]:
    """Read the levels of all real images in dB by key."""
    return measures.read_levels(data / DATA_FILE)


def real_inputs(found: dict[str, FloatArray]) -> Inputs:
    """Convert real images to model inputs, all treated alike."""
    labels = [key.split("__")[0] for key in found]
    return images.inputs_of_levels(list(found.values()), labels, [models.REAL + key for key in found])


def score_seed(made: Inputs, real: Inputs, unknown: Inputs, *, protocol: str, seed: int, network: bool) -> Scored:
    """Train on the images of a seed and score the other images."""
    classes = PROTOCOLS[protocol]
    taught = made.take(np.isin(made.labels, classes))
    fitted = models.train_all(taught, images.PATCH, classes=classes, seed=seed, network=network)
    held = models.held_rows(taught)
    judge = models.novelty_of(fitted, taught.take(~held), taught.take(held))
    sets = {"real": real, "held": taught.take(held)}
    sets |= {str(kind): unknown.take(unknown.labels == kind) for kind in np.unique(unknown.labels)}
    left = sorted(set(made.labels.tolist()) - set(classes))
    sets |= {kind: made.take(made.labels == kind) for kind in left}
    ensemble = fitted["ensemble"]
    return Scored(
        {name: one.held_accuracy for name, one in fitted.items()},
        {name: one.probability(real) for name, one in fitted.items()},
        {name: np.column_stack([ensemble.probability(part), judge(part)]) for name, part in sets.items()},
        models.numbers_of(sets["held"].labels, classes),
    )


def kept_scores(path: Path, make: Callable[[], Scored]) -> Scored:
    """Load the answers of a seed, or make and write them."""

    def arrays() -> store.Arrays:
        found = make()
        fields = {f"held_accuracy/{key}": np.array(value) for key, value in found.held_accuracy.items()}
        fields |= {f"probability/{key}": value for key, value in found.probability.items()}
        fields |= {f"parts/{key}": value for key, value in found.parts.items()}
        return {**fields, "held": found.held}

    stored = store.kept(path, arrays)

    def under(name: str) -> dict[str, npt.NDArray[np.float64]]:
        return {key.split("/")[1]: values for key, values in stored.items() if key.startswith(f"{name}/")}

    accuracy = {key: float(value) for key, value in under("held_accuracy").items()}
    return Scored(accuracy, under("probability"), under("parts"), stored["held"])


def spread(values: Iterable[float], digits: int = 2) -> str:
    """Format the mean of some seeds, the lowest and the highest."""
    found = np.array(list(values), dtype=np.float64)
    low, mean, high = (f"{number:.{digits}f}" for number in (found.min(), found.mean(), found.max()))
    return mean if low == high else f"{mean} ({low} to {high})"


def model_table(scored: list[Scored], labels: npt.NDArray[np.str_]) -> str:
    """Tabulate the scores of every model, all images decided."""
    person, dog = labels == "human", labels == "dog"
    other = ~(person | dog)
    rows = []
    for name in scored[0].probability:
        cells: list[list[float]] = []
        for one in scored:
            human = one.probability[name][:, 0]
            called = one.probability[name].argmax(axis=1) == 0
            balanced = 50.0 * (called[person].mean() + (~called)[dog].mean())
            ranking = [auc(human[person | wrong], person[person | wrong]) for wrong in (dog, other)]
            counts = [called[person].sum(), (~called)[dog].sum(), called[other].sum()]
            cells.append([100.0 * one.held_accuracy[name], *ranking, balanced, *counts])
        digits = (0, 2, 2, 0, 1, 1, 1)
        rows.append([name, *(spread(column, n) for column, n in zip(np.transpose(cells), digits, strict=True))])
    head = (
        "model", "held-out synthetic, balanced %", "AUC people, dogs", "AUC people, others",
        "people and dogs, balanced %", f"people right of {person.sum()}", f"dogs not called human of {dog.sum()}",
        f"others called human of {other.sum()}",
    )  # fmt: skip
    return tables.markdown(head, rows)


def rule_table(scored: list[Scored], labels: npt.NDArray[np.str_]) -> str:
    """Tabulate the decisions of the ensemble by rule.

    Of real images, of held rows and of unknown kinds.
    """
    person, dog = labels == "human", labels == "dog"
    other = ~(person | dog)
    kinds = [name for name in scored[0].parts if name not in ("real", "held")]
    rows = []
    for rule in RULES:
        cells = []
        for one in scored:
            found, held = one.decide("real", rule), one.decide("held", rule)
            lost = found == ABSTAINED
            counts = [
                (found == 0)[person].sum(), lost[person].sum(), (found == 1)[dog].sum(), (found == 0)[dog].sum(),
                lost[dog].sum(), (found == 0)[other].sum(), lost[other].sum(),
            ]  # fmt: skip
            shares = [100.0 * (held != ABSTAINED).mean()]
            shares += [100.0 * (one.decide(kind, rule) == 0).mean() for kind in kinds]
            cells.append([*counts, *shares])
        digits = [1] * 7 + [0] * (1 + len(kinds))
        rows.append([rule, *(spread(column, n) for column, n in zip(np.transpose(cells), digits, strict=True))])
    head = (
        "abstention", f"people right of {person.sum()}", "people abstained", f"dogs right of {dog.sum()}",
        "dogs called human", "dogs abstained", f"others called human of {other.sum()}", "others abstained",
        "held-out synthetic decided %", *(f"{kind} called human %" for kind in kinds),
    )  # fmt: skip
    return tables.markdown(head, rows)


def novelty_table(scored: list[Scored]) -> str:
    """Tabulate AUC of novelty and of 1 - p for unknown kinds."""
    kinds = [name for name in scored[0].parts if name not in ("real", "held")]
    rows = []
    for name in kinds:
        cells = []
        for one in scored:
            known, unknown = one.parts["held"], one.parts[name]
            positive = np.repeat([False, True], [len(known), len(unknown)])
            both = np.concatenate([known, unknown])
            cells.append([auc(both[:, -1], positive), auc(1.0 - both[:, :-1].max(axis=1), positive)])
        rows.append([name, *(spread(column) for column in np.transpose(cells))])
    return tables.markdown(("unknown kind", "AUC of novelty", "AUC of 1 - p"), rows)


def image_table(keys: list[str], scored: dict[str, list[Scored]]) -> str:
    """Tabulate the ensemble's probabilities and decisions by image."""
    rows = []
    for number, key in enumerate(keys):
        cells: list[object] = [key.replace("__", " ")]
        for seeds in scored.values():
            cells.append(spread(one.parts["real"][number, 0] for one in seeds))
            found = [int(one.decide("real", "p and novelty")[number]) for one in seeds]
            cells.append(f"{found.count(0)}, {found.count(ABSTAINED)}")
        rows.append(cells)
    head = [f"{name}: {what}" for name in scored for what in ("p of a person", "human, abstained")]
    return tables.markdown(("image", *head), rows)


def ablation_table(size: Size, real: Inputs, out: Path) -> str:
    """Tabulate domain AUC with one switch left out or added."""
    ours = real.take(np.isin(real.labels, PROTOCOLS["people and dogs"]))
    rows = []
    for name in size.ablations:
        plan, display = ABLATIONS[name]
        found = []
        for seed in size.seeds[: len(ABLATED_SEEDS)]:
            made = images.dataset(replace(plan, seed=seed), min(ABLATED, size.count), out, display=display)
            made = made.take(np.isin(made.labels, PROTOCOLS["people and dogs"]))
            found.append(models.domain_auc(made, ours, features="extended"))
        rows.append([name, spread(found)])
    return tables.markdown(("left out or added", "domain AUC, people and dogs"), rows)


def main(data: Path, out: Path, size: Size) -> dict[str, list[Scored]]:
    """Simulate, train, test and write."""
    write = tables.Writer(out / REPORT)
    found = real_images(data)
    out.mkdir(parents=True, exist_ok=True)
    real = real_inputs(found)
    unknown = images.dataset(UNKNOWN, size.unknown, out)
    digest = zlib.crc32(b"".join(level_db.tobytes() for level_db in found.values()))
    made = {seed: images.dataset(Plan(seed=seed), size.count, out) for seed in size.seeds}
    parts = [f"# X-band: {size.count} synthetic images a seed, seeds {', '.join(map(str, size.seeds))}"]
    scored: dict[str, list[Scored]] = {}
    for protocol in PROTOCOLS:
        scored[protocol] = []
        for seed in size.seeds:
            counts = (size.count, size.unknown, size.network)
            key = store.key_of(models.SETTINGS, images.PATCH, Plan(seed=seed), counts, protocol, digest)
            make = partial(score_seed, made[seed], real, unknown, protocol=protocol, seed=seed, network=size.network)
            scored[protocol].append(kept_scores(out / "cache" / f"xband-scores-{key}.npz", make))
        parts += [
            f"## Protocol: {protocol}", model_table(scored[protocol], real.labels),
            rule_table(scored[protocol], real.labels), novelty_table(scored[protocol]),
        ]  # fmt: skip
        write(parts)
    parts.append("## Images\n\n" + image_table(list(found), scored))
    known = real.labels != ""
    both = np.isin(real.labels, PROTOCOLS["people and dogs"])
    lines = []
    for name, chosen, kinds in (("all", known, ("human", "dog", "large")), ("people and dogs", both, ("human", "dog"))):
        seeds = [one.take(np.isin(one.labels, kinds)) for one in made.values()]
        cells = [
            spread(models.domain_auc(one, real.take(chosen), features=of) for one in seeds)
            for of in ("six", "extended")
        ]
        lines.append([name, *cells])
    parts.append("## Real against synthetic\n\n" + tables.markdown(("domain AUC", "six", "all features"), lines))
    parts.append(tables.gap_table(store.joined(list(made.values())), real, "extended"))
    write(parts)
    if size.ablations:
        parts.append(ablation_table(size, real, out))
        write(parts)
    return scored


if __name__ == "__main__":
    parser = tables.make_parser(__doc__, str(DATA_FILE), COUNT, "images a seed")
    parser.add_argument("--ablations", action="store_true", help="also leave out the parts of the simulation in turn")
    arguments = parser.parse_args()
    chosen = tuple(ABLATIONS) if arguments.ablations else ()
    whole = Size(arguments.count, ablations=chosen)
    quick = Size(QUICK, SEEDS[:2], QUICK, network=False, ablations=("nothing", "ground echo"))
    main(arguments.data, arguments.out, quick if arguments.quick else whole)
    print((arguments.out / REPORT).read_text(encoding="utf-8"))
