"""icpshap: why is this point cloud registration uncertain?"""


def load_explanation(path):
    """The shap.Explanation of a shap.parquet, see `icpshap.explanation.load_explanation`."""
    from icpshap.explanation import games as explanation

    return explanation.load_explanation(path)
