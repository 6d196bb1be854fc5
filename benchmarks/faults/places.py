"""Files in a place that is not theirs: swapped, older, of another seed, left over."""

import os
import shutil
from functools import partial
from pathlib import Path

from benchmarks.faults.outcome import Fault, Outcome
from benchmarks.faults.workplace import Workplace, write_scans

RUNS = "results/tiny_fixed/own/runs"
OVERLAPS = "results/tiny_fixed/own/overlaps/0.parquet"
SWAPS = (
    (f"{RUNS}/0.parquet", f"{RUNS}/2.parquet"),
    ("results/tiny_fixed/own/pairs/0.parquet", "results/tiny_pose/tiny_room/pairs/0.parquet"),
    (OVERLAPS, "results/tiny_pose/tiny_room/overlaps/0.parquet"),
    ("resources/own/scans/0.parquet", "resources/tiny_room/scans/0.parquet"),
    ("resources/own/poses.parquet", "resources/tiny_room/poses.parquet"),
    ("results/tiny_fixed/own/shap.parquet", "results/tiny_fixed/own/uncertainty.parquet"),
    ("results/tiny_fixed/shap.parquet", "results/tiny_pose/shap.parquet"),
    (f"{RUNS}/0.parquet", "results/tiny_pose/tiny_room/runs/0.parquet"),
)
OF_ANOTHER_SEED = (f"{RUNS}/1.parquet", "results/tiny_fixed/own/shap.parquet")
TRIGGERS = ("--rerun-triggers", "mtime")


def faults(campaign):
    """Faults of files that lie where another should; each in a copy of the finished workplace."""

    def fault(words, act, *names, judge=None, **judged):
        def attempt():
            place = campaign.copy("place")
            act(place)
            if judge:
                return judge(campaign, place)
            return place.judged(campaign.expected, *names, **judged)

        return Fault(words, attempt)

    for one, other in SWAPS[: 1 if campaign.short else None]:
        names = (one, other, Path(one).name)
        words = f"{one} and {other} swapped, dates kept"
        act = partial(swap, one=one, other=other)
        yield fault(words, act, *names, removed=(one, other))
        if not campaign.short:
            forced = ("--forcerun", "explain_sequence")
            yield fault(f"{words}, explained by force", act, *names, arguments=forced)
    yield fault("an older scan in the place of a newer", older_scan, judge=as_fresh)
    if campaign.short:
        return
    yield from _of_other_runs(campaign, fault)
    yield from _of_sources(fault)
    yield from _left_over(fault)
    yield Fault("the whole folder moved elsewhere", partial(_moved, campaign))


def _of_other_runs(campaign, fault):
    other = _of_another_seed(campaign)
    for path in OF_ANOTHER_SEED:
        act = partial(_put, other=other, path=path)
        words = f"{path} of another seed in place"
        yield fault(words, act, path, removed=[path])
        yield fault(f"{words}, older", partial(_put, other=other, path=path, age=10**6), path)
        yield fault(
            f"{words}, .snakemake lost", partial(_put, other=other, path=path, lost=1), path
        )
        yield fault(f"{words}, by date alone", act, path, arguments=TRIGGERS)
    for path in OF_ANOTHER_SEED:
        damaged = partial(_emptied, path=path)
        yield fault(f"{path} emptied, .snakemake lost", damaged, path, removed=[path])


def _of_sources(fault):
    yield fault("a newer scan in the place of an older", partial(older_scan, age=0), judge=as_fresh)
    yield fault("older poses in the place of newer", _older_poses, judge=as_fresh)
    yield fault(
        "a scan touched", lambda place: (place.folder / "scans/s1.csv").touch(), judge=as_fresh
    )


def _left_over(fault):
    yield fault(".snakemake lost", _lose)
    yield fault("chunks of another cut left over", _other_cut)
    yield fault("a .part of a killed job left over", _part)
    yield fault("a dry run with another seed before", partial(_begun, arguments=["-n"]))
    yield fault("a run with another seed before", partial(_begun, arguments=[]))
    yield fault("everything touched", lambda place: place.run("--touch"))
    touched = partial(_begun, arguments=["--touch"])
    yield fault("everything touched with another seed", touched)
    yield fault("all dates one", _one_date)
    yield fault("the clock set back: dates in the future", partial(_one_date, seconds=4e9))
    yield fault("all tables of an explanation removed", _without_tables)
    yield fault("pairs named in another order", _other_order, judge=as_fresh)


def swap(place, one, other):
    one, other = place.folder / one, place.folder / other
    between = one.with_name("between")
    one.rename(between)
    other.rename(one)
    between.rename(other)


def older_scan(place, age=10**7):
    """Another scan, dated before all that was made of the one that it replaces."""
    write_scans(place.folder / "others", seed=1)
    scan = place.folder / "others" / "s1.csv"
    now = scan.stat().st_mtime
    os.utime(scan, (now - age, now - age))
    scan.replace(place.folder / "scans" / "s1.csv")


def _older_poses(place):
    path = place.folder / "scans" / "poses.txt"
    before = path.stat().st_mtime
    path.write_text(path.read_text().replace(" 0.1 ", " 0.12 "))
    os.utime(path, (before - 10**7, before - 10**7))


def as_fresh(campaign, place):
    """The outcome of a run: the bytes of a fresh run of the same scans and configuration."""
    fresh = Workplace(campaign.folder / "fresh")
    shutil.rmtree(fresh.folder, ignore_errors=True)
    fresh.folder.mkdir()
    shutil.copytree(place.folder / "scans", fresh.folder / "scans")
    fresh.configure(place.config())
    code, said = fresh.run("--", *campaign.tables)
    if code != 0:
        return Outcome("crash", f"a fresh run failed: {said[-300:]}")
    return place.judged(fresh.bytes())


def _of_another_seed(campaign):
    """A workplace with the runs and tables of another seed."""
    other = campaign.copy("other_seed")
    other.configure({**other.config(), "seed": 7})
    code, said = other.run("--", *campaign.tables)
    if code != 0:
        raise RuntimeError(f"The run with another seed failed:\n{said}")
    return other


def _put(place, other, path, age=0, lost=False):
    shutil.copy2(other.folder / path, place.folder / path)
    date = (place.folder / path).stat().st_mtime - age
    os.utime(place.folder / path, (date, date))
    if lost:
        _lose(place)


def _lose(place):
    shutil.rmtree(place.folder / ".snakemake")


def _emptied(place, path):
    before = (place.folder / path).stat()
    (place.folder / path).write_bytes(b"")
    os.utime(place.folder / path, (before.st_atime, before.st_mtime))
    _lose(place)


def _other_cut(place):
    config = place.config()
    place.configure({**config, "runs_per_job": 120})
    place.run("--", *place.tables)
    place.configure(config)


def _part(place):
    path = place.folder / RUNS / "0.parquet"
    path.with_name("0.parquet.part").write_bytes(path.read_bytes()[:1000])
    path.unlink()


def _begun(place, arguments):
    """What another configuration leaves behind before the old one is taken up again."""
    place.run("--config", "seed=7", *arguments, "--", *place.tables)


def _one_date(place, seconds=1.7e9):
    for top in ("scans", "resources", "results"):
        for path in (place.folder / top).rglob("*.*"):
            if top != "scans":
                os.utime(path, (seconds, seconds))


def _without_tables(place):
    for path in (place.folder / "results/tiny_fixed/own").glob("*.parquet"):
        path.unlink()


def _other_order(place):
    config = place.config()
    pairs = [{"sequence": "own", "reference": k, "source": k + 1} for k in (1, 0)]
    fixed = config["experiments"]["tiny_fixed"]
    del fixed["sequences"]
    fixed["pairs"] = pairs
    place.configure(config)


def _moved(campaign):
    place = campaign.copy("moved")
    return place.judged(campaign.expected)
