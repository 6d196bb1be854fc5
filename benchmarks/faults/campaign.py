"""The families of faults, and the finished run that they are done to."""

import shutil
import time

from benchmarks.faults import (
    damage,
    disk,
    door,
    guarded,
    inputs,
    keys,
    library,
    places,
    processes,
    surroundings,
    values,
)
from benchmarks.faults.outcome import Tried
from benchmarks.faults.workplace import TABLES, Workplace, write_scans

IN_PROCESS = 30  # seconds of a fault that is tried without Snakemake


class Campaign:
    """Where the faults are done, and to what."""

    def __init__(self, folder, seed, short):
        self.folder = folder
        self.seed = seed
        self.short = short
        self.seconds = None  # that the run without faults took
        self.tables = TABLES
        self.finished = self._finished()
        self.expected = self.finished.bytes()

    def _finished(self):
        """A workplace whose tables are made; one that an earlier campaign left serves again."""
        place = Workplace(self.folder / "finished")
        if not (place.folder / TABLES[-1]).exists():
            shutil.rmtree(place.folder, ignore_errors=True)
            place = Workplace.new(place.folder)
            # Compiles the engine, where this has not happened, before a run is timed.
            _run(place, f"{TABLES[-1]}")
            shutil.rmtree(place.folder)
            place = Workplace.new(place.folder)
            began = time.monotonic()
            _run(place, *TABLES)
            (place.folder / "seconds").write_text(str(time.monotonic() - began))
        self.seconds = float((place.folder / "seconds").read_text())
        return place

    def copy(self, name):
        """A copy of the finished workplace, in which a fault can be done."""
        folder = self.folder / name
        shutil.rmtree(folder, ignore_errors=True)
        return self.finished.copy(folder)


def _run(place, *targets):
    code, said = place.run("--", *targets)
    if code != 0:
        raise RuntimeError(f"The run without faults failed:\n{said}")


def damaged_files(campaign):
    place = campaign.copy("damage")
    arguments = (place.folder, place.config(), campaign.seed, 1 if campaign.short else 5)
    return guarded.tried("damaged files", damage.faults, arguments, IN_PROCESS)


def edited_keys(campaign):
    place = campaign.copy("keys")
    write_others(place.folder)
    arguments = (place.folder, place.config(), campaign.short)
    yield from guarded.tried("configuration keys edited", keys.faults, arguments, 4 * IN_PROCESS)
    found = keys.dry_runs(campaign.copy("dry"), campaign.short)
    yield from attempted("configuration keys edited", found)


def write_others(folder):
    """What a configuration may name in the place of the scans and the poses."""
    write_scans(folder / "others", seed=1)
    shutil.copy(folder / "scans" / "poses.txt", folder / "scans" / "poses_2.txt")


def hostile_values(campaign):
    place = campaign.copy("values")
    number = 20 if campaign.short else 300
    arguments = (str(place.folder), place.config(), campaign.seed, number, campaign.short)
    return guarded.tried("hostile configurations", values.faults, arguments, IN_PROCESS)


def misplaced_files(campaign):
    return attempted("files swapped, older, left over", places.faults(campaign))


def killed_processes(campaign):
    return attempted("processes killed", processes.faults(campaign, 2 if campaign.short else 20))


def full_disks(campaign):
    family = "full and read-only disks"
    place = campaign.copy("disk")
    yield from guarded.tried(family, disk.faults_in_process, (place.folder,), IN_PROCESS)
    if not campaign.short:
        yield from attempted(family, disk.faults(campaign))


def edited_library(campaign):
    return attempted("library edited during a run", library.faults(campaign))


def odd_surroundings(campaign):
    family = "cache, language, logs"
    arguments = (str(campaign.folder), campaign.seed)
    yield from guarded.tried(family, surroundings.faults_of_logs, arguments, IN_PROCESS)
    number = 2 if campaign.short else 16
    yield from attempted(family, surroundings.faults_of_cache(campaign, campaign.seed, number))
    if not campaign.short:
        yield from attempted(family, surroundings.faults_of_cache_folder(campaign))
        yield from attempted(family, surroundings.faults_of_language(campaign))


def one_pair(campaign):
    arguments = (str(campaign.folder / "door"), campaign.seed, 40 if campaign.short else 600)
    arguments += (campaign.short,)
    return guarded.tried("function and command", door.faults, arguments, IN_PROCESS)


def hostile_inputs(campaign):
    """Continuous integration runs these tests anyway."""
    return iter(()) if campaign.short else inputs.tried("hostile scans and archives")


def attempted(family, faults):
    """Tried of every fault, one after the other."""
    for fault in faults:
        yield Tried(family, fault.text, fault.attempt())


FAMILIES = {
    "damage": damaged_files,
    "places": misplaced_files,
    "keys": edited_keys,
    "values": hostile_values,
    "processes": killed_processes,
    "disk": full_disks,
    "library": edited_library,
    "surroundings": odd_surroundings,
    "door": one_pair,
    "inputs": hostile_inputs,
}


def run(folder, seed, short, only=None):
    """Tried of every fault of the families, or of some."""
    campaign = Campaign(folder, seed, short)
    for name in only or FAMILIES:
        yield from FAMILIES[name](campaign)
