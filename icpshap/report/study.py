"""How the numbers of an experiment came about, as far as figures and sentences need it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from icpshap import estimators
from icpshap.causes import players, variants_of
from icpshap.explanation.readings import READINGS
from icpshap.options import values
from icpshap.tables import NO_PAIR, PAIR

if TYPE_CHECKING:
    import pandas as pd

    from icpshap.causes.cause import Cause
    from icpshap.estimators.kind import Kind, Returns
    from icpshap.presets import Preset


@dataclass(frozen=True)
class Study:
    """Plain data, as a workflow hands it over; `name` is the experiment's, `kind` its estimator's.

    causes: names, in the order of the registry; dependence: couples [a, b] of them, a figure each
    of the Shapley value of a, coloured by b; titles: names of sequences by their keys; waterfall:
    the instance shown alone, a value for each cause; variants: options of the causes that are a
    variant, by name of the cause; options: those of the estimator's kind; here: whether instances
    are the levels that are diagnosed of each pair. The rest are keys of the configuration.
    """

    name: str
    estimator: str
    kind: str
    causes: tuple
    divergence: str
    noise_draws: int
    bias_correction: str
    wrong_basins: str
    dependence: tuple = ()
    titles: dict = field(default_factory=dict)
    waterfall: dict | None = None
    variants: dict = field(default_factory=dict)
    options: dict = field(default_factory=dict)
    here: bool = False

    @classmethod
    def of(
        cls, name: str, estimator: str, preset: Preset, causes: Collection[str], **shown: Any
    ) -> Study:
        """That of a presets.Preset and the names of causes; shown: the fields that say what is."""
        method = preset.method
        return cls(
            name=name,
            estimator=estimator,
            kind=preset.estimator.kind.name,
            causes=tuple(causes),
            divergence=method.divergence,
            noise_draws=preset.estimator.perturbing.noise_draws,
            bias_correction=method.bias_correction,
            wrong_basins=method.wrong_basins,
            variants=variants_of(preset.estimator.of_causes(causes).causes),
            options=values(preset.estimator.kind),
            **shown,
        )

    @property
    def unit(self) -> str:
        """Unit of f and of all that is shared out of it."""
        return READINGS[self.divergence].unit

    @property
    def players(self) -> tuple[Cause, ...]:
        """The causes, with their words."""
        return players(self.causes, self.variants)

    @property
    def returns(self) -> Returns:
        """What the estimator makes of a setting: `estimators.kind.Returns`."""
        return self.estimator_kind.returned(self.noise_draws)

    @property
    def estimator_kind(self) -> Kind:
        """The estimator's kind with its options: a `estimators.kind.Kind`."""
        return estimators.KINDS[self.kind](**self.options)

    @property
    def repeats(self) -> str:
        """What there are several of in a setting: runs, samples or noise draws."""
        if self.returns.is_deterministic:
            return "noise draws"
        return "runs" if self.returns.exchangeable else "samples"

    @property
    def dependence_figures(self) -> dict[str, tuple[Cause, Cause]]:
        """The two causes of each dependence figure, by its name: whose phi, and whose colour."""
        by_name = {cause.name: cause for cause in self.players}
        return {f"dependence_{a}_by_{b}": (by_name[a], by_name[b]) for a, b in self.dependence}

    def title(self, sequence: str) -> str:
        return self.titles.get(sequence, sequence)

    def pair(self, row: Any) -> str:
        """Name of the pair of scans in a row of a table."""
        return f"{self.title(row.sequence)} {row.reference}–{row.source}"

    def run_pair(self, row: Any) -> str:
        """Name of the pair that was run for a row of a shap table."""
        if not self.here or row.played_reference == NO_PAIR:
            return self.pair(row)
        return f"{self.title(row.sequence)} {row.played_reference}–{row.played_source}"

    # --- rows and columns of a shap table ---------------------------------------------------------

    def shown(self, table: pd.DataFrame) -> tuple[Cause, ...]:
        """The causes that are on in any row; what is never on is neither drawn nor told."""
        return tuple(c for c in self.players if (table[c.name] != c.off).any())

    def phi(self, table: pd.DataFrame) -> list[str]:
        """Names of the Shapley values of the shown causes."""
        return [f"phi_{cause.name}" for cause in self.shown(table)]

    def valued(self, table: pd.DataFrame) -> pd.DataFrame:
        """The rows that have values: registered, and with enough runs left."""
        return table[table[[f"phi_{name}" for name in self.causes]].notna().all(axis=1)]

    def present(self, table: pd.DataFrame, *causes: Cause) -> pd.DataFrame:
        """The valued rows in which these causes are on; where one is off, its phi is 0."""
        on = [table[cause.name] != cause.off for cause in causes]
        return self.valued(table[np.all(on, axis=0)])

    def instance(self, table: pd.DataFrame, levels: Mapping[str, float] | None) -> pd.DataFrame:
        """The rows of one instance, given by a value for each cause; all where there is but one."""
        if levels is None:
            return table
        return table[np.all([np.isclose(table[n], levels[n]) for n in self.causes], axis=0)]

    def interval_over(self, table: pd.DataFrame) -> str:
        """What the intervals are taken over: runs, noise draws or replicates; "" without any."""
        kept = self.valued(table)
        return kept.interval_over.iloc[0] if len(kept) else ""


def pairs_of(table: pd.DataFrame) -> pd.DataFrame:
    """The first row of each pair of scans."""
    return table.drop_duplicates(PAIR)


def contains_zero(table: pd.DataFrame, name: str) -> np.ndarray:
    """Where an interval holds 0, bool (n,); False where there is none, for that says nothing."""
    return ((table[f"{name}_low"] <= 0) & (table[f"{name}_high"] >= 0)).to_numpy()


def judged(table: pd.DataFrame, name: str) -> pd.DataFrame:
    """The rows in which a number has an interval."""
    return table[table[f"{name}_low"].notna() & table[f"{name}_high"].notna()]
