"""Write the gallery, six worked cases with their figures: python -m docs.gallery [folder]

Each case explains or diagnoses a pair of simulated scans, and its words have the numbers that came
out. The page is gallery.md of the folder, by default docs/, its figures lie in figures/gallery/.
"""

import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np

import icpshap
from icpshap import registrations, se3
from icpshap.causes import CAUSES
from icpshap.data import simulate
from icpshap.report.figures import style

DOCS = Path(__file__).parent
FIGURES = "figures/gallery"
SEED = 1
HEAD = """\
# Gallery

<!-- Made by `python -m docs.gallery`; do not edit. -->

Six pairs of scans, what came out of each, and what it teaches. All are simulated. So the true pose
is known, and `python -m docs.gallery` makes this page again anywhere, figures and numbers. φ is a
cause's Shapley value of f [nats], in brackets its 95 % interval; what they are: [the
method](method.md). σ is sensor noise, s the scale of the initial pose, λ partial overlap.
"""


class Case(NamedTuple):
    """A title, the scans and the question, the function that works it out, what it teaches."""

    title: str
    scans: str
    made: Callable  # returns sentences and a figure of matplotlib
    teaches: str


def scans(scene, beams, number=2, **options):
    """The first scans of a scene, and T_reference_source of the first two."""
    poses = simulate.simulate_poses(scene, number, SEED)
    clouds = [
        simulate.simulate_scan(scene, k, poses[k], beams, SEED, **options) for k in range(number)
    ]
    return clouds, [se3.inverse(a) @ b for a, b in pairwise(poses)]


def shares(explained):
    """The Shapley value of each cause, as a sentence."""
    told = [f"{CAUSES[row.Index].title} {_value(row)}" for row in explained.shapley.itertuples()]
    return f"φ: {', '.join(told)}."


def _value(row):
    if np.isnan(row.low):
        return f"{row.value:.2f} (no interval: nothing varies)"
    return f"{row.value:.2f} [{row.low:.2f}, {row.high:.2f}]"


def papers_pair():
    (reference, source), (T,) = scans("apartment", 36_700)
    explained = icpshap.explain(
        reference,
        source,
        T,
        causes={"sensor_noise": 0.05, "initial_pose": 1.5, "partial_overlap": 0.05},
        estimator={"based_on": "paper", "subsampling_probability": 0.25},
        seed=SEED,
    )
    return [explained.sentence, shares(explained)], explained.plot("waterfall")


def spinning_pair():
    (reference, source), (T,) = scans("apartment", 28_800, rings=16)
    explained = icpshap.explain(
        reference,
        source,
        T,
        register=registrations.small_gicp,
        estimator={"runs": 60},
        seed=SEED,
    )
    return (
        [
            f"{explained.success_rate:.0%} of its runs succeed. {explained.sentence}",
            shares(explained),
        ],
        explained.plot("waterfall"),
    )


def two_basins():
    generator = np.random.default_rng(7)

    def doors(places):
        boxes = [((-5, -2, z), (5, 2, z)) for z in (-1, 1.5)]
        boxes += [((-5, y, -1), (5, y, 1.5)) for y in (-2, 2)]
        boxes += [((x, -2, -1), (x, -1, 1)) for x in places]
        numbers = [2000] * 4 + [400] * len(places)
        points = [generator.uniform(*box, (n, 3)) for box, n in zip(boxes, numbers, strict=True)]
        points = np.concatenate(points)
        return points + 0.01 * generator.standard_normal(points.shape)

    explained = icpshap.explain(
        doors([-2.0, -2.6]),
        doors([-2.0]),
        np.eye(4),
        causes={"sensor_noise": 0.02, "initial_pose": 6, "partial_overlap": 0.05},
        estimator={"based_on": "lidar", "voxel_size": 0.1, "kept_links": 1.0},
        perturbation={"initial_pose_rotation": 2},
    )
    share = explained.wrong_basin.loc["initial_pose", "value"]
    return [
        f"{explained.wrong_basin_share:.0%} of the runs with all causes on end on the wrong door; "
        f"{share:.0%} of the runs do so because of the initial pose, as the Shapley values of that "
        "share say.",
        f"Of f, which leaves those runs out, {shares(explained)}",
    ], explained.plot("scene")


def corridor():
    (reference, source), (T,) = scans("corridor", 40_000, rings=32)
    explained = icpshap.explain(
        reference,
        source,
        T,
        causes={"sensor_noise": 0.02, "initial_pose": 1.5, "under_constrained": 0.9},
        seed=SEED,
    )
    weakest = explained.weakest_direction.words
    return [explained.sentence, f"Weakest direction: {weakest}.", shares(explained)], (
        explained.plot("directions")
    )


def noisy_scanner():
    clouds, poses = scans("apartment", 40_000, number=3, rings=32)
    noise = np.random.default_rng(SEED)
    noisy = [cloud + 0.04 * noise.standard_normal(cloud.shape) for cloud in clouds[:2]]
    pairs = [(*clouds[:2], poses[0]), (*clouds[1:], poses[1])]
    found = icpshap.diagnose(*noisy, poses[0], healthy=pairs)
    explained = icpshap.explain(*noisy, poses[0], what_if=True, seed=SEED)
    return [
        f"Its diagnosis: {found.sentence}",
        f"Explained as it is: {explained.sentence}",
        *explained.advice,
    ], explained.plot("waterfall")


def estimators():
    (reference, source), (T,) = scans("hall", 30_000, rings=32)
    asked = {
        "ICP runs (lidar)": {"estimator": "lidar"},
        "closed form": {"estimator": "closed_form"},
        "Hessian of GICP": {"estimator": "gicp"},
        "small_gicp": {"register": registrations.small_gicp, "estimator": {"runs": 60}},
    }
    found = {
        name: icpshap.explain(reference, source, T, seed=SEED, **options)
        for name, options in asked.items()
    }
    figure, axes = plt.subplots(figsize=(style.PAGE, 3), layout="constrained")
    for place, explained in enumerate(found.values()):
        for shift, row in enumerate(explained.shapley.itertuples()):
            cause, across = CAUSES[row.Index], place + 0.25 * (shift - 1)
            label = cause.title if place == 0 else None
            axes.bar(across, row.value, 0.22, color=cause.colour, label=label)
            axes.vlines(across, row.low, row.high, color="black", linewidth=1)
    axes.axhline(0, color="black", linewidth=0.5)
    axes.set(ylabel="φ [nats]", xticks=range(len(found)), xticklabels=list(found))
    axes.legend(frameon=False)
    plt.close(figure)
    return [f"{name}: {shares(explained)}" for name, explained in found.items()], figure


CASES = {
    "papers_pair": Case(
        "The paper's pair",
        "Two scans of an apartment by a tilting scanner, registered and perturbed as in the "
        "paper: σ 0.05 m, s 1.5, λ 0.05, with a quarter of the points in each run.",
        papers_pair,
        "Read the first sentence first. Here it says that with the paper's loose stop one clean "
        "run in eight ends before it arrives; f then counts in units of where the iteration "
        "stops. Read an interval before a rank: a cause whose interval holds zero cannot be told "
        "from no cause.",
    ),
    "spinning_pair": Case(
        "A spinning pair with small_gicp",
        "Two scans of the apartment by a spinning scanner of 16 rings. What is explained is "
        "small_gicp, at σ 0.02 m, s 1.5 and λ 0.05.",
        spinning_pair,
        "Any registration can be explained that is a function of two clouds and a start. Look "
        "first at how many runs succeed.",
    ),
    "two_basins": Case(
        "Two basins",
        "A bare corridor. The reference shows two doors 0.6 m apart, the source only one of them, "
        "so a run can end with that door on the wrong one. σ is 0.02 m, s 6 and λ 0.05.",
        two_basins,
        "A covariance describes one basin. How often runs end elsewhere is another question, and "
        "has Shapley values of its own.",
    ),
    "corridor": Case(
        "A corridor",
        "Two scans of a corridor by a spinning scanner of 32 rings, at σ 0.02 m and s 1.5. The "
        "third cause removes the points that hold the weakest direction, until 0.9 of its "
        "information is gone.",
        corridor,
        "Uncertainty has a direction. The shares of the causes differ from axis to axis.",
    ),
    "noisy_scanner": Case(
        "A noisy scanner",
        "Two scans of the apartment by a spinning scanner of 32 rings, with 4 cm of noise added "
        "to both. The same scans without that noise, and a third one, are the healthy pairs.",
        noisy_scanner,
        "A diagnosis says what is wrong with these scans. An explanation says what would hurt if "
        "it got worse. `what_if` says which change of the settings helps.",
    ),
    "estimators": Case(
        "One pair, four estimators",
        "Two scans of a hall by a spinning scanner of 32 rings, at σ 0.02 m, s 1.5 and λ 0.05, "
        "explained by four estimators.",
        estimators,
        "f is in units of each estimator's own clean spread: compare ranks and signs, not "
        "heights. An estimator that starts at the true pose, such as a closed form, cannot see "
        "the initial pose.",
    ),
}


def write(folder, names=tuple(CASES)):
    """Write the page and the figures of some cases."""
    places = Path(folder) / FIGURES
    places.mkdir(parents=True, exist_ok=True)
    parts = [HEAD]
    for name in names:
        case = CASES[name]
        sentences, figure = case.made()
        figure.savefig(places / f"{name}.png", dpi=120, metadata={"Software": None})
        code = f"[`{case.made.__name__}`](gallery.py)"
        parts += [
            f"## {case.title}\n",
            f"{case.scans}\n",
            f"![{case.title}]({FIGURES}/{name}.png)\n",
            *(f"{sentence}\n" for sentence in sentences),
            f"*What it teaches.* {case.teaches} Code: {code}.\n",
        ]
    (Path(folder) / "gallery.md").write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    write(*sys.argv[1:2] or [DOCS])
