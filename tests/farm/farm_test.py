#!/usr/bin/python3
"""Shots on a real Slurm, with what goes wrong on farms: every one ends complete, with the bits of one machine.

    farm_test.py BRUME SOURCE [NAME]

BRUME is the program, SOURCE the root of the project; only tests whose names hold NAME are run. Ends with 77 and says why where Slurm cannot be started."""

import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time

import slurm_cluster

BRUME, SOURCE = [str(pathlib.Path(path).resolve()) for path in sys.argv[1:3]]
FRAMES, PARTS = [1, 2, 3, 4], 4
LONGEST = 240  # seconds that a shot may take before the test gives it up

SCENE = f"""name = "shot"
[camera]
keys = [[1, 0,-7,1.5, 0,0,1.45], [4, 1,-7,1.5, 0,0,1.45]]
fov = 26.5
[film]
width = 48
height = 40
[environment]
radiance = 1
[[volumes]]
file = "v.####.vdb"
grid = "density_noise"
sigma_t = 18
object_to_world = [[1, 0, 0, -1], [0, 1, 0, -1], [0, 0, 1, 0], [0, 0, 0, 1]]
"""


def check(condition, message):
    if not condition:
        raise AssertionError(message)


def as_path(word):
    return word if isinstance(word, (bytes, os.PathLike)) else str(word)


def brume(*words, environment=None, status=0):
    result = subprocess.run([BRUME, *map(os.fsencode, map(as_path, words))], env=environment, stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE, text=True, errors="replace")
    if status is not None:
        check(result.returncode == status, f"brume {' '.join(map(str, words))} ended with {result.returncode}:\n{result.stderr}")
    return result


class Shot:
    """A scene of four frames, submitted into a folder of its own."""

    def __init__(self, cluster, folder, name, spp=64, parts=PARTS, options=()):
        self.cluster, self.folder = cluster, folder / name
        self.scene, self.spp, self.parts = folder / "shot.toml", spp, parts
        self.environment = dict(cluster.environment, BRUME_PAUSE="1")
        self.options = options

    def submit(self):
        text = brume(
            "submit", "slurm", self.scene, "--frames", "1-4", "--parts", self.parts, "--spp", self.spp, "--layers",
            "direct,indirect", "--threads", 1, "-o", self.folder, *self.options, environment=self.environment,
        ).stdout
        return dict(line.split() for line in text.splitlines())

    def status(self):
        return json.loads(
            brume("submit", "status", self.folder, "--json", environment=self.environment, status=None).stdout
        )

    def wait(self, condition=None):
        """Until the condition holds, or without one until no job is left."""
        begun = time.monotonic()
        while not (condition() if condition else not self.cluster.queue()):
            check(time.monotonic() - begun < LONGEST, f"not over in {LONGEST} s: {self.cluster.queue()}\n{self.logs()}")
            time.sleep(0.2)

    def logs(self):
        return "\n".join(
            f"{path.relative_to(self.folder)}: " + " | ".join(path.read_text(errors="replace").splitlines()[-3:])
            for path in sorted(self.folder.glob("**/*.log"))
        )

    def check_complete(self, reference):
        """Every frame is there, with all samples once, and its pixels are those of one machine."""
        status = self.status()
        check(status["complete"], f"the shot is not complete: {json.dumps(status)}\n{self.logs()}")
        for frame in FRAMES:
            name = f"shot.{frame:04}.exr"
            header = json.loads(brume("info", "--json", self.folder / "frames" / name).stdout)["header"]
            check(int(header["samplesPerPixel"]) == self.spp, f"frame {frame} has {header['samplesPerPixel']} samples")
            compared = json.loads(brume("compare", "--json", self.folder / "frames" / name, reference / name).stdout)
            check(not any(compared["metrics"][metric] for metric in ("mse", "lab_rms")), f"frame {frame} differs from one machine's: {compared['metrics']}")
            check(not list((self.folder / "parts").glob(f"{frame:04}/?????.exr")), f"parts of frame {frame} are left")


def running_brume(shot, part_of):
    """Process ids of the renders whose command line names a file."""
    found = []
    for entry in pathlib.Path("/proc").glob("[0-9]*"):
        try:
            words = (entry / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if words[0].decode() == BRUME and any(part_of in word.decode() for word in words) and \
                any(str(shot.folder) in word.decode() for word in words):
            found.append(int(entry.name))
    return found


def processor_seconds(process):
    """That a process has taken so far; 0 once it has ended."""
    try:
        fields = pathlib.Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    except OSError:
        return 0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def one_array_per_stage(shot):
    """What sbatch would be given for 240 x 8, and that a dry run writes nothing."""
    for frame in range(5, 241):
        os.symlink(pathlib.Path(SOURCE) / "data/volumes/smoke.vdb", shot.scene.parent / f"v.{frame:04}.vdb")
    folder = shot.scene.parent / "dry"
    text = brume("submit", "slurm", shot.scene, "--frames", "1-240", "--parts", 8, "--clean", "-o", folder, "--dry-run",
                 environment=shot.environment).stdout
    check(text.count("=$(sbatch ") == 4, "render, merge, denoise and what retries: four calls of sbatch\n" + text[:600])
    check("#SBATCH --array=0-959\n" in text, "1,920 parts by 960 tasks of 2, below MaxArraySize")
    check("--dependency=afterany:$render " in text and "--dependency=afterany:$merge " in text, text[:600])
    check(not folder.exists(), "a dry run wrote something")


def ends_with_the_bits_of_one_machine(shot, reference):
    jobs = shot.submit()
    check(list(jobs) == ["render", "merge", "denoise", "retry"], f"submitted {jobs}")
    shot.wait()
    shot.check_complete(reference)
    clean = sorted(path.name for path in (shot.folder / "clean").glob("*.exr"))
    check(clean == [f"shot.{frame:04}.exr" for frame in FRAMES], f"clean frames: {clean}")
    again = brume("submit", "resume", shot.folder, environment=shot.environment)
    check("nothing is missing" in again.stderr and again.stdout == "", again.stderr)


def survives_what_goes_wrong(shot, reference, cluster):
    shot.submit()
    # A part killed in the middle of its work.
    shot.wait(lambda: running_brume(shot, "parts/"))
    victim = running_brume(shot, "parts/")[0]
    os.kill(victim, signal.SIGKILL)
    # The controller's machine is switched off and on.
    cluster.restart_controller()
    # A node is drained, and comes back later.
    cluster.drain("n2")
    check("DRAIN" in cluster.node_states()["n2"], f"not drained: {cluster.node_states()}")
    # A whole part is cut off, as by a copy that broke off.
    part = []
    shot.wait(lambda: part.extend(shot.folder.glob("parts/*/?????.exr")) or part or not cluster.queue())
    for path in part[:1]:
        try:
            os.truncate(path, max(1, path.stat().st_size // 2))
        except FileNotFoundError:
            pass  # merged in the meantime
    time.sleep(2)
    cluster.resume("n2")
    shot.wait()
    shot.check_complete(reference)
    rounds = sorted(path.name for path in (shot.folder / "rounds").iterdir())
    check(len(rounds) >= 2, f"what was killed was rendered in another round: {rounds}")
    check("ended with 137" in "".join(p.read_text() for p in shot.folder.glob("logs/render.*.log")), "no part was killed")


def a_node_without_disk(shot, reference):
    """n2 can hold files of some kilobytes only: what fails there is done elsewhere."""
    shot.submit()
    shot.wait()
    failed = [path for path in shot.folder.glob("logs/render.*.log") if "File too large" in path.read_text()]
    check(failed, "nothing failed on the node without disk\n" + shot.logs())
    second = (shot.folder / "rounds/2/render.sh").read_text()
    check("#SBATCH --exclude=n2" in second, "the second round goes to the other node:\n" + second[:400])
    shot.check_complete(reference)


def the_status_says_why(shot):
    """What fails on n2 and is not retried."""
    shot.submit()
    shot.wait()
    failed = [entry for stage in shot.status()["stages"].values() for entry in stage["failed"]]
    check(failed and all("File too large" in entry["why"] for entry in failed), f"{failed}\n{shot.logs()}")


def goes_on_from_its_checkpoint(shot, reference, cluster):
    """Slurm puts a running part back into the queue: it stops with a checkpoint and goes on from it."""
    shot.submit()
    # In the middle of its samples: a frame of these takes several seconds of processor time.
    shot.wait(lambda: (renders := running_brume(shot, "frames/")) and min(map(processor_seconds, renders)) > 0.5)
    job, task = next((job, task) for job, task, state, _ in cluster.queue() if state == "RUNNING")
    cluster.run("scontrol", "requeue", f"{job}_{task}")
    # Slurm lets a job that was put back wait for two minutes.
    shot.wait(lambda: (job, task, "PENDING", "") in cluster.queue())
    cluster.run("scontrol", "update", f"JobId={job}_{task}", "StartTime=now")
    shot.wait()
    shot.check_complete(reference)
    logs = {path: path.read_text() for path in shot.folder.glob("logs/render.*.log")}
    stopped = [text for text in logs.values() if "ended with 3 " in text]
    check(stopped, "no part was stopped:\n" + shot.logs())
    check(any("is written; go on with" in text for text in stopped), "\n".join(stopped))


def parts_of_others_are_named(shot, cluster):
    """A part of another scene among the others: named, never merged."""
    shot.submit()
    shot.wait()
    folder = shot.folder / "parts" / "0001"
    brume("render", shot.scene, "--frames", 1, "--part", f"2/{shot.parts}", "--spp", shot.spp, "--layers", "direct,indirect",
          "-D", "camera.fov=30", "-q", "-o", folder / "00002.exr")
    (shot.folder / "frames/shot.0001.exr").unlink()
    merge = brume("merge", folder / "#####.exr", "--parts", f"1-{shot.parts}", "-o", shot.folder / "frames/shot.0001.exr",
                  status=2)
    check("camera.fov is 30 in the first, 26.5 in the second" in merge.stderr, merge.stderr)
    check(not (shot.folder / "frames/shot.0001.exr").exists(), "it was merged")
    # The farm finds out by itself: the merge fails, the parts are held against the scene, the foreign one is rendered.
    brume("submit", "resume", shot.folder, environment=shot.environment)
    shot.wait()
    check(shot.status()["complete"], shot.logs())
    log = (shot.folder / "logs/render.0001.00002.log").read_text()
    check("is rendered again: camera.fov is 30 in the file" in log, log)


# What a folder may hold that shells, sbatch or its names of logs take for something else.
ODD = ["a b", " a", "a ", "a\tb", "it's", 'a"b', "$(touch pwned)", "`touch pwned`", "$HOME", "a%jb", "%a%A%x", "%%", "100%", "~a",
       "-a", "a;b&c|d", "<a>", "a*b?[1]{2}!", "a=b,c:d@e^f(g)", "$FF", "é雲", "x" * 200]
# What one of them cannot hold, and what is said of it.
REFUSED = [("a\nb", "holds a line break"), ("a\rb", "holds a line break"), ("a\x1bb", "control character"),
           ("a\\b", "backslash"), ("ab\\", "backslash"), ("a####b", "a place for a frame's number"),
           ("a#b", "a place for a frame's number"), ("a$Fb.$F", "a place for a frame's number"),
           ("a$F4", "a place for a frame's number"), ("a%04d", "a place for a frame's number"),
           (b"a\xe9b", "is not UTF-8"), ("/".join(["x" * 200] * 18), "expected at most 3500")]


def odd_names(cluster, folder):
    """Every folder either works to the end or is refused before anything is written."""
    environment = dict(cluster.environment, BRUME_PAUSE="1")
    inside = folder / "odd"
    inside.mkdir()
    (inside / "v.0001.vdb").symlink_to(folder / "v.0001.vdb")
    # The shot is named by the file, where the scene's name has characters that no file's name should have.
    scene = inside / "it's a $(touch pwned) \"scene\" of 100 %.toml"
    scene.write_text(SCENE.replace('name = "shot"', 'name = "two words"'))
    small = ["--frames", 1, "--spp", 2, "--layers", "direct,indirect", "--threads", 1, "-D", "film.width=8", "-D", "film.height=8"]
    for name in ODD:
        brume("submit", "slurm", scene, *small, "--retries", 0, "--sbatch=--comment=two #words", "-o", inside / "shots" / name,
              environment=environment)
    everything = inside / "shots" / "".join(ODD[:-1])[:200]
    brume("submit", "slurm", scene, *small, "--parts", 2, "--clean", "--clean-filter", "gaussian", "-o", everything,
          environment=environment)
    before = sorted(path for path in inside.rglob("*"))
    for name, why in REFUSED:
        to = os.path.join(os.fsencode(inside / "shots"), os.fsencode(name))
        for action in ["slurm"] if why == "backslash" else ["slurm", "commands", "opencue"]:
            result = brume("submit", action, scene, *small, "-o", to, environment=environment, status=2)
            check(why in result.stderr and result.stderr.count("\n") == 1 and not result.stdout, f"{name!r}: {result.stderr}")
            check(not os.path.exists(to), f"{name!r} was made")
    elsewhere = inside / "shots" / "never"
    for words in [("-D", "film.width=8\n"), ("--sbatch=--comment=a\ntouch pwned",), ("--sbatch=a",), ("--time=1\n2",),
                  ("--program", "a\nb")]:
        result = brume("submit", "slurm", scene, *small, "-o", elsewhere, *words, environment=environment, status=2)
        check(result.stderr.count("\n") == 1, result.stderr)
    lines = inside / "two\nlines.toml"
    lines.write_text(SCENE)
    result = brume("submit", "slurm", lines, *small, "-o", elsewhere, environment=environment, status=2)
    check("two\\x0alines.toml: holds a line break" in result.stderr, result.stderr)
    check(not elsewhere.exists(), "something was written")
    Shot(cluster, folder, "odd").wait()
    for name in ODD + [everything.name]:
        shot = inside / "shots" / name
        status = json.loads(brume("submit", "status", shot, "--json", environment=environment, status=None).stdout)
        check(status["complete"], f"{name!r}: {json.dumps(status)}")
        check((shot / "rounds/1/render.0.log").exists(), f"{name!r}: its log lies elsewhere")
    check(not [path for path in inside.rglob("pwned")] and not os.path.exists("pwned"), "a name was executed")


def what_never_began_has_failed(shot, cluster):
    """Tasks that end before they write a word: cancelled, here, while they wait."""
    cluster.drain("n1"), cluster.drain("n2")
    jobs = shot.submit()
    cluster.run("scancel", *jobs.values())
    shot.wait()
    cluster.resume("n1"), cluster.resume("n2")
    status = shot.status()["stages"]
    failed = [entry for stage in status.values() for entry in stage["failed"]]
    check(len(failed) == len(FRAMES) * (PARTS + 1), f"{json.dumps(status)}")
    why = f"never began: job {jobs['render']} was cancelled, or could not be started; ask sacct -j {jobs['render']}"
    check(status["render"]["failed"][0]["why"] == why, f"{status['render']['failed'][0]}")


def one_submitter_at_a_time(shot):
    """The first is held in its call of sbatch while others try."""
    bin_folder = shot.scene.parent / "bin"
    bin_folder.mkdir()
    sbatch = bin_folder / "sbatch"
    sbatch.write_text(f"#!/bin/sh\ntouch '{bin_folder}/called'\nwhile [ ! -e '{bin_folder}/go' ]; do sleep 0.1; done\n"
                      f"exec {slurm_cluster.find('sbatch')} \"$@\"\n")
    sbatch.chmod(0o755)
    slowly = dict(shot.environment, PATH=f"{bin_folder}:{shot.environment['PATH']}")
    words = ["submit", "slurm", shot.scene, "--frames", "1-4", "--spp", shot.spp, "--layers", "direct,indirect", "--threads", 1,
             "-o", shot.folder]
    first = subprocess.Popen([BRUME, *map(str, words)], env=slowly, stdout=subprocess.PIPE, text=True)
    try:
        shot.wait(lambda: (bin_folder / "called").exists())
        for refused in [words, ["submit", "resume", shot.folder], ["submit", "commands", shot.folder]]:
            second = brume(*refused, environment=shot.environment, status=2)
            check(f"is being submitted by {os.uname().nodename}, process {first.pid}, since 2" in second.stderr, second.stderr)
    finally:
        (bin_folder / "go").touch()
        out = first.communicate()[0]
    check(first.returncode == 0, f"the first was not taken: {first.returncode}")
    check(not (shot.folder / "submit.lock").exists(), "its lock is left")
    check(len(list((shot.folder / "rounds").iterdir())) == 1, "two rounds were planned")
    shot.wait()
    check(shot.status()["complete"], shot.logs() + out)


def its_lock_goes_with_a_submitter_that_fails(shot):
    """When sbatch refuses, and when Ctrl-C comes while it works."""
    bin_folder = shot.scene.parent / "bin_failing"
    bin_folder.mkdir()
    sbatch = bin_folder / "sbatch"
    environment = dict(shot.environment, PATH=f"{bin_folder}:{shot.environment['PATH']}")
    words = ["submit", "slurm", shot.scene, "--frames", "1-4", "-o", shot.folder]
    lock = shot.folder / "submit.lock"
    sbatch.write_text("#!/bin/sh\necho no such partition; exit 1\n")
    sbatch.chmod(0o755)
    refused = brume(*words, environment=environment, status=2)
    check("no such partition" in refused.stderr and not lock.exists(), refused.stderr)
    sbatch.write_text(f"#!/bin/sh\ntouch '{bin_folder}/called'\nexec sleep 1000\n")
    stopped = subprocess.Popen([BRUME, *map(str, words)], env=environment, stderr=subprocess.DEVNULL, start_new_session=True)
    shot.wait(lambda: (bin_folder / "called").exists())
    check(lock.exists(), "it holds no lock")
    os.killpg(stopped.pid, signal.SIGINT)
    check(stopped.wait(60) != 0 and not lock.exists(), "its lock is left")


def commands_run_three_times_at_once(shot):
    """Every line of a plan, by three shells in one moment: no one fails, and the frame is whole."""
    brume("submit", "commands", shot.scene, "--frames", 1, "--parts", 2, "--spp", 2, "--layers", "direct,indirect", "-o",
          shot.folder, "--keep-parts")
    # Of what is missing: nothing is yet.
    lines = brume("submit", "commands", shot.folder).stdout.splitlines()
    check(len(lines) == 4 and all("BRUME_WRITER=" in line for line in lines if line), "\n".join(lines))
    for line in filter(None, lines):
        together = subprocess.run(["sh", "-c", f"for i in 1 2 3; do ({line}) & done; s=0; for i in $(jobs -p); do wait $i || s=1; done; exit $s"],
                                  stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        check(together.returncode == 0, f"{line}\n{together.stdout}")
    check(shot.status()["complete"], "the frame is not complete")
    check(not list(shot.folder.rglob("*.part")), "something is left half written")


def main():
    folder = pathlib.Path(tempfile.mkdtemp(prefix="brume_farm_"))
    try:
        for frame in FRAMES:
            os.symlink(pathlib.Path(SOURCE) / "data/volumes/smoke.vdb", folder / f"v.{frame:04}.vdb")
        (folder / "shot.toml").write_text(SCENE)
        reference = folder / "reference"
        reference.mkdir()
        brume("render", folder / "shot.toml", "--frames", "1-4", "--spp", 64, "--layers", "direct,indirect", "-q", "-o",
              reference / "shot.####.exr")
        long_spp, longest_spp = 1024, 8192
        long_reference, longest_reference = folder / "long_reference", folder / "longest_reference"
        for spp, frames in (long_spp, long_reference), (longest_spp, longest_reference):
            frames.mkdir()
            brume("render", folder / "shot.toml", "--frames", "1-4", "--spp", spp, "--layers", "direct,indirect", "-q",
                  "-o", frames / "shot.####.exr")

        def told(name, work):
            if len(sys.argv) > 3 and sys.argv[3] not in name:
                return
            begun = time.monotonic()
            work()
            print(f"ok {name} ({time.monotonic() - begun:.1f} s)", flush=True)

        with slurm_cluster.Cluster(folder / "slurm") as cluster:
            told("one array per stage", lambda: one_array_per_stage(Shot(cluster, folder, "none")))
            told("odd names", lambda: odd_names(cluster, folder))
            told("what never began", lambda: what_never_began_has_failed(Shot(cluster, folder, "cancelled"), cluster))
            told("one submitter at a time", lambda: one_submitter_at_a_time(Shot(cluster, folder, "twice", spp=2)))
            told("the lock goes with a submitter that fails", lambda: its_lock_goes_with_a_submitter_that_fails(
                Shot(cluster, folder, "failing")))
            told("commands three times at once", lambda: commands_run_three_times_at_once(Shot(cluster, folder, "thrice")))
            told("the bits of one machine", lambda: ends_with_the_bits_of_one_machine(
                Shot(cluster, folder, "plain", options=["--clean", "--clean-filter", "gaussian"]), reference))
            told("a part killed, a node drained, a part cut off, the controller restarted", lambda:
                 survives_what_goes_wrong(Shot(cluster, folder, "trouble", spp=long_spp), long_reference, cluster))
            told("requeued with a checkpoint", lambda: goes_on_from_its_checkpoint(
                Shot(cluster, folder, "requeued", spp=longest_spp, parts=1), longest_reference, cluster))
            told("parts of another scene", lambda: parts_of_others_are_named(
                Shot(cluster, folder, "foreign", options=["--keep-parts"]), cluster))
        with slurm_cluster.Cluster(folder / "full", limits={"n2": "-f 40"}) as cluster:
            told("the status says why", lambda: the_status_says_why(
                Shot(cluster, folder, "why", parts=1, options=["--retries", 0])))
            told("a node without disk", lambda: a_node_without_disk(Shot(cluster, folder, "full_node"), reference))
    except slurm_cluster.CannotStart as reason:
        print(f"skipped: {reason}")
        return 77
    finally:
        if os.environ.get("BRUME_KEEP") != "1":
            shutil.rmtree(folder, ignore_errors=True)
        else:
            print(folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
