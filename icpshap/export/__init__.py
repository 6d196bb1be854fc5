"""Covariances for other programs: one file a format; to add one is to add a file."""

from icpshap import registry
from icpshap.causes import CAUSES
from icpshap.errors import UserError
from icpshap.export import measurement
from icpshap.export.format import Format

FORMATS = registry.classes(__name__, __path__, Format)


def export(table, name, levels, sequence=None):
    """A covariances table in the format of that name: texts, and what has no covariance, in words.

    texts: by what the name of the file has before its suffix, "" of the first; levels: of causes
    that the table has several of, or that shall be off, by name; sequence: its key, None for all
    that are there. Raises UserError.
    """
    written_as = FORMATS[name]()
    measured = measurement.of_sequence(measurement.measurements(table), sequence)
    chosen = measurement.instance(measured, levels)
    choose = measurement.coalitions if written_as.all_coalitions else measurement.at
    wanted = choose(measured, chosen)
    known = [one for one in wanted if one.is_known]
    if not known:
        raise UserError(
            f"{len(wanted)} measurement(s), none of which has a covariance: too few runs are left, "
            "or the pair was not registered.\n"
            "Hint: column `reason` and `n_used` of the table, and `warning` of uncertainty.parquet."
        )
    lost = list(dict.fromkeys(one.in_words for one in wanted if not one.is_known))
    return written_as.texts(known), lost


def clean():
    """The levels of no perturbation at all, for `export`."""
    return {name: cause.off for name, cause in CAUSES.items()}
