"""What lies behind the numbers of one pair: its scans, and the poses that ICP ended in.

A picture for paper and report, and an interactive page. Both show the source moved to the true pose
and the pose errors xi of the clean and of one perturbed setting.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.patches import Ellipse

from icpshap import se3
from icpshap.causes import named
from icpshap.data.pair import Pair
from icpshap.estimators.kind import GOOD_STATUS
from icpshap.explanation.sample import mark_wrong_basins
from icpshap.report import words
from icpshap.report.figures.style import FAINT, MUTED, PAGE, styled
from icpshap.tables import INITIAL_XI, XI

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from icpshap.causes.cause import Cause
    from icpshap.explanation.method import Method
    from icpshap.report.study import Study


REFERENCE, OVERLAPPING, ALONE, REMOVED = "#9A9A9A", "#0072B2", "#88CCEE", "#D55E00"
INITIAL, CLEAN, PERTURBED = "#BBBBBB", "#0072B2", "#D55E00"
# Half width, in standard deviations, of what holds 95 % of a Gaussian in 2 and 3 dimensions.
PLANE_95, SPACE_95 = np.sqrt(5.991), np.sqrt(7.815)
# Points of a cloud that a page holds at most, so that it stays small and turns smoothly.
PAGE_POINTS = 25_000
NO_SAMPLES = "The estimator returns no pose samples."
TOO_FEW = "Too few runs are left to show."
NOT_REGISTERED = "This pair was not registered."
FEWEST = 2  # poses of which a picture can show how they vary


@dataclass(frozen=True)
class Scene:
    """A pair of scans, the points that stay in them, and the poses of two settings.

    kept_reference (n,) and kept_source (m,) mark the raw points that the causes leave; clean and
    perturbed: rows of a runs table that did not fail, with a column `wrong_basin`; values: the
    perturbation; no_poses: why there are none to show, "" where there are.
    """

    pair: Pair
    kept_reference: np.ndarray
    kept_source: np.ndarray
    clean: pd.DataFrame
    perturbed: pd.DataFrame
    values: Mapping[str, float]
    no_poses: str

    @property
    def removing(self) -> list[type[Cause]]:
        """The causes that are on and remove points of either scan."""
        return [cause for cause in self.on(named(self.values)) if cause.hook() == "keep"]

    def on(self, players: Iterable[type[Cause]]) -> list[type[Cause]]:
        """Those of the causes that are on."""
        return [c for c in players if self.values.get(c.name, c.off) != c.off]


def make_scene(
    pair: Pair,
    kept_reference: np.ndarray,
    kept_source: np.ndarray,
    runs: pd.DataFrame | None,
    values: Mapping[str, float],
    method: Method,
    length: float,
) -> Scene:
    """The `Scene` of a data.pair.Pair.

    kept_reference, kept_source: masks (n,), (m,) of the raw rows that the causes leave at `values`,
    a level for each cause of the experiment; runs: the pair's runs table, None if the estimator
    returns no samples; method: explanation.method.Method, which says what a wrong basin is, with
    the pair's characteristic length [m].
    """
    if runs is None:
        nothing = pd.DataFrame()
        return Scene(pair, kept_reference, kept_source, nothing, nothing, values, NO_SAMPLES)
    first = runs[~runs.again & (runs.replicate == 0)]
    off = {cause.name: cause.off for cause in named(values)}
    clean, perturbed = (_marked(_at(first, levels), method, length) for levels in (off, values))
    no_poses = "" if min(len(clean), len(perturbed)) >= FEWEST else TOO_FEW
    if len(runs) == 0:
        no_poses = NOT_REGISTERED
    return Scene(pair, kept_reference, kept_source, clean, perturbed, values, no_poses)


def _at(runs, values):
    """The runs of one setting."""
    return runs[np.all([np.isclose(runs[name], level) for name, level in values.items()], axis=0)]


def _marked(runs, method, length):
    if len(runs) == 0:
        return runs.assign(wrong_basin=False)
    marked = runs.assign(wrong_basin=mark_wrong_basins(runs, method, length))
    return marked[marked.status.isin(GOOD_STATUS)]


# --- captions -------------------------------------------------------------------------------------


def caption(scene: Scene, study: Study, row: Any) -> str:
    """What the picture shows; study: `study.Study`; row of a pairs table."""
    sentences = [
        f"{study.pair(row)}. Scans at the true pose, seen from above: {_scans(scene, study, row)}"
    ]
    if not scene.no_poses:
        sentences += [
            _poses(scene, study, "ellipses"),
            "The right of each two panels is a close-up of the clean results.",
            f"Crosses are {study.repeats} in a wrong basin: {_wrong_basins(scene)}.",
        ]
    return " ".join([*sentences, *_remarks(scene, row)])


def page_caption(scene: Scene, study: Study, row: Any) -> str:
    """What the page shows; study: `study.Study`; row of a pairs table."""
    sentences = [f"Scans at the true pose: {_scans(scene, study, row)}"]
    if not scene.no_poses:
        sentences += [
            _poses(scene, study, "ellipsoids"),
            f"Diamonds are {study.repeats} in a wrong basin: {_wrong_basins(scene)}.",
        ]
    usage = "Drag to turn, scroll to zoom, click on a name to hide it."
    return " ".join([*sentences, *_remarks(scene, row), usage])


def _scans(scene, study, row):
    shown = f"reference, source where it overlaps (overlap ratio {row.overlap:.2f}) and elsewhere"
    removing = [f"{c.title} {words.level(c, scene.values[c.name])}" for c in scene.removing]
    if not removing:
        return f"{shown}."
    verb = "remove" if len(removing) > 1 else "removes"
    again = any(c.drawn and not c.drawn_once for c in scene.removing) and study.noise_draws > 1
    which = f" in the first of {study.noise_draws} noise draws" if again else ""
    return f"{shown}, and the points that {words.listed(removing)} {verb}{which}."


def _poses(scene, study, shapes):
    on = scene.on(study.players)
    return (
        f"Pose errors of {len(scene.clean)} {study.repeats}, estimator {study.estimator}: initial "
        f"poses, clean results, and results at {words.describe_values(scene.values, on)}, "
        f"with {shapes} that hold 95 % of a Gaussian of the same covariance."
    )


def _wrong_basins(scene):
    return f"{scene.clean.wrong_basin.sum()} clean, {scene.perturbed.wrong_basin.sum()} perturbed"


def _remarks(scene, row):
    remarks = [("Not registered", row.reason), ("Warning", row.warning)]
    without = [scene.no_poses] if scene.no_poses in (NO_SAMPLES, TOO_FEW) else []
    return [*without, *(f"{kind}: {remark.rstrip('.')}." for kind, remark in remarks if remark)]


# --- the picture ----------------------------------------------------------------------------------


def picture(scene: Scene) -> Figure:
    """Scans from above, and pose errors in translation and rotation, as a Figure."""
    with styled():
        figure = plt.figure(figsize=(PAGE, 6.2))
        parts = figure.subfigures(2, height_ratios=(1.5, 1), squeeze=False)
        above, below = parts[:, 0]
        _draw_scans(above, scene)
        if scene.no_poses:
            below.text(0.5, 0.5, scene.no_poses, ha="center", color=MUTED)
            return figure
        panels = below.subplots(1, 4)
        _draw_poses(panels[:2], scene, slice(3, 6), 100, "translation", "xyz", "cm")
        _draw_poses(panels[2:], scene, slice(0, 3), np.rad2deg(1), "rotation", "xyz", "deg")
        handles, labels = panels[0].get_legend_handles_labels()
        below.legend(handles, labels, loc="outside lower center", ncols=5)
    return figure


def _draw_scans(figure, scene):
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    limits = np.quantile(scene.pair.reference[:, :2], [0.005, 0.995], axis=0)
    parts = clouds(scene)
    for axes, names in zip(panels, (list(parts)[:3], list(parts)[1:]), strict=True):
        for name in names:
            points, colour = parts[name]
            axes.scatter(
                *points[:, :2].T,
                s=0.6 if name.startswith("removed") else 0.3,
                color=colour,
                linewidths=0,
                rasterized=True,
                label=name,
            )
        axes.set_aspect("equal")
        axes.set_xlim(limits[:, 0] + [-0.5, 0.5])
        axes.set_ylim(limits[:, 1] + [-0.5, 0.5])
        axes.set_xlabel("x of the reference [m]")
    panels[0].set_ylabel("y of the reference [m]")
    # Once for both panels, and below them: within them points would lie behind it.
    handles = {
        name: handle
        for axes in panels
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    place = {"loc": "outside lower center", "ncols": 4, "handletextpad": 0.1}
    legend = figure.legend(handles.values(), handles, **place)
    for handle in legend.legend_handles:
        handle.set_sizes([12])


def clouds(scene: Scene) -> dict[str, tuple[np.ndarray, str]]:
    """Name: (points (k, 3) [m] in the reference's frame, colour)."""
    reference = scene.pair.reference
    source = se3.transform(scene.pair.T_reference_source, scene.pair.source)
    overlapping, kept = scene.pair.overlapping, scene.kept_source
    parts = {
        "reference": (reference[scene.kept_reference], REFERENCE),
        "source alone": (source[~overlapping & kept], ALONE),
        "source overlapping": (source[overlapping & kept], OVERLAPPING),
    }
    if scene.removing:
        removed = np.vstack([reference[~scene.kept_reference], source[~kept]])
        name = f"removed by {words.listed([cause.title for cause in scene.removing])}"
        parts[name] = (removed, REMOVED)
    return parts


class Poses(NamedTuple):
    """Pose errors xi (k, 6) [rad, m] of runs (k,), and what a picture shows of them.

    number, wrong, weight (k,): which run, whether in a wrong basin, and how much it counts.
    """

    xi: np.ndarray
    number: np.ndarray
    wrong: np.ndarray
    weight: np.ndarray
    colour: str

    @classmethod
    def of(
        cls, runs: pd.DataFrame, columns: list[str], wrong: np.ndarray | pd.Series, colour: str
    ) -> Poses:
        number, weight = runs["run"].to_numpy(), runs["weight"].to_numpy()
        return cls(runs[columns].to_numpy(), number, np.asarray(wrong), weight, colour)


def poses(scene: Scene) -> dict[str, Poses]:
    """The `Poses` of the scene by their names."""
    clean, perturbed = scene.clean, scene.perturbed
    nowhere = np.zeros(len(perturbed), dtype=bool)
    return {
        "initial pose": Poses.of(perturbed, INITIAL_XI, nowhere, INITIAL),
        "perturbed": Poses.of(perturbed, XI, perturbed["wrong_basin"], PERTURBED),
        "clean": Poses.of(clean, XI, clean["wrong_basin"], CLEAN),
    }


def _draw_poses(panels, scene, part, scale, title, names, unit):
    """Overview and close-up in the two coordinates in which the perturbed results vary most."""
    drawn = {name: (scale * shown.xi[:, part], shown) for name, shown in poses(scene).items()}
    a, b = np.sort(np.argsort(drawn["perturbed"][0].var(axis=0))[1:])
    for axes in panels:
        for name, (values, shown) in drawn.items():
            _scatter(axes, values[:, [a, b]], shown, name)
        axes.axhline(0, color=FAINT, linewidth=0.5, zorder=-1)
        axes.axvline(0, color=FAINT, linewidth=0.5, zorder=-1)
        axes.set_xlabel(f"{title} {names[a]} [{unit}]")
    panels[0].set_ylabel(f"{title} {names[b]} [{unit}]")
    panels[0].set_aspect("equal", adjustable="datalim")
    clean, shown = drawn["clean"]
    _close_up(panels[1], clean[:, [a, b]], shown.wrong)


def _scatter(axes, values, shown, name):
    """Values (k, 2) of `Poses` as dots, crosses for wrong basins, with their ellipse."""
    colour, wrong = shown.colour, shown.wrong
    if name == "initial pose":
        axes.plot(*values.T, "+", color=colour, markersize=3, label=name)
        return
    axes.plot(*values[~wrong].T, ".", color=colour, markersize=3, label=name)
    axes.plot(
        *values[wrong].T,
        "x",
        color=colour,
        markersize=3.5,
        markeredgewidth=0.8,
        label=f"{name}, wrong basin",
    )
    axes.add_patch(_ellipse(values, shown.weight, colour))


def _close_up(axes, values, wrong):
    """Limits about those of the values (k, 2) that are in no wrong basin, if there are any."""
    inside = values if wrong.all() else values[~wrong]
    centre = np.median(inside, axis=0)
    close = np.maximum(2 * np.quantile(np.abs(inside - centre), 0.95, axis=0), 1e-6)
    axes.set_xlim(centre[0] - close[0], centre[0] + close[0])
    axes.set_ylim(centre[1] - close[1], centre[1] + close[1])


def _gaussian(values, weight):
    """Mean (d,), variances (d,) and their directions (d, d) of values (k, d) with weights (k,)."""
    mean = weight @ values / weight.sum()
    centred = values - mean
    covariance = (weight * centred.T) @ centred / (weight.sum() - 1)
    variances, directions = np.linalg.eigh(covariance)
    return mean, np.maximum(variances, 0), directions


def _ellipse(values, weight, colour):
    """The ellipse that holds 95 % of a Gaussian with the covariance of values (k, 2)."""
    mean, variances, directions = _gaussian(values, weight)
    width, height = 2 * PLANE_95 * np.sqrt(variances)
    angle = np.rad2deg(np.arctan2(directions[1, 0], directions[0, 0]))
    return Ellipse(mean, width, height, angle=angle, fill=False, edgecolor=colour, linewidth=1)


# --- the page -------------------------------------------------------------------------------------


def thin(points: np.ndarray, most: int) -> np.ndarray:
    """Points (k, 3), one of each voxel, with voxels just large enough to leave at most `most`."""
    size = 0.02
    while len(points) > most:
        _, first = np.unique(np.floor(points / size), axis=0, return_index=True)
        points = points[np.sort(first)]
        size *= 1.5
    return points


# Where the three panels lie in the window, [x from, to], [y from, to]: beside one another where it
# is wide, the scans over both errors where it is high.
PLACES = {
    "wide": {
        "scene": ([0, 0.58], [0, 1]),
        "scene2": ([0.6, 1], [0.5, 1]),
        "scene3": ([0.6, 1], [0, 0.48]),
    },
    "high": {
        "scene": ([0, 1], [0.42, 1]),
        "scene2": ([0, 0.49], [0, 0.38]),
        "scene3": ([0.51, 1], [0, 0.38]),
    },
}
TITLES = {
    "scene": "scans at the true pose [m]",
    "scene2": "error in translation [cm]",
    "scene3": "error in rotation [deg]",
}
EYE = {"x": 1.25, "y": -1.25, "z": 1.2}

# Run by plotly's page; the layouts are written in before.
ARRANGE = """
const layouts = LAYOUTS, shown = document.getElementById('scene');
const arrange = () => Plotly.relayout(
    shown, layouts[window.innerWidth > window.innerHeight ? 'wide' : 'high']);
arrange();
window.addEventListener('resize', arrange);
"""
STYLE = """
body { height: 100vh; margin: 0; display: flex; flex-direction: column; overflow: hidden; }
body { font: 16px/1.4 system-ui, sans-serif; color: #222; }
h1 { font-size: 1.2rem; margin: .5rem 1rem 0; }
#window { flex: 1; position: relative; min-height: 0; }
#window > div { position: absolute; inset: 0; }
details { order: 1; margin: .3rem 1rem .5rem; font-size: .9rem; max-height: 25vh; overflow: auto; }
"""


def page(scene: Scene, title: str, text: str) -> str:
    """A self-contained HTML page that turns: scans, translation errors and rotation errors.

    It fills the window, and its panels change places with the window's shape.
    """
    import plotly.graph_objects as go

    figure = go.Figure(_cloud_traces(scene))
    if not scene.no_poses:
        parts = (("scene2", slice(3, 6), 100.0), ("scene3", slice(0, 3), np.rad2deg(1)))
        for panel, part, scale in parts:
            for name, shown in poses(scene).items():
                traces = _pose_traces(name, shown, scale * shown.xi[:, part], panel == "scene2")
                figure.add_traces([trace.update(scene=panel) for trace in traces])
    panels = ["scene"] if scene.no_poses else list(TITLES)
    figure.update_layout(
        {panel: {"aspectmode": "data", "camera": {"eye": EYE}} for panel in panels},
        legend={
            "orientation": "h",
            "itemsizing": "constant",
            # At the bottom: above, plotly's buttons would lie on it in a narrow window.
            "y": 0,
            "yanchor": "top",
            "font": {"size": 14},
        },
        margin={"l": 0, "r": 0, "b": 0, "t": 30},
        template="plotly_white",
        autosize=True,
    )
    figure.update_scenes(xaxis_title="x", yaxis_title="y", zaxis_title="z")
    layouts = {shape: _layout(places, panels) for shape, places in PLACES.items()}
    plot = figure.to_html(
        full_html=False,
        include_plotlyjs=True,
        div_id="scene",
        default_height="100%",
        config={"displaylogo": False, "responsive": True},
        post_script=ARRANGE.replace("LAYOUTS", json.dumps(layouts)),
    )
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{STYLE}</style></head>\n"
        f"<body><h1>{escape(title)}</h1>\n"
        # Before the plot, which measures what is left of the window, though it stands below.
        f"<details open><summary>What it shows</summary><p>{escape(text)}</p></details>\n"
        f'<div id="window">{plot}</div></body></html>\n'
    )


def _layout(places, panels):
    """Where the panels of a page lie, with their titles above them, as plotly's layout."""
    if len(panels) == 1:
        places = {"scene": ([0, 1], [0, 1])}
    layout: dict[str, Any] = {"annotations": []}
    for panel in panels:
        x, y = places[panel]
        layout[f"{panel}.domain"] = {"x": x, "y": y}
        place = {"x": sum(x) / 2, "y": y[1], "xref": "paper", "yref": "paper"}
        look = {"showarrow": False, "xanchor": "center", "yanchor": "top", "font": {"size": 15}}
        layout["annotations"].append({"text": TITLES[panel], **place, **look})
    return layout


def _cloud_traces(scene):
    import plotly.graph_objects as go

    traces = []
    for name, (points, colour) in clouds(scene).items():
        x, y, z = thin(points, PAGE_POINTS).astype(np.float32).T
        marker = {"size": 1.7 if name.startswith("removed") else 1.2, "color": colour}
        look = {"mode": "markers", "marker": marker, "hoverinfo": "skip"}
        traces.append(go.Scatter3d(x=x, y=y, z=z, name=escape(name), **look))
    return traces


def _pose_traces(name, shown, values, in_legend):
    """`Poses` of one name at values (k, 3): dots, diamonds for wrong basins, and an ellipsoid."""
    import plotly.graph_objects as go

    traces = []
    for rows, label, symbol in (
        (~shown.wrong, name, "circle"),
        (shown.wrong, f"{name}, wrong basin", "diamond"),
    ):
        if rows.any():
            x, y, z = values[rows].T
            traces.append(
                go.Scatter3d(
                    x=x,
                    y=y,
                    z=z,
                    mode="markers",
                    marker={"size": 3, "color": shown.colour, "symbol": symbol},
                    name=label,
                    legendgroup=label,
                    showlegend=in_legend,
                    customdata=shown.number[rows],
                    hovertemplate="%{customdata}: %{x:.2f}, %{y:.2f}, %{z:.2f}",
                )
            )
    if name != "initial pose":
        x, y, z = _ellipsoid(values, shown.weight)
        look = {"opacity": 0.15, "showscale": False, "hoverinfo": "skip"}
        colours = [[0, shown.colour], [1, shown.colour]]
        traces.append(go.Surface(x=x, y=y, z=z, colorscale=colours, name=f"{name}, 95 %", **look))
    return traces


def _ellipsoid(values, weight):
    """Surface (3, 24, 24) that holds 95 % of a Gaussian with the covariance of values (k, 3)."""
    mean, variances, directions = _gaussian(values, weight)
    azimuth, polar = np.meshgrid(np.linspace(0, 2 * np.pi, 24), np.linspace(0, np.pi, 24))
    sphere = np.array(
        [np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)]
    )
    axes = directions * (SPACE_95 * np.sqrt(variances))
    return np.einsum("ij,jkl->ikl", axes, sphere) + mean[:, None, None]
