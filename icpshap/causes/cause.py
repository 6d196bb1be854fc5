"""What a cause of uncertainty is: a player of the game of coalitions, and how it acts on a pair.

A cause is one file of this package: a class with the words below, and one of the hooks `move`,
`keep`, `start` and `thin`. Everything else follows from it: configuration, settings, tables, labels
and figures. Four rules hold for each hook, so that any causes can act together:

- at the level `off` it changes nothing, to the bit;
- it is nested in its level: a larger level removes more of the same, or scales the same draw;
- its random numbers come from streams of its own name, which no level changes, so that all settings
  of a pair share them;
- masks are made from the raw scans, so that they do not depend on what moves the points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from icpshap.options import Range

if TYPE_CHECKING:
    from icpshap.causes._given import RawPair, Streams


HOOKS = ("move", "keep", "start", "thin")
SCANS = ("reference", "source")


@dataclass(frozen=True)
class Cause:
    """A cause; fields of a subclass are its options in the configuration's estimators.

    `off` is its reference value (Algorithm 1 of the paper), `range` the levels that are allowed,
    `levels` some that are worth trying; `scans` are those that `move` or `keep` act on. `order` is
    its place in tables. Moves act in the reverse order: what the scanner does last comes first.
    `fewest_noise_draws`: an error that all runs of a noise draw share shows only over many of them.
    `counts_points`: whether a pair is checked for how many source points it leaves of a run.
    `shown_by`: the number of a pair of scans (diagnosis.diagnostics) that the cause moves, without
    any ICP; "" where the scans do not show it. `told`: whether a robot knows it of itself.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    symbol: ClassVar[str]
    unit: ClassVar[str] = ""
    meaning: ClassVar[str]
    off: ClassVar[float] = 0.0
    range: ClassVar[Range] = Range(minimum=0)
    colour: ClassVar[str]
    levels: ClassVar[tuple[float, ...]]
    mitigation: ClassVar[str] = "less of it"
    scans: ClassVar[tuple[str, ...]] = SCANS
    order: ClassVar[int] = 1000
    fewest_noise_draws: ClassVar[int] = 1
    counts_points: ClassVar[bool] = False
    shown_by: ClassVar[str] = ""
    told: ClassVar[bool] = False

    def label(self) -> str:
        """Title, symbol and unit, as an axis shows them."""
        return f"{self.title} {self.symbol}" + (f" [{self.unit}]" if self.unit else "")

    @classmethod
    def hook(cls) -> str:
        """Name of the hook through which the cause acts."""
        return next(name for name in HOOKS if getattr(cls, name) is not getattr(Cause, name))

    @classmethod
    def acts_on(cls, scan: str) -> bool:
        """Whether another level means another cloud of the `reference` or the `source`."""
        return cls.hook() in ("move", "keep") and scan in cls.scans

    @property
    def drawn(self) -> tuple[str, str] | tuple[()]:
        """What the runs of a noise draw share: what is drawn, and of what; () where nothing is."""
        of_what = {"move": f"of the {self.title}", "keep": "of the removed points"}
        return ("draw", of_what[self.hook()]) if self.hook() in of_what else ()

    @property
    def drawn_once(self) -> bool:
        """Whether all noise draws share it, too."""
        return self.hook() == "keep"

    @property
    def conflict(self) -> str:
        """What is wrong with its options together, after the name of one of them; "" if nothing."""
        return ""

    @property
    def acts_when_off(self) -> bool:
        """Whether it acts even where it is off or not named."""
        return self.replaces

    @property
    def adds_evenly(self) -> bool:
        """Whether white noise that it adds is the same for all points of both scans.

        Else nobody can tell how much the sensor's own noise adds to it.
        """
        return True

    @property
    def replaces(self) -> bool:
        """Whether it acts by `replace`; only `released_code` has that."""
        return False

    # --- the hooks --------------------------------------------------------------------------------

    def move(
        self, points: np.ndarray, scan: str, level: float, draw: int, streams: Streams
    ) -> np.ndarray:
        """The points (n, 3) [m] of a raw scan in its scanner's frame, as they are measured.

        scan: reference or source; draw: number of the noise draw; streams: random numbers by name.
        """
        return points

    def keep(
        self, pair: RawPair, scan: str, level: float, draw: int, streams: Streams
    ) -> np.ndarray:
        """Mask of the rows of a raw scan, reference (n,) or source (m,), that are left."""
        return np.ones(len(getattr(pair, scan)), dtype=bool)

    def start(self, deviation: np.ndarray, level: float) -> np.ndarray:
        """Standard deviation (6,) of the initial pose's error xi [rad x3, m x3]."""
        return deviation

    def thin(
        self, rows: np.ndarray, run: int, level: float, count: int, streams: Streams
    ) -> np.ndarray:
        """Of rows (k,) of a raw source scan of `count` points those that a run uses, ascending."""
        return rows

    # --- what an odd cause needs besides ----------------------------------------------------------

    def with_own_noise(self, sigma: float) -> Self:
        """The same with the sensor's own noise, of that standard deviation [m], in what it draws.

        Of the cause that is white noise of the sensor.
        """
        return self

    def of_pair(self, pair: RawPair) -> Self:
        """The cause for a Pair: where a hook needs more of it than it gets."""
        return self

    def check(self, pair: RawPair, level: float) -> None:
        """Raise PerturbationError if the level cannot be applied to a Pair."""

    def move_again(
        self, points: np.ndarray, scan: str, level: float, draw: int, streams: Streams
    ) -> np.ndarray:
        """The points (n, 3) [m] that ICP sees, where these are not those that `replace` sees."""
        return points

    def noise_variance(self, points: np.ndarray, scan: str, level: float) -> np.ndarray:
        """Variance [m^2] (n,) of the white noise that it adds to each coordinate of points (n, 3).

        For estimators that are told the noise. points [m] of a scan, as they are measured.
        """
        return np.zeros(len(points))

    def replace(
        self,
        pair: RawPair,
        reference: np.ndarray,
        source: np.ndarray,
        level: float,
        streams: Streams,
    ) -> np.ndarray:
        """The source (k, 3) [m] for the moved one (m, 3); its rows need not be the raw ones."""
        return source
