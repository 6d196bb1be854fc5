"""The options of an ICP chain, for every kind that registers with our own engine."""

from dataclasses import dataclass

from icpshap.estimators.kind import Kind
from icpshap.options import option


@dataclass(frozen=True)
class ChainKind(Kind):
    """A kind that registers by the chain that its options describe."""

    metric: str = option(
        "point_to_plane",
        "Error metric of ICP",
        choices=("point_to_plane", "point_to_point"),
    )
    normal_neighbours: int = option(
        7,
        "Neighbours of a normal, the point itself included",
        unit="-",
        minimum=3,
        maximum=50,
    )
    normal_radius: float | None = option(
        None,
        "All points within this distance of a point give its normal, at least normal_neighbours of "
        "them; null: no more than these",
        unit="m",
        above=0,
        maximum=1e4,
    )
    matches: int = option(
        3, "Reference points linked to each source point", unit="-", minimum=1, maximum=5
    )
    kept_links: float = option(
        0.7,
        "Share of links, the closest, that the outlier filter keeps; 1 keeps all",
        unit="-",
        above=0,
        maximum=1,
    )
    maximum_distance: float | None = option(
        None, "Longer links are not made; null for no limit", unit="m", above=0, maximum=1e6
    )
    maximum_iterations: int = option(
        150,
        "ICP stops at the latest after this many iterations",
        unit="-",
        minimum=1,
        maximum=10000,
    )
    stop_rotation: float = option(
        0.001,
        "ICP stops when the mean of the last 3 steps is below this and below stop_translation",
        unit="rad",
        minimum=0,
        maximum=10,
    )
    stop_translation: float = option(
        0.01,
        "ICP stops when the mean of the last 3 steps is below this and below stop_rotation",
        unit="m",
        minimum=0,
        maximum=1e6,
    )

    @property
    def neighbourhood(self):
        if self.metric == "point_to_point":
            return None
        return self.normal_neighbours, self.normal_radius or 0.0

    def chain(self):
        """The ICP chain that the options describe."""
        from icpshap import icp  # compiled code is loaded where it runs, not where options are read

        to_plane = self.metric == "point_to_plane"
        return icp.Chain(
            error_minimiser=icp.PointToPlane() if to_plane else icp.PointToPoint(),
            matches=self.matches,
            outlier_filter=icp.Trimmed(self.kept_links),
            maximum_distance=self.maximum_distance,
            stopping=icp.Stopping(
                self.maximum_iterations, self.stop_rotation, self.stop_translation
            ),
        )

    def reference(self, points):
        """The icp.Reference of points (n, 3) [m], with the normals that the options describe."""
        from icpshap import icp

        return icp.Reference(points, self.normal_neighbours, self.normal_radius)

    def from_truth(self, group, reference, start):
        """icp.Registrations of one run of a perturb.Start: from the true pose, with its first rows.

        reference: icp.Reference of the group's points.
        """
        from icpshap import icp

        T_true = group.pair.T_reference_source
        return icp.register(reference, start.source, start.rows[:1], T_true[None], self.chain())
