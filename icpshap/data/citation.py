"""Where the Challenging data sets come from, and how to cite them."""

DOI = "https://doi.org/10.3929/ethz-b-000721626"
LICENCE = "CC BY 4.0"
CITATION = (
    "F. Pomerleau, M. Liu, F. Colas, R. Siegwart: Challenging data sets for point cloud"
    " registration algorithms. The International Journal of Robotics Research 31(14), 2012."
)
NOTICE = f"Challenging data sets: {DOI}, licence {LICENCE}. Please cite {CITATION}"
