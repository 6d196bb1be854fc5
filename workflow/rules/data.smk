"""From archives, folders and simulated scenes to one kind of table.

Outputs: resources/{sequence}/scan_{index}.parquet, resources/{sequence}/poses.parquet
"""

from icpshap.dataset import DataError, find_folder_files


def folder_files(wildcards):
    """Scan files and pose file of a folder sequence, known without reading them."""
    sequence = sequence_of(wildcards)
    try:
        return find_folder_files(
            sequence.folder["path"], sequence.scans, sequence.folder.get("poses")
        )
    except DataError as error:
        raise WorkflowError(f"data.{sequence.key}: {error}") from None


def local_archive(wildcards):
    return sequence_of(wildcards).archive.get("path", [])


rule read_scan:
    """Read a scan of a folder."""
    input:
        lambda wildcards: folder_files(wildcards)[0][int(wildcards.index)],
    output:
        "resources/{sequence}/scan_{index}.parquet",
    log:
        "logs/read_scan/{sequence}/{index}.log",
    benchmark:
        "logs/read_scan/{sequence}/{index}.tsv"
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=code_digest("read_scan"),
        drop_non_finite=lambda wildcards: sequence_of(wildcards).drop_non_finite,
    priority: 10
    wildcard_constraints:
        sequence=keys_of_kind("folder"),
    script:
        "../scripts/read_scan.py"


rule read_poses:
    """Read the poses of a folder."""
    input:
        lambda wildcards: folder_files(wildcards)[1],
    output:
        "resources/{sequence}/poses.parquet",
    log:
        "logs/read_poses/{sequence}.log",
    benchmark:
        "logs/read_poses/{sequence}.tsv"
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=code_digest("read_poses"),
        scans=lambda wildcards: sequence_of(wildcards).scans,
    priority: 10
    wildcard_constraints:
        sequence=keys_of_kind("folder"),
    script:
        "../scripts/read_poses.py"


rule simulate_sequence:
    """Simulate the scans of a built-in scene; one job makes one scan or the poses."""
    output:
        "resources/{sequence}/{part}.parquet",
    log:
        "logs/simulate_sequence/{sequence}/{part}.log",
    benchmark:
        "logs/simulate_sequence/{sequence}/{part}.tsv"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        code=code_digest("simulate_sequence"),
        scans=lambda wildcards: sequence_of(wildcards).scans,
        simulated=lambda wildcards: sequence_of(wildcards).simulated,
        seed=SETTINGS.seed,
    priority: 10
    wildcard_constraints:
        sequence=keys_of_kind("simulated"),
        part=r"poses|scan_\d+",
    script:
        "../scripts/simulate_sequence.py"


rule measure_overlap:
    """Mark the source points of a pair that overlap with the reference at the true pose."""
    input:
        reference="resources/{sequence}/scan_{reference}.parquet",
        source="resources/{sequence}/scan_{source}.parquet",
        poses="resources/{sequence}/poses.parquet",
    output:
        "resources/{sequence}/overlap/{reference}-{source}.parquet",
    log:
        "logs/measure_overlap/{sequence}/{reference}-{source}.log",
    benchmark:
        "logs/measure_overlap/{sequence}/{reference}-{source}.tsv"
    threads: 1
    resources:
        mem_mb=500,
    params:
        code=code_digest("measure_overlap"),
        distance=SETTINGS.perturbation.overlap_distance,
    priority: 10
    script:
        "../scripts/measure_overlap.py"
