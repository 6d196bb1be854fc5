"""icpshap: why is this point cloud registration uncertain?"""
