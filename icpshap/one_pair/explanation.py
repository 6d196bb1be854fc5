"""What `explain` returns: the tables of one pair, and what a person or a program asks of them."""

from __future__ import annotations

import json
import re
import zipfile
import zlib
from dataclasses import asdict, dataclass
from io import BytesIO
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
import pandas as pd

from icpshap import __version__
from icpshap.causes import CAUSES
from icpshap.data.pair import Pair
from icpshap.errors import UserError
from icpshap.explanation import games
from icpshap.explanation.directions import VECTOR
from icpshap.explanation.shapley import couples
from icpshap.fit import checks
from icpshap.one_pair.covariance import PoseCovariance
from icpshap.report import advice, captions, doubts
from icpshap.report.fit import misfits
from icpshap.report.study import Study
from icpshap.tables import TRANSFORM, covariances

if TYPE_CHECKING:
    import shap
    from matplotlib.figure import Figure


ABOUT = "about.json"
# Tables without which it says nothing.
NEEDED = ("pairs", "fit", "uncertainty", "shap", "directions", "covariances")
# What reading a file that is something else may raise.
UNREADABLE = (
    OSError,
    EOFError,
    zipfile.BadZipFile,
    zlib.error,
    AttributeError,
    KeyError,
    RuntimeError,
    TypeError,
    ValueError,
)
EPOCH = (1980, 1, 1, 0, 0, 0)  # of every file in a saved one: the same bytes at any time


class PoseError(NamedTuple):
    """Root mean square error about the true pose."""

    centimetres: float
    degrees: float


class WeakestDirection(NamedTuple):
    """Where the pose varies most with all causes on; a rotation counts as what it moves.

    words: as in "along y, yaw"; vector (6,): unit vector in the reference's axes, rotation first,
    in units of 1/L; clean, perturbed: standard deviation along it [cm].
    """

    words: str
    vector: np.ndarray
    clean: float
    perturbed: float


class Scans(NamedTuple):
    """The pair, and which of its raw points (n,), (m,) the causes leave."""

    pair: Pair
    kept_reference: np.ndarray
    kept_source: np.ndarray


@dataclass(frozen=True, eq=False)
class Explanation:
    """Why the registration of a pair is uncertain.

    tables: by name, as the workflow has them (docs/tables.md); study: how they came about; options:
    of the estimator; levels: of each cause; truth: what is to be said of the true pose, "" where it
    was given; shares_of_points (2,): of the source, what a run used, clean and with all causes on;
    scans: None of one that was loaded.
    """

    tables: dict[str, pd.DataFrame]
    study: Study
    options: dict[str, Any]
    levels: dict[str, float]
    seed: int
    truth: str
    shares_of_points: tuple[float, float]
    scans: Scans | None = None

    # --- in words ---------------------------------------------------------------------------------

    @property
    def sentence(self) -> str:
        """The pose error, what makes it, and what f says: the report's finding."""
        text = captions.found(self._shap, self.tables["directions"], self.study)
        return text[0].upper() + text[1:]

    @property
    def advice(self) -> list[str]:
        """What to do, the best first; what was not run says so."""
        tried = self.tables.get("what_if")
        return advice.sentences(self._shap, self.fit, tried, self.study)

    @property
    def warnings(self) -> list[str]:
        """What makes the numbers doubtful, the gravest first, each with what to do."""
        broken = misfits(self._shap, self.study)
        found = doubts.of_table(self._shap, self.study)
        found += doubts.of_pairs(self.tables["pairs"], self.study)
        # There is one pair: its name says nothing.
        named = rf"^{re.escape(self.study.pair(self._row))}( \(1 instance\))?: (.)"
        found = [
            doubt._replace(text=re.sub(named, lambda match: match[2].upper(), doubt.text))
            for doubt in found
        ]
        return [broken] * bool(broken) + [
            f"{group.title}. {' '.join(text for _, text in group.lines)} {group.advice}".strip()
            for group in doubts.grouped([("", doubt) for doubt in found])
        ]

    @property
    def fit(self) -> pd.DataFrame:
        """Whether the options fit the scans: a row a check, the gravest first."""
        return checks.graver_first(self.tables["fit"]).reset_index(drop=True)

    # --- numbers ----------------------------------------------------------------------------------

    @property
    def T_reference_source(self) -> np.ndarray:
        """The true pose (4, 4)."""
        return self.tables["pairs"][TRANSFORM].to_numpy().reshape(4, 4)

    @property
    def covariance(self) -> PoseCovariance:
        """With all causes on, of the runs that f of this setting is read off, without the floor.

        The sensor's own noise is included.
        """
        return self._covariance(on=True)

    @property
    def covariance_clean(self) -> PoseCovariance:
        """The same without any perturbation."""
        return self._covariance(on=False)

    @property
    def covariance_all_points(self) -> PoseCovariance:
        """`covariance` times the share of the points that a run used: a scaling, no measurement.

        It holds for errors that points have one by one, as sensor noise or a particle filter's
        likelihood, in an estimator that is told them. It is too small for what no point takes away:
        the initial pose, noise of the reference, biases; and for masks drawn from one cloud, whose
        spread is (1 - share) of that of as many new points. At a share of one half `covariance`
        itself is the better guess.
        """
        return self.covariance.of_all_points()

    def _covariance(self, on):
        """Of the setting in which all causes are on, or off."""
        table = self.tables["covariances"]
        levels = {c: self.levels[c] if on else CAUSES[c].off for c in self.study.causes}
        row = table[~table.again & (table[list(levels)] == pd.Series(levels)).all(axis=1)]
        left_out = 1.0 - (row.n_used / row.n_runs).item()
        share = self.shares_of_points[int(on)]
        return PoseCovariance(covariances(row)[0], share, left_out, self.T_reference_source)

    @property
    def f(self) -> float:
        """The uncertainty with all causes on, in the unit of the reading (`study.unit`)."""
        return self._row.f

    @property
    def success_rate(self) -> float:
        """Share of all runs within 0.1 m and 2 degrees of the true pose, with all causes on."""
        return self._row.success_rate

    @property
    def wrong_basin_share(self) -> float:
        """Share of the runs that failed or ended in a wrong basin, with all causes on."""
        return self._row.wrong_basin_share

    @property
    def wrong_basin(self) -> pd.DataFrame:
        """What each cause adds to the share of runs in a wrong basin: value, low, high."""
        return self._of_causes("wrong_basin_")

    @property
    def game(self) -> pd.DataFrame:
        """f of each coalition, a row each: whether each cause is on, f, f_low, f_high."""
        table = self.tables["uncertainty"]
        table = table[~table.again].reset_index(drop=True)
        on = {name: table[name] != CAUSES[name].off for name in self.study.causes}
        return pd.DataFrame(on).join(table[["f", "f_low", "f_high"]])

    @property
    def error_clean(self) -> PoseError:
        """Without any perturbation."""
        return self._error("clean_")

    @property
    def error_perturbed(self) -> PoseError:
        """With all causes on."""
        return self._error("")

    def _error(self, which):
        translation, rotation = (
            getattr(self._row, f"{which}{name}_rmse") for name in ("translation", "rotation")
        )
        return PoseError(float(100 * translation), float(np.rad2deg(rotation)))

    @property
    def weakest_direction(self) -> WeakestDirection:
        """Where the pose varies most with all causes on."""
        table = self.tables["directions"]
        row = table[table.direction == "weakest"].iloc[0]
        clean, perturbed = 100 * np.sqrt(np.maximum([row.clean, row.value], 0.0))
        vector = row[VECTOR].to_numpy(dtype=float)
        return WeakestDirection(row.words, vector, float(clean), float(perturbed))

    @property
    def shapley(self) -> pd.DataFrame:
        """Shapley value of each cause with its 95 % interval: value, low, high; a row a cause."""
        return self._of_causes("phi_")

    @property
    def removal(self) -> pd.DataFrame:
        """What f falls by without each cause: value, low, high."""
        return self._of_causes("removal_")

    @property
    def interactions(self) -> pd.DataFrame:
        """Interaction of each two causes, by their names: value, low, high."""
        pairs = list(couples(self.study.causes))
        table = self._estimates({pair: f"interaction_{pair[0]}_{pair[1]}" for pair in pairs})
        table.index = pd.MultiIndex.from_tuples(pairs, names=["cause", "other"])
        return table

    @property
    def directions(self) -> pd.DataFrame:
        """Which cause makes which direction uncertain: the directions table."""
        return self.tables["directions"]

    def _of_causes(self, prefix):
        return self._estimates({name: f"{prefix}{name}" for name in self.study.causes})

    def _estimates(self, columns):
        row = self._row
        values = {
            key: [getattr(row, f"{column}{end}") for end in ("", "_low", "_high")]
            for key, column in columns.items()
        }
        table = pd.DataFrame.from_dict(values, orient="index", columns=["value", "low", "high"])
        return table.rename_axis("cause")

    @property
    def _shap(self):
        return self.tables["shap"]

    @property
    def _row(self):
        return next(self._shap.itertuples())

    # --- other forms ------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """All of it but the single runs, as plain data: numbers, texts, lists and mappings."""
        shares = {
            name: {"value": row.value, "low": row.low, "high": row.high}
            for name, row in self.shapley.iterrows()
        }
        found = {
            "version": __version__,
            "sentence": self.sentence,
            "error_clean": self.error_clean._asdict(),
            "error_perturbed": self.error_perturbed._asdict(),
            "success_rate": self.success_rate,
            "wrong_basin_share": self.wrong_basin_share,
            "weakest_direction": self.weakest_direction._asdict(),
            "f": {"value": self.f, "low": self._row.f_low, "high": self._row.f_high},
            "unit": self.study.unit,
            "shapley": shares,
            "removal": self.removal.to_dict(orient="index"),
            "wrong_basin": self.wrong_basin.to_dict(orient="index"),
            "interactions": [
                {"causes": list(pair), **row}
                for pair, row in zip(
                    self.interactions.index,
                    self.interactions.to_dict(orient="records"),
                    strict=True,
                )
            ],
            "covariance": self.covariance.to_dict(),
            "covariance_clean": self.covariance_clean.to_dict(),
            "covariance_all_points": self.covariance_all_points.to_dict(),
            "advice": self.advice,
            "warnings": self.warnings,
            "fit": self.fit.to_dict(orient="records"),
            "directions": self.directions.to_dict(orient="records"),
            "what_if": self._what_if(),
            "T_reference_source": self.T_reference_source.tolist(),
            "truth": self.truth,
            "levels": self.levels,
            "estimator": self.study.estimator,
            "options": self.options,
            "seed": self.seed,
        }
        return plain(found)

    def _what_if(self):
        tried = self.tables.get("what_if")
        return [] if tried is None else tried.to_dict(orient="records")

    def to_json(self) -> str:
        """`to_dict` as JSON; what is not a number is null."""
        return json.dumps(self.to_dict(), indent=2, ensure_ascii=False) + "\n"

    def to_shap(self) -> shap.Explanation:
        """A shap.Explanation of one instance, for the plots of shap. Needs the extra `plots`."""
        return games.shap_explanation(self._shap)

    def plot(self, figure: str = "waterfall") -> Figure:
        """A figure of matplotlib: waterfall, interactions, directions or scene.

        Needs the extra `plots`. Raises UserError for another name.
        """
        from icpshap.one_pair import pictures

        return pictures.draw(self, figure)[0]

    def to_html(self) -> str:
        """The workflow's report for this pair: one page with its figures. Needs `plots`."""
        from icpshap.one_pair import pictures

        return pictures.page(self)

    def to_text(self, width: int = 100, colours: bool = False) -> str:
        """A screen of it, at most 40 lines."""
        from icpshap.one_pair import screen

        return screen.text(self, width, colours)

    def __repr__(self) -> str:
        return self.to_text()

    def _repr_html_(self) -> str:
        from icpshap.one_pair import screen

        return screen.html(self)

    def save(self, path: str | Path) -> None:
        """Write all but the scans to one file, a ZIP of parquet tables and JSON; see `load`."""
        about = {
            "version": __version__,
            "study": asdict(self.study),
            "options": self.options,
            "levels": self.levels,
            "seed": self.seed,
            "truth": self.truth,
            "shares_of_points": self.shares_of_points,
        }
        parts = {ABOUT: json.dumps(about).encode()}
        for name, table in self.tables.items():
            parts[f"{name}.parquet"] = table.to_parquet(index=False)
        with writable(path), zipfile.ZipFile(path, "w") as file:
            for name, content in parts.items():
                file.writestr(zipfile.ZipInfo(name, EPOCH), content)

    @classmethod
    def load(cls, path: str | Path) -> Explanation:
        """What `save` wrote; without the scans, so that there is no scene.

        Raises UserError if the file is none, damaged, or of another version that had other parts.
        """
        version = __version__
        try:
            with zipfile.ZipFile(path) as file:
                parts = {name: file.read(name) for name in file.namelist()}
            about = json.loads(parts.pop(ABOUT))
            tables = {
                name.removesuffix(".parquet"): pd.read_parquet(BytesIO(content))
                for name, content in parts.items()
            }
            version = about.pop("version")
            study = about.pop("study")
            study = Study(**{**study, "causes": tuple(study["causes"])})
            if missing := [name for name in NEEDED if name not in tables]:
                raise ValueError(f"without {', '.join(missing)}")
            return cls(tables, study, **about)
        except FileNotFoundError:
            raise UserError(f"{path}: no such file.\nHint: Explanation.save writes one.") from None
        except UNREADABLE as error:
            other = f", or written by icpshap {version}" if version != __version__ else ""
            raise UserError(
                f"{path}: not an explanation, or damaged{other} ({error}).\n"
                f"Hint: explain the pair again with icpshap {__version__}, and save it."
            ) from None


class writable:
    """A place to write to: OSErrors in it are UserErrors that name the path."""

    def __init__(self, path: str | Path) -> None:
        self.path = path

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if isinstance(error, OSError):
            raise UserError(
                f"{self.path}: cannot be written: {error.strerror or error}.\n"
                "Hint: give a file in a folder that exists and that you may write to."
            ) from None


def plain(value: object) -> Any:
    """Mappings, lists, texts, truth values and finite numbers; None for NaN and infinity."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value
