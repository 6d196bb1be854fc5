"""What lies behind the numbers of one pair: its scans, and the poses that ICP ended in.

A picture for paper and report, and an interactive page. Both show the source moved to the true pose
and the pose errors xi of the clean and of one perturbed setting.
"""

from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.patches import Ellipse

from icpshap import se3
from icpshap.causes import SOURCES
from icpshap.estimators import perturb as perturbation
from icpshap.report import captions
from icpshap.report.figures.style import FAINT, MUTED, PAGE, styled
from icpshap.tables import INITIAL_XI, XI

REFERENCE, OVERLAPPING, ALONE, REMOVED = "#9A9A9A", "#0072B2", "#88CCEE", "#D55E00"
INITIAL, CLEAN, PERTURBED = "#BBBBBB", "#0072B2", "#D55E00"
# Half width, in standard deviations, of what holds 95 % of a Gaussian in 2 and 3 dimensions.
PLANE_95, SPACE_95 = np.sqrt(5.991), np.sqrt(7.815)
# Points of a cloud that a page holds at most, so that it stays small and turns smoothly.
PAGE_POINTS = 25_000


@dataclass(frozen=True)
class Scene:
    """A pair of scans, the share of points that stays, and the runs of two settings.

    kept (m,) marks the source points that stay when the overlap is reduced; clean and perturbed are
    rows of a runs table, empty if the pair was not registered; values: the perturbation.
    """

    pair: perturbation.Pair
    kept: np.ndarray
    clean: pd.DataFrame
    perturbed: pd.DataFrame
    values: dict


def make_scene(pair, runs, values, streams):
    """The Scene of a perturbation.Pair and its runs table.

    values: one value for each source; streams: perturbation.Streams of the pair, which say what
    points partial overlap removes from the raw scan.
    """
    order = perturbation.overlap_order(pair.overlapping, streams.generator("overlap"))
    first = runs[(runs.draws == 0) & (runs.replicate == 0)]
    off = {source.name: source.off for source in SOURCES}
    return Scene(
        pair,
        perturbation.reduce_overlap(pair, values["partial_overlap"], order),
        captions.instance(first, off),
        captions.instance(first, values),
        values,
    )


def caption(scene, study, row):
    """What the picture shows; `row` of a pairs table."""
    sentences = [
        f"{study.pair(row)}. Scans at the true pose, seen from above: {_scans(scene, row)}"
    ]
    if len(scene.clean):
        sentences += [
            _poses(scene, study, "ellipses"),
            "The right of each two panels is a close-up of the clean results.",
            f"Crosses are runs in a wrong basin: {_wrong_basins(scene)}.",
        ]
    return " ".join([*sentences, *_remarks(row)])


def page_caption(scene, study, row):
    """What the page shows; `row` of a pairs table."""
    sentences = [f"Scans at the true pose: {_scans(scene, row)}"]
    if len(scene.clean):
        sentences += [
            _poses(scene, study, "ellipsoids"),
            f"Diamonds are runs in a wrong basin: {_wrong_basins(scene)}.",
        ]
    usage = "Drag to turn, scroll to zoom, click on a name to hide it."
    return " ".join([*sentences, *_remarks(row), usage])


def _scans(scene, row):
    return (
        f"reference, source where it overlaps (overlap ratio {row.overlap:.2f}) and elsewhere, and "
        f"the points that partial overlap λ = {scene.values['partial_overlap']:g} removes."
    )


def _poses(scene, study, shapes):
    return (
        f"Pose errors of {len(scene.clean)} runs, estimator {study.estimator}: initial poses, "
        f"clean results, and results at {captions.describe_values(scene.values)}, with {shapes} "
        "that hold 95 % of a Gaussian of the same covariance."
    )


def _wrong_basins(scene):
    return f"{scene.clean.wrong_basin.sum()} clean, {scene.perturbed.wrong_basin.sum()} perturbed"


def _remarks(row):
    remarks = [("Not registered", row.reason), ("Warning", row.warning)]
    return [f"{kind}: {remark}." for kind, remark in remarks if remark]


# --- the picture ----------------------------------------------------------------------------------


def picture(scene):
    """Scans from above, and pose errors in translation and rotation, as a Figure."""
    with styled():
        figure = plt.figure(figsize=(PAGE, 5.4))
        scans, poses = figure.subfigures(2, height_ratios=(1.5, 1))
        _draw_scans(scans, scene)
        if len(scene.clean) == 0:
            poses.text(0.5, 0.5, "This pair was not registered.", ha="center", color=MUTED)
            return figure
        panels = poses.subplots(1, 4)
        _draw_poses(panels[:2], scene, slice(3, 6), 100, "translation", "xyz", "cm")
        _draw_poses(panels[2:], scene, slice(0, 3), np.rad2deg(1), "rotation", "xyz", "deg")
        handles, labels = panels[0].get_legend_handles_labels()
        poses.legend(handles, labels, loc="outside lower center", ncols=5)
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
                s=1.2 if name.startswith("removed") else 0.3,
                color=colour,
                linewidths=0,
                rasterized=True,
                label=name,
            )
        axes.set_aspect("equal")
        axes.set_xlim(limits[:, 0] + [-0.5, 0.5])
        axes.set_ylim(limits[:, 1] + [-0.5, 0.5])
        axes.set_xlabel("x of the reference [m]")
        legend = axes.legend(loc="upper right", handletextpad=0.1, borderpad=0.2)
        for handle in legend.legend_handles:
            handle.set_sizes([12])
    panels[0].set_ylabel("y of the reference [m]")


def clouds(scene):
    """Name: (points (k, 3) [m] in the reference's frame, colour)."""
    source = se3.transform(scene.pair.T_reference_source, scene.pair.source)
    overlapping = scene.pair.overlapping
    return {
        "reference": (scene.pair.reference, REFERENCE),
        "source alone": (source[~overlapping], ALONE),
        "source overlapping": (source[overlapping & scene.kept], OVERLAPPING),
        "removed by λ": (source[~scene.kept], REMOVED),
    }


def samples(scene):
    """Name: (pose errors (k, 6) [rad, m], wrong basin (k,), colour)."""
    nowhere = np.zeros(len(scene.perturbed), dtype=bool)
    return {
        "initial pose": (scene.perturbed[INITIAL_XI].to_numpy(), nowhere, INITIAL),
        "perturbed": (
            scene.perturbed[XI].to_numpy(),
            scene.perturbed.wrong_basin.to_numpy(),
            PERTURBED,
        ),
        "clean": (scene.clean[XI].to_numpy(), scene.clean.wrong_basin.to_numpy(), CLEAN),
    }


def _draw_poses(panels, scene, part, scale, title, names, unit):
    """Overview and close-up in the two coordinates in which the perturbed results vary most."""
    drawn = {
        name: (scale * xi[:, part], wrong, colour)
        for name, (xi, wrong, colour) in samples(scene).items()
    }
    a, b = np.sort(np.argsort(drawn["perturbed"][0].var(axis=0))[1:])
    clean, wrong_basin, _ = drawn["clean"]
    inside = clean[~wrong_basin][:, [a, b]]
    centre = np.median(inside, axis=0)
    close = np.maximum(2 * np.quantile(np.abs(inside - centre), 0.95, axis=0), 1e-6)
    for axes in panels:
        for name, (values, wrong, colour) in drawn.items():
            if name == "initial pose":
                axes.plot(*values[:, [a, b]].T, "+", color=colour, markersize=3, label=name)
                continue
            axes.plot(*values[~wrong][:, [a, b]].T, ".", color=colour, markersize=3, label=name)
            axes.plot(
                *values[wrong][:, [a, b]].T,
                "x",
                color=colour,
                markersize=3.5,
                markeredgewidth=0.8,
                label=f"{name}, wrong basin",
            )
            axes.add_patch(_ellipse(values[:, [a, b]], colour))
        axes.axhline(0, color=FAINT, linewidth=0.5, zorder=-1)
        axes.axvline(0, color=FAINT, linewidth=0.5, zorder=-1)
        axes.set_xlabel(f"{title} {names[a]} [{unit}]")
    panels[0].set_ylabel(f"{title} {names[b]} [{unit}]")
    panels[0].set_aspect("equal", adjustable="datalim")
    panels[1].set_xlim(centre[0] - close[0], centre[0] + close[0])
    panels[1].set_ylim(centre[1] - close[1], centre[1] + close[1])


def _ellipse(values, colour):
    """The ellipse that holds 95 % of a Gaussian with the covariance of values (k, 2)."""
    variances, directions = np.linalg.eigh(np.cov(values.T))
    width, height = 2 * PLANE_95 * np.sqrt(np.maximum(variances, 0))
    angle = np.rad2deg(np.arctan2(directions[1, 0], directions[0, 0]))
    return Ellipse(
        values.mean(axis=0), width, height, angle=angle, fill=False, edgecolor=colour, linewidth=1
    )


# --- the page -------------------------------------------------------------------------------------


def thin(points, most):
    """Points (k, 3), one of each voxel, with voxels just large enough to leave at most `most`."""
    size = 0.02
    while len(points) > most:
        _, first = np.unique(np.floor(points / size), axis=0, return_index=True)
        points = points[np.sort(first)]
        size *= 1.5
    return points


def page(scene, title, text):
    """A self-contained HTML page that turns: scans, translation errors and rotation errors."""
    import plotly.graph_objects as go
    from plotly.subplots import make_subplots

    figure = make_subplots(
        rows=1,
        cols=3,
        column_widths=[0.5, 0.25, 0.25],
        specs=[[{"type": "scene"}] * 3],
        subplot_titles=("scans at the true pose [m]", "translation [cm]", "rotation [deg]"),
        horizontal_spacing=0.01,
    )
    for name, (points, colour) in clouds(scene).items():
        x, y, z = thin(points, PAGE_POINTS).astype(np.float32).T
        marker = {"size": 2.5 if name.startswith("removed") else 1.2, "color": colour}
        figure.add_trace(
            go.Scatter3d(x=x, y=y, z=z, mode="markers", marker=marker, name=name, hoverinfo="skip"),
            row=1,
            col=1,
        )
    if len(scene.clean):
        for column, part, scale in ((2, slice(3, 6), 100.0), (3, slice(0, 3), np.rad2deg(1))):
            _add_poses(go, figure, scene, part, scale, column)
    figure.update_scenes(aspectmode="data", xaxis_title="x", yaxis_title="y", zaxis_title="z")
    figure.update_layout(
        title={"text": title},
        height=640,
        legend={"orientation": "h", "itemsizing": "constant"},
        margin={"l": 0, "r": 0, "b": 0, "t": 80},
        template="plotly_white",
    )
    plot = figure.to_html(
        full_html=False, include_plotlyjs=True, div_id="scene", config={"displaylogo": False}
    )
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        "<style>body{font-family:sans-serif;margin:1em}p{max-width:60em}</style></head>\n"
        f"<body>{plot}\n<p>{text}</p></body></html>\n"
    )


def _add_poses(go, figure, scene, part, scale, column):
    for name, (xi, wrong, colour) in samples(scene).items():
        values = scale * xi[:, part]
        for rows, label, symbol in (
            (~wrong, name, "circle"),
            (wrong, f"{name}, wrong basin", "diamond"),
        ):
            if not rows.any():
                continue
            x, y, z = values[rows].T
            marker = {"size": 3, "color": colour, "symbol": symbol}
            figure.add_trace(
                go.Scatter3d(
                    x=x,
                    y=y,
                    z=z,
                    mode="markers",
                    marker=marker,
                    name=label,
                    legendgroup=label,
                    showlegend=column == 2,
                    customdata=np.flatnonzero(rows),
                    hovertemplate="run %{customdata}: %{x:.2f}, %{y:.2f}, %{z:.2f}",
                ),
                row=1,
                col=column,
            )
        if name == "initial pose":
            continue
        x, y, z = _ellipsoid(values)
        figure.add_trace(
            go.Surface(
                x=x,
                y=y,
                z=z,
                opacity=0.15,
                showscale=False,
                colorscale=[[0, colour], [1, colour]],
                hoverinfo="skip",
                name=f"{name}, 95 %",
            ),
            row=1,
            col=column,
        )


def _ellipsoid(values):
    """Surface (3, 24, 24) that holds 95 % of a Gaussian with the covariance of values (k, 3)."""
    variances, directions = np.linalg.eigh(np.cov(values.T))
    azimuth, polar = np.meshgrid(np.linspace(0, 2 * np.pi, 24), np.linspace(0, np.pi, 24))
    sphere = np.array(
        [np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)]
    )
    axes = directions * (SPACE_95 * np.sqrt(np.maximum(variances, 0)))
    return np.einsum("ij,jkl->ikl", axes, sphere) + values.mean(axis=0)[:, None, None]
