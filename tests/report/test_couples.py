"""The triangle of interactions holds medians over the instances in which both causes are on."""

import numpy as np
import pytest
from known_results import (
    OF_NUMBER,
    SEVEN,
    STUDY,
    THREE,
    fixed_of,
    grid_of,
    of_covariances,
    study_of,
)
from matplotlib.patches import Rectangle

from icpshap.report import figures
from icpshap.report.figures import couples, style


def drawn(table, study):
    figure, caption = figures.draw("interactions", table, None, study)
    figure.canvas.draw()
    return figure, caption


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


@pytest.mark.parametrize("number", OF_NUMBER)
def test_a_cell_for_every_cause_and_every_couple(number):
    study = study_of(OF_NUMBER[number])
    table = grid_of(study.causes)
    figure, _ = drawn(table, study)
    axes = figure.axes[0]
    assert len([p for p in axes.patches if isinstance(p, Rectangle)]) == number * (number + 1) // 2
    assert len(axes.texts) == number * (number + 1) // 2
    titles = [t.get_text().replace("\n", " ") for t in axes.get_xticklabels()]
    assert [t.replace("- ", "-") for t in titles] == [c.title for c in study.players]
    assert len(figure.axes) == 1 + (number > 1)  # the colour scale is of couples


def test_cells_hold_medians_of_the_instances_in_which_both_are_on(grid):
    found = {(cell.row, cell.column): cell.median for cell in couples.cells(grid, STUDY)}
    noise, pose = grid.sensor_noise > 0, grid.initial_pose > 1
    both = grid[noise & pose].interaction_sensor_noise_initial_pose.median()
    assert found[1, 0] == pytest.approx(both)
    assert found[0, 0] == pytest.approx(grid[noise].phi_sensor_noise.median())
    shown = [text.get_text() for text in drawn(grid, STUDY)[0].axes[0].texts]
    assert f"{both:.2f}".replace("-", "−") in shown


def test_a_couple_that_is_never_on_together_has_no_number(grid):
    alone = (grid[["sensor_noise", "partial_overlap"]] > 0).sum(axis=1) <= 1
    table = grid[alone]
    cell = next(c for c in couples.cells(table, STUDY) if (c.row, c.column) == (2, 0))
    assert np.isnan(cell.median) and not cell.unsure
    texts = {t.get_position(): t.get_text() for t in drawn(table, STUDY)[0].axes[0].texts}
    assert texts[0.5, 2.5] == "–"


def test_colours_are_symmetric_about_zero(fixed):
    figure, _ = drawn(fixed, STUDY)
    medians = [c.median for c in couples.cells(fixed, STUDY) if c.row != c.column]
    largest = max(np.abs(medians))
    low, high = figure.axes[1].get_ylim()
    assert (low, high) == pytest.approx((-largest, largest))


def test_rings_mark_where_most_intervals_contain_zero(fixed):
    name = "interaction_sensor_noise_initial_pose"
    for inside, expected in ((2, True), (1, False)):
        fixed[[f"{name}_low", f"{name}_high"]] = 0.1, 0.2
        fixed.loc[: inside - 1, f"{name}_low"] = -0.1
        cell = next(c for c in couples.cells(fixed, STUDY) if (c.row, c.column) == (1, 0))
        assert cell.unsure == expected
        axes = drawn(fixed, STUDY)[0].axes[0]
        rings = [line.get_xydata()[0] for line in axes.lines if line.get_marker() == "o"]
        assert any((x // 1, y // 1) == (0, 1) for x, y in rings) == expected


def test_the_picture_says_what_its_cells_mean(fixed):
    fixed[["phi_sensor_noise_low", "phi_sensor_noise_high"]] = -9.0, 9.0
    assert legend(drawn(fixed, STUDY)[0]) == [
        "diagonal: median φ of the cause itself [nats]",
        "below: median interaction of the two causes [nats]",
        "most 95 % intervals contain 0: cannot be told from zero",
    ]


def test_one_cause_is_a_diagonal_alone():
    figure, caption = drawn(grid_of(THREE[:1]), study_of(THREE[:1]))
    assert legend(figure) == ["diagonal: median φ of the cause itself [nats]"]
    assert "One cause has nothing to interact with." in caption


def test_without_intervals_there_are_no_rings():
    study = study_of(THREE, kind="closed_form")
    figure, caption = drawn(of_covariances(fixed_of(THREE)), study)
    assert len(legend(figure)) == 2 and not figure.axes[0].lines
    assert "ring" not in caption


@pytest.mark.parametrize("value", np.linspace(0, 1, 41))
def test_numbers_can_be_read_on_every_colour(value):
    colour = couples.COLOURS(value)
    ink = couples._luminance(couples.readable(colour)) + 0.05
    behind = couples._luminance(colour) + 0.05
    assert max(ink / behind, behind / ink) > 4


def test_numbers_fit_into_their_cells():
    study = study_of(SEVEN)
    table = fixed_of(SEVEN)
    values = [c for c in table if c.startswith(("phi", "interaction")) and table[c].dtype == float]
    table[values] *= -1e9
    figure, _ = drawn(table, study)
    axes = figure.axes[0]
    width = axes.get_window_extent().width / len(SEVEN)
    assert figure.get_figwidth() == style.PAGE
    assert max(text.get_window_extent().width for text in axes.texts) < 0.94 * width


def test_huge_interactions_get_a_logarithmic_scale(fixed):
    fixed["interaction_sensor_noise_initial_pose"] *= 1e5
    figure, _ = drawn(fixed, STUDY)
    assert figure.axes[1].get_yscale() == "symlog"
    assert legend(figure)[1].endswith("[nats],\ncolours logarithmic beyond 1")
    texts = figure.legends[0].get_texts()
    assert all(text.get_window_extent().x1 < figure.bbox.x1 for text in texts)
