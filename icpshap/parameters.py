"""The parameters that a registration and its uncertainty take, each the config key of its name.

Apart from the checking of a configuration, whose changes are no reason to register again.
"""

from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Perturbation:
    """What the uncertainty sources refer to; units in the schema."""

    initial_pose_rotation: float
    initial_pose_translation: float
    overlap_distance: float
    minimum_overlap: float


@dataclass(frozen=True)
class Registration:
    """From a perturbed pair to pose samples; each field is the config key of the same name."""

    runs: int
    minimum_range: float
    subsampling_probability: float
    subsampling_mask: str
    metric: str
    normal_neighbours: int
    matches: int
    kept_links: float
    maximum_distance: float | None
    maximum_iterations: int
    stop_rotation: float
    stop_translation: float
    initial_pose_scaling: str
    initial_pose_composition: str
    noise_draws: int
    reference_noise_additions: int
    overlap_removal: str
    common_random_numbers: bool
    wrong_basin_translation: float
    wrong_basin_rotation: float


@dataclass(frozen=True)
class Estimator(Registration):
    """From a perturbed pair to an uncertainty: a registration, and how its samples are read."""

    covariance_floor_rotation: float
    covariance_floor_translation: float
    divergence: str
    bias_correction: str
    wrong_basins: str
    interval: str

    @property
    def registration(self):
        """The part that decides the pose samples."""
        keys = Registration.__dataclass_fields__
        return Registration(**{key: getattr(self, key) for key in keys})

    @property
    def method(self):
        """The other part, by key: how numbers are read off the pose samples."""
        keys = Registration.__dataclass_fields__
        return {key: value for key, value in asdict(self).items() if key not in keys}
