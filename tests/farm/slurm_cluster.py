"""A Slurm of two nodes on this machine, in a folder of its own, for tests: munged, slurmctld and two slurmd that
listen on the loopback, started and stopped as whoever runs this."""

import getpass
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import time

PROGRAMS = ["munged", "slurmctld", "slurmd", "sbatch", "squeue", "scontrol", "scancel"]


class CannotStart(Exception):
    """Why there is no Slurm here."""


def find(program):
    path = shutil.which(program, path=os.environ.get("PATH", "") + ":/usr/sbin:/sbin")
    if not path:
        raise CannotStart(f"{program} is not installed (Debian: slurm-wlm, munge)")
    return path


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Cluster:
    NODES = ["n1", "n2"]

    def __init__(self, folder, limits=None, most_tasks=1001):
        """limits: of a node's processes, by its name, as ulimit's options: {"n2": "-f 100"}."""
        self.folder = pathlib.Path(folder)
        self.limits = limits or {}
        self.programs = {name: find(name) for name in PROGRAMS}
        self.processes = {}
        for name in ["state", "log"] + ["spool." + node for node in self.NODES]:
            (self.folder / name).mkdir(parents=True)
        host, user = socket.gethostname(), getpass.getuser()
        key = self.folder / "munge.key"
        key.write_bytes(os.urandom(1024))
        key.chmod(0o400)
        nodes = "\n".join(
            f"NodeName={node} NodeHostname={host} NodeAddr=127.0.0.1 Port={free_port()} CPUs=1 State=UNKNOWN"
            for node in self.NODES
        )
        (self.folder / "slurm.conf").write_text(
            f"""ClusterName=brume
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={free_port()}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={self.folder}/munge.socket
CredType=cred/munge
StateSaveLocation={self.folder}/state
SlurmdSpoolDir={self.folder}/spool.%n
SlurmctldPidFile={self.folder}/slurmctld.pid
SlurmdPidFile={self.folder}/slurmd.%n.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=bf_interval=1,sched_interval=1,sched_min_interval=100000
SlurmdParameters=config_overrides
ReturnToService=2
PropagateResourceLimits=NONE
KillWait=10
SlurmdTimeout=60
MaxArraySize={most_tasks}
{nodes}
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""
        )
        self.environment = dict(os.environ, SLURM_CONF=str(self.folder / "slurm.conf"), TZ="UTC")
        self.environment["PATH"] += ":/usr/sbin:/sbin"

    def __enter__(self):
        try:
            self.start()
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_):
        self.stop()

    def spawn(self, name, command, limit=None):
        log = open(self.folder / "log" / name, "ab")
        if limit:
            command = ["sh", "-c", f'ulimit {limit}; exec "$@"', "sh"] + command
        self.processes[name] = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=self.environment, start_new_session=True
        )

    def start(self):
        f = self.folder
        self.spawn(
            "munged",
            [self.programs["munged"], "--foreground", "--force", f"--socket={f}/munge.socket",
             f"--key-file={f}/munge.key", f"--pid-file={f}/munged.pid", f"--seed-file={f}/munged.seed",
             f"--log-file={f}/log/munged.log", "--num-threads=2"],
        )
        self.wait_for(lambda: (f / "munge.socket").exists(), "munged", 15)
        self.start_controller()
        for node in self.NODES:
            self.spawn("slurmd." + node, [self.programs["slurmd"], "-D", "-N", node], self.limits.get(node))
        self.wait_for(lambda: self.node_states() == {node: "IDLE" for node in self.NODES}, "the nodes", 30)

    def start_controller(self):
        self.spawn("slurmctld", [self.programs["slurmctld"], "-D"])
        self.wait_for(lambda: self.run("scontrol", "ping", check=False).find("UP") >= 0, "slurmctld", 30)

    def restart_controller(self):
        """As its machine's service would be. Killed outright, it would lose what came in the last seconds: what such a
        submission lacks is for brume submit resume."""
        self.processes["slurmctld"].terminate()
        self.processes["slurmctld"].wait()
        self.start_controller()
        self.wait_for(lambda: not any("UNKNOWN" in state for state in self.node_states().values()), "the nodes", 60)

    def stop(self):
        """Ends what was started, and nothing else: each process by its number, the steps of jobs with their slurmd."""
        for name in ["slurmd.n1", "slurmd.n2", "slurmctld", "munged"]:
            process = self.processes.get(name)
            if process and process.poll() is None:
                process.send_signal(signal.SIGTERM)
        for process in self.processes.values():
            try:
                process.wait(timeout=10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def wait_for(self, condition, what, seconds):
        begun = time.monotonic()
        while not condition():
            for name, process in self.processes.items():
                if process.poll() is not None:
                    raise CannotStart(f"{name} ended: {self.tail(name)}")
            if time.monotonic() - begun > seconds:
                raise CannotStart(f"{what} did not come up within {seconds} s: {self.tail(list(self.processes)[-1])}")
            time.sleep(0.1)

    def tail(self, name):
        lines = (self.folder / "log" / name).read_text(errors="replace").strip().splitlines()
        return " | ".join(lines[-4:])

    def run(self, *words, check=True, **more):
        result = subprocess.run(
            [self.programs.get(words[0], words[0]), *words[1:]], env=dict(self.environment, **more),
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )
        if check and result.returncode != 0:
            raise RuntimeError(f"{' '.join(words)} ended with {result.returncode}: {result.stdout}")
        return result.stdout

    def node_states(self):
        states = {}
        for line in self.run("scontrol", "-o", "show", "nodes", check=False).splitlines():
            words = dict(word.split("=", 1) for word in line.split() if "=" in word)
            if "NodeName" in words:
                states[words["NodeName"]] = words.get("State", "")
        return states

    def queue(self):
        """Tasks that are not over: [(job, task, state, node)]."""
        text = self.run("squeue", "-h", "-r", "-o", "%F %K %T %N", check=False)
        return [tuple((line.split() + ["", "", "", ""])[:4]) for line in text.splitlines()]

    def drain(self, node):
        self.run("scontrol", "update", f"NodeName={node}", "State=DRAIN", "Reason=test")

    def resume(self, node):
        self.run("scontrol", "update", f"NodeName={node}", "State=RESUME")
