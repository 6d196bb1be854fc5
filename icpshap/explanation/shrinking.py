"""Whether an instance makes the spread smaller, which a divergence counts as uncertainty too.

An instance shrinks if the interval of its entropy difference lies below 0; a cause narrows if that
of its Shapley value of the entropy difference does. What a deterministic estimator returns needs no
interval: there the number itself counts.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from icpshap.explanation import shapley
from icpshap.explanation.uncertainty import (
    columns_of,
    estimate,
    mean_of_games,
    over_replicates,
)

if TYPE_CHECKING:
    from icpshap.explanation.method import Method
    from icpshap.explanation.sample import Sample


ERRORS = {"translation_rmse": "square_translation", "rotation_rmse": "square_rotation"}


def shrinking_columns(
    replicates: list[Sample], rows: list[np.ndarray], method: Method
) -> dict[str, np.ndarray]:
    """Entropy differences and errors of instances, by column; rows (i, 2^M) of each replicate."""
    causes = replicates[0].causes
    by_entropy = replace(method, divergence="entropy_difference")
    found = over_replicates(
        [
            estimate(sample, row, _f_and_phi, by_entropy)
            for sample, row in zip(replicates, rows, strict=True)
        ]
    )
    phi = found.part(slice(1, None))
    certain = replicates[0].returns.is_deterministic

    def is_below_zero(number):
        return np.where(np.isnan(number.high) & certain, number.value, number.high) < 0

    narrows = is_below_zero(phi)
    return {
        **columns_of(["entropy_difference"], found),
        **columns_of([f"entropy_difference_{cause}" for cause in causes], phi),
        "shrinks": is_below_zero(found)[:, 0],
        **{f"narrows_{cause}": narrows[:, q] for q, cause in enumerate(causes)},
        **_errors(replicates, rows, method),
    }


def _f_and_phi(game):
    return np.concatenate([game[..., -1:], shapley.shapley_values(game)], axis=-1)


def _errors(replicates, rows, method):
    """Errors of the clean setting and of the instance, of the runs that fail in none of its game.

    Those of the directions table: roots of the mean squared errors over all replicates.
    """
    method = method.of_errors
    found = {}
    for name, number in ERRORS.items():
        square = over_replicates(
            [
                estimate(
                    sample,
                    row,
                    _clean_and_all_on,
                    method,
                    leave_out=False,
                    intervals=False,
                    values=mean_of_games(number, sample, row),
                )
                for sample, row in zip(replicates, rows, strict=True)
            ]
        )
        found[f"clean_{name}"], found[name] = np.sqrt(square.value).T
    return found


def _clean_and_all_on(game):
    return game[..., [0, -1]]
