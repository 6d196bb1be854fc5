"""The workflow on a Slurm cluster of one machine: the bytes, the faults, what a job costs there."""
