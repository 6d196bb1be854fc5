"""icpshap: why is this point cloud registration uncertain?"""


def load_explanation(path):
    """The shap.Explanation of a shap.parquet, see `icpshap.explanation.load_explanation`."""
    from icpshap import explanation

    return explanation.load_explanation(path)
