"""python -m icpshap: the command."""

from icpshap.cli import run

if __name__ == "__main__":
    run()
