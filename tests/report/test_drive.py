"""Along a drive: what is drawn is what the table holds, and the pairs most in doubt come first."""

import re

import numpy as np
import pandas as pd
import pytest
from known_results import FIXED, STUDY, of_covariances, shap_table, study_of, without_value
from matplotlib.colors import to_hex

from icpshap.causes import CAUSES
from icpshap.estimators.closed_form import ClosedForm
from icpshap.report import figures, in_doubt
from icpshap.report.figures import style

FIXED_STUDY = study_of(tuple(FIXED), waterfall={name: level for name, (level,) in FIXED.items()})
LABELS = ["error [cm]", "error [deg]", "W [%]", "f [nats]", "φ [nats]"]


def drive_table(number=12, every=10):
    """A table of a drive: the third pair is lost most, the fifth less, the others err in order."""
    table = shap_table(FIXED, [("apartment", every * k, every * k + 1) for k in range(number)])
    table["success_rate"] = 1.0
    table["translation_rmse"] = 0.001 * np.arange(1, number + 1)
    table.loc[[2, 4], "success_rate"] = 0.2, 0.7
    return table


def drawn(table, study=FIXED_STUDY):
    figure, caption = figures.draw("drive", table, None, study)
    figure.canvas.draw()
    return figure, caption


def line_of(axes, colour):
    """Data (n, 2) of the line of this colour."""
    dotted = (line for line in axes.lines if line.get_marker() == "o")
    (line,) = (line for line in dotted if to_hex(line.get_color()).upper() == colour.upper())
    return line.get_xydata()


class TestRanking:
    def test_the_fewest_runs_at_the_true_pose_come_first_then_the_largest_error(self):
        found = in_doubt.ranking(drive_table(), FIXED_STUDY)
        assert list(found["rank"]) == [1, 2, 3, 4, 5, 6]
        assert list(found.reference) == [20, 40, 110, 100, 90, 80]

    def test_a_pair_of_which_every_run_failed_comes_first(self):
        table = drive_table()
        errors = ["translation_rmse", "rotation_rmse"]
        table.loc[[2, 7], "success_rate"] = 0.0
        table.loc[7, errors] = np.nan
        found = in_doubt.ranking(table, FIXED_STUDY)
        assert list(found.reference)[:3] == [70, 20, 40]
        assert np.isnan(found.translation_rmse[0])

    @pytest.mark.parametrize(("pairs", "listed"), [(5, 2), (19, 9), (20, 10), (200, 10)])
    def test_ten_are_listed_and_of_few_pairs_half(self, pairs, listed):
        assert len(in_doubt.ranking(drive_table(pairs), FIXED_STUDY)) == listed

    def test_what_was_not_registered_has_no_rank(self):
        table = without_value(drive_table(), [2, 4], "overlap ratio")
        assert list(in_doubt.ranking(table, FIXED_STUDY).reference)[:2] == [110, 100]

    def test_without_runs_the_largest_f_comes_first(self):
        table = of_covariances(drive_table())
        study = study_of(tuple(FIXED), kind=ClosedForm.name, options={})
        found = in_doubt.ranking(table, study)
        assert list(found.f) == sorted(table.f, reverse=True)[:6]
        assert found.success_rate.isna().all() and "largest f" in in_doubt.how(study)

    def test_the_largest_part_of_f_is_named(self):
        table = drive_table()
        phi = [f"phi_{name}" for name in FIXED]
        table[phi] = -1.0
        table.loc[2, "phi_initial_pose"] = 3.0
        assert list(in_doubt.ranking(table, FIXED_STUDY).largest)[:2] == ["initial_pose", ""]

    def test_its_file_says_the_same(self, tmp_path):
        found = in_doubt.ranking(drive_table(), FIXED_STUDY)
        found.to_csv(tmp_path / "drive.csv", index=False)
        pd.testing.assert_frame_equal(
            in_doubt.read(tmp_path / "drive.csv"), found, check_dtype=False, rtol=1e-15
        )

    def test_a_page_shows_it(self):
        text = in_doubt.html(in_doubt.ranking(drive_table(), FIXED_STUDY), FIXED_STUDY)
        cells = [cell.strip() for cell in re.findall("<td>(.*?)</td>", text)]
        assert cells[:4] == ["1", "Apartment 20–21", "100 → 20", "2 → 0.3"]

    def test_where_every_run_failed_a_page_shows_no_error(self):
        table = drive_table()
        table.loc[2, "translation_rmse"] = np.nan
        table.loc[2, "clean_rotation_rmse"] = np.nan
        table.loc[4, ["clean_rotation_rmse", "rotation_rmse"]] = np.nan
        text = in_doubt.html(in_doubt.ranking(table, FIXED_STUDY), FIXED_STUDY)
        assert "nan" not in text and "<td>2 → none" in text and "<td>none → " in text


class TestFigure:
    def test_its_lines_are_the_table(self):
        table = drive_table()
        axes = drawn(table.sample(frac=1, random_state=0))[0].axes
        assert [panel.get_ylabel() for panel in axes] == LABELS
        expected = np.column_stack([table.source, 100 * table.translation_rmse])
        assert line_of(axes[0], style.INK) == pytest.approx(expected)
        degrees = np.rad2deg(table.clean_rotation_rmse)
        assert line_of(axes[1], style.MUTED)[:, 1] == pytest.approx(degrees)
        assert line_of(axes[2], style.INK)[:, 1] == pytest.approx(100 * table.wrong_basin_share)
        assert line_of(axes[3], style.INK)[:, 1] == pytest.approx(table.f)
        for name in FIXED:
            found = line_of(axes[4], CAUSES[name].colour)[:, 1]
            assert found == pytest.approx(table[f"phi_{name}"])

    def test_stripes_and_ranks_are_where_the_doubt_is(self):
        table = drive_table()
        axes = drawn(table)[0].axes
        ranks = in_doubt.ranking(table, FIXED_STUDY)
        named = {text.xy[0]: text.get_text() for text in axes[0].texts}
        assert named == dict(zip(ranks.source, map(str, ranks["rank"]), strict=True))
        for panel in axes:
            centres = [patch.get_x() + patch.get_width() / 2 for patch in panel.patches]
            assert sorted(centres) == pytest.approx(sorted(ranks.source))

    def test_ranks_that_are_near_stand_above_one_another(self):
        table = drive_table(200)
        table["success_rate"] = np.where(table.index.isin([50, 51, 52]), 0.1, 1.0)
        places = {text.xy[0]: text.get_position()[1] for text in drawn(table)[0].axes[0].texts}
        assert len({places[10 * k + 1] for k in (50, 51, 52)}) == 3

    def test_a_pair_that_was_not_registered_breaks_the_line_and_has_a_cross(self):
        table = without_value(drive_table(), [6], "overlap ratio")
        figure, caption = drawn(table)
        f = figure.axes[3]
        assert np.isnan(line_of(f, style.INK)[6, 1])
        (cross,) = (line for line in f.lines if line.get_marker() == "x")
        assert list(cross.get_xdata()) == [61]
        assert "1 of 12 pairs were not registered (crosses)." in caption

    def test_the_caption_says_how_pairs_are_ranked_and_names_them(self):
        caption = drawn(drive_table())[1]
        assert in_doubt.HOW in caption
        assert "20–21, 40–41, 110–111, 100–101, 90–91, 80–81;" in caption

    def test_of_a_grid_it_shows_one_instance(self):
        grid = shap_table(pairs=[("apartment", k, k + 1) for k in range(6)])
        axes = drawn(grid, STUDY)[0].axes
        shown = STUDY.instance(grid, STUDY.waterfall)
        assert line_of(axes[3], style.INK)[:, 1] == pytest.approx(shown.f)

    def test_covariances_have_no_error_and_no_wrong_basin(self):
        study = study_of(
            tuple(FIXED), kind=ClosedForm.name, options={}, waterfall=FIXED_STUDY.waterfall
        )
        figure, caption = drawn(of_covariances(drive_table()), study)
        assert [panel.get_ylabel() for panel in figure.axes] == LABELS[3:]
        assert "pose error" not in caption and "the largest f" in caption

    def test_an_error_of_nothing_has_an_axis(self):
        table = drive_table()
        table[[name for name in table if name.endswith("_rmse")]] = 0.0
        assert [panel.get_ylim() for panel in drawn(table)[0].axes[:2]] == [(0.0, 1.0)] * 2

    def test_a_lost_pair_makes_the_axis_of_errors_logarithmic(self):
        table = drive_table()
        table.loc[2, "translation_rmse"] = 3.0
        scales = [panel.get_yscale() for panel in drawn(table)[0].axes[:2]]
        assert scales == ["log", "linear"]

    def test_without_a_value_it_says_so(self):
        table = without_value(drive_table(), list(range(12)), "overlap ratio")
        (axes,) = drawn(table)[0].axes
        assert axes.texts[0].get_text() == "No pair has a value."

    def test_the_same_table_makes_the_same_bytes(self, tmp_path):
        files = [tmp_path / name for name in ("a.png", "b.png", "a.svg", "b.svg")]
        for path in files:
            style.save(drawn(drive_table())[0], path)
        contents = [path.read_bytes() for path in files]
        assert contents[0] == contents[1] and contents[2] == contents[3]
