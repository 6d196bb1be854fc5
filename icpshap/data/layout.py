"""What the folders and archives of a sequence have in common: names, places, how many scans."""

LEICA_NAME = "pose_scanner_leica.csv"
LEICA_PLACES = ("leica", "csv_global", "csv_local")  # the first that holds poses is the one to use
REGISTER = "register"  # in place of a pose file: ICP makes the poses
SCALAR_LAST, SCALAR_FIRST = ORDERS = ("xyzw", "wxyz")  # of quaternions
MINIMUM_SCANS = 2  # the reference and the source of one pair
