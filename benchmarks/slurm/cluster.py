"""A cluster of one machine: Slurm's controller, a node daemon and munge on loopback, no systemd.

Snakemake's plug-in removes SLURM_* inside jobs, so that the configuration has to lie where Slurm
looks for it by default. One that is there already and is not ours is left alone.
"""

import os
import signal
import socket
import subprocess
import tempfile
import time
from pathlib import Path

from icpshap.errors import UserError

CONFIGURATION = Path("/etc/slurm/slurm.conf")
OURS = "# Written by icpshap's benchmarks.slurm; may be removed when that does not run.\n"
PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scontrol", "scancel", "sinfo")
CPUS = 2
NODE_IS_LOST = 10  # seconds without a word of the node daemon
REQUEUED_AFTER = 30  # seconds, of a job whose node was lost; 120 usually
SECONDS = 60  # until a node is idle, or down
OPTIONS = {
    "ClusterName": "one",
    "SlurmUser": "root",
    "SlurmdUser": "root",
    "AuthType": "auth/munge",
    "SlurmctldPort": 16817,
    "SlurmdPort": 16818,
    "ProctrackType": "proctrack/linuxproc",
    "TaskPlugin": "task/none",
    "SwitchType": "switch/none",
    "MpiDefault": "none",
    "SelectType": "select/cons_tres",
    "SelectTypeParameters": "CR_Core_Memory",
    "AccountingStorageType": "accounting_storage/none",
    "JobAcctGatherType": "jobacct_gather/none",
    # Without accounting, ended jobs are asked for here.
    "MinJobAge": 3600,
    # A node that was lost serves again when it is back; one that was set down, when it is resumed.
    "ReturnToService": 1,
    "SlurmdTimeout": NODE_IS_LOST,
    "KillWait": 2,
    "SchedulerParameters": "sched_interval=1,batch_sched_delay=0,sched_min_interval=0",
}


def missing():
    """Why no cluster can be started here; "" if one can."""
    folders = os.get_exec_path()
    absent = [
        name for name in PROGRAMS if not any(Path(folder, name).is_file() for folder in folders)
    ]
    if absent:
        return f"{', '.join(absent)} not found. Hint: apt-get install slurm-wlm munge"
    return "" if os.geteuid() == 0 else "only root may start Slurm's daemons"


def asked(*command):
    """What a command of Slurm says."""
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


class Cluster:
    """Context of a running cluster with one node; `options` are laid over those of slurm.conf."""

    def __init__(self, **options):
        self.node = socket.gethostname().partition(".")[0]
        self.options = options

    def __enter__(self):
        if reason := missing():
            raise UserError(reason)
        if CONFIGURATION.exists() and not CONFIGURATION.read_text(encoding="utf-8").startswith(
            OURS
        ):
            raise UserError(
                f"{CONFIGURATION}: there is a configuration of Slurm that is not ours.\n"
                "Hint: on a machine of a cluster use the cluster; this starts one of its own."
            )
        self._temporary = tempfile.TemporaryDirectory(prefix="slurm_")
        self.folder = Path(self._temporary.name)
        try:
            self._start()
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(self, *_):
        self._end()

    def _start(self):
        self.folder.chmod(0o755)
        for name in ("state", "spool", "munge"):
            (self.folder / name).mkdir(mode=0o755)
        self._start_munge()
        CONFIGURATION.parent.mkdir(parents=True, exist_ok=True)
        CONFIGURATION.write_text(OURS + self.configuration(), encoding="utf-8")
        subprocess.run(["slurmctld"], check=True)
        self.start_node()

    def _start_munge(self):
        munge = self.folder / "munge"
        key = munge / "key"
        key.write_bytes(os.urandom(1024))
        key.chmod(0o400)
        places = {"key-file": key, "socket": munge / "socket", "pid-file": munge / "pid"}
        places |= {"log-file": munge / "log", "seed-file": munge / "seed"}
        subprocess.run(
            ["munged", "--force", *(f"--{name}={path}" for name, path in places.items())],
            check=True,
        )

    def configuration(self):
        """The text of slurm.conf."""
        megabytes = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2**20
        places = {
            "SlurmctldHost": f"{self.node}(127.0.0.1)",
            "AuthInfo": f"socket={self.folder}/munge/socket,cred_expire={REQUEUED_AFTER}",
            "StateSaveLocation": self.folder / "state",
            "SlurmdSpoolDir": self.folder / "spool",
        }
        for name in ("Slurmctld", "Slurmd"):
            places[f"{name}PidFile"] = self.folder / f"{name.lower()}.pid"
            places[f"{name}LogFile"] = self.folder / f"{name.lower()}.log"
        lines = [f"{key}={value}" for key, value in {**OPTIONS, **places, **self.options}.items()]
        lines += [
            f"NodeName={self.node} NodeAddr=127.0.0.1 CPUs={CPUS} RealMemory={megabytes}",
            f"PartitionName=main Nodes={self.node} Default=YES MaxTime=INFINITE State=UP",
        ]
        return "\n".join(lines) + "\n"

    def start_node(self):
        """Start the node daemon, and wait until the node serves."""
        subprocess.run(["slurmd", "-N", self.node], check=True)
        self.wait_until("idle", "mix", "alloc")

    def lose_node(self, processes):
        """End the node daemon, the daemons of its jobs and their `processes`, as a power cut does.

        Returns when the controller has noticed.
        """
        stepping = {_parent(number) for number in processes}
        daemons = [number for number in stepping if _name(number).startswith("slurmstepd")]
        for number in (self._pid("slurmd.pid"), *daemons, *processes):
            _end(number, signal.SIGKILL)
        self.wait_until("down", "down*")

    def wait_until(self, *states):
        """Wait until the node is in one of these states."""
        began = time.monotonic()
        while (found := asked("sinfo", "-h", "-o", "%t")) not in states:
            if time.monotonic() - began > SECONDS:
                raise UserError(f"the node is {found}, expected {' or '.join(states)}")
            time.sleep(0.5)

    def _end_jobs(self):
        """Daemons of jobs would go on without a controller, and look for it."""
        began = time.monotonic()
        while time.monotonic() - began < SECONDS:
            subprocess.run(["scancel", "--user=root"], capture_output=True)
            left = subprocess.run(["squeue", "-h"], capture_output=True, text=True)
            if not left.stdout:
                return
            time.sleep(0.5)

    def _pid(self, name):
        try:
            return int((self.folder / name).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None

    def _end(self):
        """End jobs and daemons, in this order, and leave nothing behind."""
        if self._pid("slurmctld.pid"):
            self._end_jobs()
        for name in ("slurmd.pid", "slurmctld.pid", "munge/pid"):
            _end(self._pid(name), signal.SIGTERM)
        if CONFIGURATION.exists() and CONFIGURATION.read_text(encoding="utf-8").startswith(OURS):
            CONFIGURATION.unlink()
        self._temporary.cleanup()


def _end(number, how, limit=20):
    """Send a process a signal, and wait until it is gone."""
    began = time.monotonic()
    try:
        while number and time.monotonic() - began < limit:
            os.kill(number, how)
            if _state(number) == "Z":
                return
            how = 0
            time.sleep(0.1)
    except ProcessLookupError:
        pass


def _stat(number):
    try:
        return Path(f"/proc/{number}/stat").read_text(encoding="utf-8")
    except OSError:
        return "0 () Z 0"


def _state(number):
    return _stat(number).rpartition(")")[2].split()[0]


def _parent(number):
    return int(_stat(number).rpartition(")")[2].split()[1])


def _name(number):
    return _stat(number).partition("(")[2].rpartition(")")[0]
