"""How the settings fit the scans: measured before any ICP, judged, and what mends them.

`measure` makes a row of numbers of a pair; `checks` turns it into the fit table. Nothing of it
decides a registration: other words or limits of a check register nothing again.
"""
