"""Directions in figures and in words: numbers of the table, in centimetres and degrees."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from known_results import STUDY, directions_table, fixed_of

from icpshap.report import directions, figures

ONE = replace(STUDY, waterfall=None)


@pytest.fixture(scope="module")
def table():
    return directions_table()


def test_rows_hold_the_table_in_centimetres_and_degrees(table):
    rows = dict(zip(directions.ORDER, directions.summary(table, ONE), strict=True))
    of_table = table.set_index("direction")
    assert rows["translation_x"].value == pytest.approx(1e4 * of_table.value["translation_x"])
    square_degrees = np.rad2deg(1.0) ** 2
    assert rows["rotation_z"].clean == pytest.approx(square_degrees * of_table.clean["rotation_z"])
    part = rows["translation_y"].parts[0]
    assert part.value == pytest.approx(1e4 * of_table.phi_sensor_noise["translation_y"])
    assert part.remaining == pytest.approx(1e4 * of_table.remaining_sensor_noise["translation_y"])


def test_per_cent_are_said_only_where_the_growth_is_sure(table):
    error = table.direction.str.startswith("error")
    sure, unsure = (
        " ".join(directions.sentences(table.assign(in_per_cent=error & told), ONE))
        for told in (True, False)
    )
    assert "what the squared error grows by: sensor noise" in sure and " %, " in sure
    assert "grows by:" not in unsure
    assert "what the squared error grows by [cm²]: sensor noise" in unsure


def test_the_weakest_direction_is_named_with_what_remains(table):
    (words,) = table.words[table.direction == "weakest"]
    text = directions.sentences(table, ONE)[0]
    assert text.startswith(
        f"Along the weakest direction ({words}) the standard deviation goes from"
    )
    assert "without sensor noise" in text


def test_picture_has_a_row_a_direction_and_a_cell_a_cause(table):
    figure, caption = figures.draw_directions(table, fixed_of(STUDY.causes), ONE)
    (axes,) = figure.axes
    assert len(axes.get_yticks()) == 11
    assert len(axes.patches) == 11 * 5  # clean, three causes, in all
    assert "Variance along the axes of the reference" in caption
    plt.close(figure)


def test_covariances_alone_have_no_error(table):
    error = table.direction.str.startswith("error")
    without = table.assign(value=table.value.where(~error))
    assert len(directions.summary(without, ONE)) == 9
    assert len(directions.sentences(without, ONE)) == 1
    nothing = table.assign(value=np.nan)
    assert directions.sentences(nothing, ONE) == []
    figure, _ = figures.draw_directions(nothing, fixed_of(STUDY.causes), ONE)
    plt.close(figure)
