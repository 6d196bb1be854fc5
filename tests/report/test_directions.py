"""Directions in figures and in words: numbers of the table, in centimetres and degrees."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
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
    assert "what the squared error grows by: sensor noise" in sure
    row = table[table.direction == "error_translation"].iloc[0]
    ends = (f"{100 * row[f'share_sensor_noise{end}']:.0f}" for end in ("", "_low", "_high"))
    assert "sensor noise {} % [{}, {}]".format(*ends) in sure
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
    figure, caption = figures.draw("directions", fixed_of(STUDY.causes), table, ONE)
    (axes,) = figure.axes
    assert len(axes.get_yticks()) == 11
    assert len(axes.patches) == 11 * 5  # clean, three causes, in all
    told = [text.get_text() for text in axes.texts]
    assert sum(text.startswith("→ ") for text in told) == 11 * 3
    remains = directions.deviation(directions.summary(table, ONE)[0].parts[0].remaining)
    assert f"→ {remains}" in told
    assert "Variance along the axes of the reference" in caption
    plt.close(figure)


def test_covariances_alone_have_no_error(table):
    error = table.direction.str.startswith("error")
    without = table.assign(value=table.value.where(~error))
    assert len(directions.summary(without, ONE)) == 9
    assert len(directions.sentences(without, ONE)) == 1
    nothing = table.assign(value=np.nan)
    assert directions.sentences(nothing, ONE) == []
    figure, _ = figures.draw("directions", fixed_of(STUDY.causes), nothing, ONE)
    plt.close(figure)


def test_sentences_of_one_instance_have_intervals_and_the_vector(table):
    text, error, _ = directions.sentences(table.assign(in_per_cent=False), ONE)
    row = table[table.direction == "weakest"].iloc[0]
    ends = [directions.deviation(1e4 * row[f"value{end}"]) for end in ("_low", "_high")]
    assert f"{directions.deviation(1e4 * row.value)} [{', '.join(ends)}] cm; parts" in text
    ends = [
        directions.deviation(1e4 * row[f"remaining_sensor_noise{end}"]) for end in ("_low", "_high")
    ]
    assert f"[{', '.join(ends)}] without sensor noise" in text
    entries = [f"{row[f'vector_{k}']:.2f}" for k in range(6)]
    assert f"The unit vector of the weakest direction is ({', '.join(entries[:3])}) about" in text
    assert error.count("[") == 8  # before and after, of both; the unit and three parts


def test_it_is_said_of_what_the_numbers_are(table):
    assert directions.opening(table, ONE).endswith(
        "at sensor noise σ = 0.05 m, initial pose scale s = 1.5, partial overlap λ = 0.05:"
    )
    off = table.assign(instance=1, sensor_noise=0.0)
    for column in [c for c in table if c.startswith("phi_sensor_noise")]:
        off[column] = 0.0
    several = pd.concat([table, off, off.assign(instance=2)])
    assert directions.opening(several, ONE).startswith("Medians over 3 instances of ")
    assert directions.opening(several.assign(value=np.nan), ONE) == ""
    alone, among = (directions.summary(given, ONE) for given in (table, several))
    for one, row in zip(alone, among, strict=True):
        # An instance in which a cause is off says nothing of it.
        assert row.parts[0].value == pytest.approx(one.parts[0].value)
        assert row.parts[0].unsure == one.parts[0].unsure


def test_the_table_of_errors_holds_what_sentences_say(table):
    told = directions.html(table.assign(in_per_cent=True), ONE)
    error = table[table.direction == "error_translation"].iloc[0]
    assert "<th>error in translation [cm]" in told and "<th>error in rotation [deg]" in told
    assert f"{directions.deviation(1e4 * error.clean)} [" in told
    assert f"{100 * error.share_sensor_noise:.0f} % of the growth [" in told
    assert f"{directions.deviation(1e4 * error.remaining_sensor_noise)} [" in told
    told = directions.html(table.assign(in_per_cent=False), ONE)
    assert "cm²" in told and "of the growth" not in told
    assert told.count("<tr>") == 1 + 4 + 2 * 3
    note = directions.note(table, ONE)
    assert note.startswith("Errors are root mean squares") and "unit vector" in note


def test_the_table_of_covariances_has_no_errors(table):
    known = ~table.direction.str.startswith("error")
    told = directions.html(table[known], ONE)
    assert "error" not in told and "weakest" in told and "95 %" not in told
    assert "Errors" not in directions.note(table[known], ONE)
    assert directions.html(table.assign(value=np.nan), ONE) == ""
