"""From archives, folders and simulated scenes to one kind of table.

Fetching does not depend on a digest of the code: an edited library is no reason to download again.

Outputs: resources/{sequence}/scans/{batch}.parquet, resources/{sequence}/poses.parquet; where ICP
makes the poses, resources/{sequence}/registered/{batch}.parquet. A file holds the scans that one
job read, or simulated; those of an archive are fetched each into its own.
"""


rule fetch_scan:
    """Fetch a scan of an archive: of a remote one, little more than its own bytes."""
    input:
        archive=local_archive,
        # A wrong number of scans is said before any scan is fetched; more scans fetch no old one.
        poses=of_old(paths.SCANS, plan_of_scans, poses_of),
    output:
        paths.SCANS,
    log:
        "logs/fetch_scan/{sequence}/{batch}.log",
    benchmark:
        "logs/fetch_scan/{sequence}/{batch}.tsv"
    wildcard_constraints:
        sequence=keys_of_kind("archive"),
    priority: 20
    localrule: True
    threads: 1
    resources:
        mem_mb=1500,
        download=1,
    params:
        archive=lambda wildcards: sequence_of(wildcards).archive,
        cache=lambda wildcards: at(paths.ARCHIVE_CACHE, sequence=wildcards.sequence),
        plan=plan_of_scans,
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
    localrule: True
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


rule read_scans:
    """Read scans of a folder."""
    input:
        files_of_scans,
    output:
        paths.SCANS,
    log:
        "logs/read_scans/{sequence}/{batch}.log",
    benchmark:
        "logs/read_scans/{sequence}/{batch}.tsv"
    wildcard_constraints:
        sequence=keys_of_kind("folder"),
    priority: 20
    threads: 1
    resources:
        mem_mb=memory_of_files,
        runtime=time_of_files,
    params:
        plan=plan_of_scans,
        indices=lambda wildcards: list(indices_of_scans(wildcards)),
    script:
        "../scripts/read_scans.py"


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
    localrule: True
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


rule register_pairs:
    """Register consecutive scans of a folder that has no poses."""
    input:
        scans=scans_for(pairs_of_registrations),
        guess=lambda wildcards: PLANS.guess(wildcards.sequence) or [],
    output:
        paths.REGISTRATIONS,
    log:
        "logs/register_pairs/{sequence}/{batch}.log",
    benchmark:
        "logs/register_pairs/{sequence}/{batch}.tsv"
    wildcard_constraints:
        sequence=keys_of_folders(registers=True),
    priority: 20
    threads: 1
    resources:
        mem_mb=memory_of_scans(1050, 450),
        runtime=time_of_scans(pairs_of_registrations, time_limits.OF_POSE),
    params:
        scans=lambda wildcards: sequence_of(wildcards).scans,
        plan=lambda wildcards: PLANS.registrations(wildcards.sequence, int(wildcards.batch)),
    script:
        "../scripts/register_pairs.py"


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
    localrule: True
    threads: 1
    resources:
        mem_mb=500,
    params:
        plan=lambda wildcards: PLANS.poses(wildcards.sequence),
    script:
        "../scripts/register_poses.py"


rule simulate_scans:
    """Simulate scans of a built-in scene."""
    output:
        paths.SCANS,
    log:
        "logs/simulate_scans/{sequence}/{batch}.log",
    benchmark:
        "logs/simulate_scans/{sequence}/{batch}.tsv"
    wildcard_constraints:
        sequence=keys_of_kind("simulated"),
    priority: 20
    threads: 1
    resources:
        mem_mb=growing(1000),
        runtime=growing(time_limits.FEWEST),
    params:
        plan=plan_of_scans,
    script:
        "../scripts/simulate_scans.py"


rule simulate_poses:
    """Simulate the poses of the scans of a built-in scene."""
    output:
        paths.POSES,
    log:
        "logs/simulate_poses/{sequence}.log",
    benchmark:
        "logs/simulate_poses/{sequence}.tsv"
    wildcard_constraints:
        sequence=keys_of_kind("simulated"),
    priority: 20
    localrule: True
    threads: 1
    resources:
        mem_mb=1000,
    params:
        plan=lambda wildcards: PLANS.poses(wildcards.sequence),
        scans=lambda wildcards: sequence_of(wildcards).scans,
    script:
        "../scripts/simulate_poses.py"
