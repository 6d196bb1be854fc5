"""From archives, folders and simulated scenes to one kind of table.

Fetching does not depend on a digest of the code: an edited library is no reason to download again.

Outputs: resources/{sequence}/scan_{index}.parquet, resources/{sequence}/poses.parquet; where ICP
makes the poses, resources/{sequence}/registered/{reference}-{source}.parquet
"""


rule fetch_scan:
    """Fetch a scan of an archive: of a remote one, little more than its own bytes."""
    input:
        archive=local_archive,
        # A wrong number of scans is said before any scan is fetched; more scans fetch no old one.
        poses=poses_for(paths.SCAN, plan_of_scan),
    output:
        paths.SCAN,
    log:
        "logs/fetch_scan/{sequence}/{index}.log",
    benchmark:
        "logs/fetch_scan/{sequence}/{index}.tsv"
    wildcard_constraints:
        sequence=keys_of_kind("archive"),
    priority: 20
    threads: 1
    resources:
        mem_mb=1500,
        download=1,
    params:
        archive=lambda wildcards: sequence_of(wildcards).archive,
        cache=lambda wildcards: at(paths.ARCHIVE_CACHE, sequence=wildcards.sequence),
        plan=plan_of_scan,
    script:
        "../scripts/fetch_scan.py"


rule fetch_poses:
    """Fetch the poses of an archive."""
    input:
        local_archive,
    output:
        paths.POSES,
    log:
        "logs/fetch_poses/{sequence}.log",
    benchmark:
        "logs/fetch_poses/{sequence}.tsv"
    wildcard_constraints:
        sequence=keys_of_kind("archive"),
    priority: 20
    threads: 1
    resources:
        mem_mb=500,
        download=1,
    params:
        archive=lambda wildcards: sequence_of(wildcards).archive,
        cache=lambda wildcards: at(paths.ARCHIVE_CACHE, sequence=wildcards.sequence),
        scans=lambda wildcards: sequence_of(wildcards).scans,
        plan=lambda wildcards: PLANS.poses(wildcards.sequence),
    script:
        "../scripts/fetch_poses.py"


rule read_scan:
    """Read a scan of a folder."""
    input:
        lambda wildcards: FOLDER_FILES[wildcards.sequence][0][int(wildcards.index)],
    output:
        paths.SCAN,
    log:
        "logs/read_scan/{sequence}/{index}.log",
    benchmark:
        "logs/read_scan/{sequence}/{index}.tsv"
    wildcard_constraints:
        sequence=keys_of_kind("folder"),
    priority: 20
    threads: 1
    resources:
        mem_mb=lambda wildcards, input: 300 + round(10 * input.size_mb),
    params:
        plan=plan_of_scan,
    script:
        "../scripts/read_scan.py"


rule read_poses:
    """Read the poses of a folder."""
    input:
        lambda wildcards: FOLDER_FILES[wildcards.sequence][1],
    output:
        paths.POSES,
    log:
        "logs/read_poses/{sequence}.log",
    benchmark:
        "logs/read_poses/{sequence}.tsv"
    wildcard_constraints:
        sequence=keys_of_folders(registers=False),
    priority: 20
    threads: 1
    resources:
        mem_mb=memory_of_poses,
    params:
        # Not input: of most formats no scan is read.
        scans=lambda wildcards: [str(path) for path in FOLDER_FILES[wildcards.sequence][0]],
        names=scan_names,
        drop_non_finite=lambda wildcards: sequence_of(wildcards).drop_non_finite,
        plan=lambda wildcards: PLANS.poses(wildcards.sequence),
    script:
        "../scripts/read_poses.py"


rule register_pair:
    """Register two consecutive scans of a folder that has no poses."""
    input:
        reference=scan_of_pair("reference"),
        source=scan_of_pair("source"),
        guess=lambda wildcards: PLANS.guess(wildcards.sequence) or [],
    output:
        paths.REGISTRATION,
    log:
        "logs/register_pair/{sequence}/{reference}-{source}.log",
    benchmark:
        "logs/register_pair/{sequence}/{reference}-{source}.tsv"
    wildcard_constraints:
        sequence=keys_of_folders(registers=True),
    priority: 20
    threads: 1
    resources:
        mem_mb=memory_of_scans(1050, 450),
    params:
        scans=lambda wildcards: sequence_of(wildcards).scans,
        plan=lambda wildcards: PLANS.registration(wildcards.sequence, int(wildcards.reference)),
    script:
        "../scripts/register_pair.py"


rule register_poses:
    """Chain the registrations of consecutive scans into poses."""
    input:
        registrations_of,
    output:
        paths.POSES,
    log:
        "logs/register_poses/{sequence}.log",
    benchmark:
        "logs/register_poses/{sequence}.tsv"
    wildcard_constraints:
        sequence=keys_of_folders(registers=True),
    priority: 20
    threads: 1
    resources:
        mem_mb=500,
    params:
        plan=lambda wildcards: PLANS.poses(wildcards.sequence),
    script:
        "../scripts/register_poses.py"


rule simulate_sequence:
    """Simulate the scans of a built-in scene; one job makes one scan or the poses."""
    output:
        paths.RESOURCE,
    log:
        "logs/simulate_sequence/{sequence}/{part}.log",
    benchmark:
        "logs/simulate_sequence/{sequence}/{part}.tsv"
    wildcard_constraints:
        sequence=keys_of_kind("simulated"),
        part=r"poses|scan_\d+",
    priority: 20
    threads: 1
    resources:
        mem_mb=1000,
    params:
        plan=plan_of_part,
        scans=scans_until,
    script:
        "../scripts/simulate_sequence.py"


rule measure_overlap:
    """Mark the source points of a pair that overlap with the reference at the true pose."""
    input:
        reference=scan_of_pair("reference"),
        source=scan_of_pair("source"),
        poses=poses_for(paths.OVERLAP, plan_of_overlap),
    output:
        paths.OVERLAP,
    log:
        "logs/measure_overlap/{sequence}/{reference}-{source}.log",
    benchmark:
        "logs/measure_overlap/{sequence}/{reference}-{source}.tsv"
    priority: 20
    threads: 1
    resources:
        mem_mb=memory_of_scans(300, 250),
    params:
        plan=plan_of_overlap,
    script:
        "../scripts/measure_overlap.py"
