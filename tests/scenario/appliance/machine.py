"""A unit in qemu, as ./scripts/boot makes it, and what the campaign does to it: its power, its page, its disk. With
`drill` the loader hands the kernel a second initramfs (drill.cpp), so that things can be done inside a machine whose image is
the shipped one and has no login."""

import gzip
import hashlib
import http.client
import json
import os
import pathlib
import shutil
import socket
import subprocess
import tempfile
import threading
import time
import urllib.error
import urllib.request

ROOT = pathlib.Path(__file__).resolve().parents[3]
BOOT_OFFSET = 1 << 20  # of the boot partition, as scripts/image lays the disk out
SECTOR = 512


def run(*words, **options):
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, **options)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(map(str, words))}: {done.stdout}{done.stderr}")
    return done.stdout


def partitions(image):
    """name -> (first byte, bytes)"""
    table = json.loads(run("/usr/sbin/sfdisk", "--json", image))["partitiontable"]["partitions"]
    return {part["name"]: (part["start"] * SECTOR, part["size"] * SECTOR) for part in table}


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def copy(image, to):
    run("cp", "--sparse=always", "--reflink=auto", image, to)


def boot_entries(image):
    listed = run("mdir", "-b", "-i", f"{image}@@{BOOT_OFFSET}", "::/loader/entries")
    return sorted(line.rsplit("/", 1)[1] for line in listed.split() if line.endswith(".conf"))


def add_drill(image, program):
    """Names a second initramfs in every boot entry: the drill as the first program, the shipped one behind it."""
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name, "tree")
        folder.mkdir()
        shutil.copy(program, folder / "init")
        shutil.copy(ROOT / "platform/image/initramfs_init", folder / "init.shipped")
        archive = subprocess.run(["cpio", "-o", "-H", "newc", "--quiet", "--owner", "0:0"], cwd=folder, check=True,
                                 input=b"init\ninit.shipped\n", capture_output=True).stdout
        # Compressed, for the kernel takes a bare archive only at a multiple of four bytes behind the shipped one.
        pathlib.Path(name, "drill").write_bytes(gzip.compress(archive))
        drive = f"{image}@@{BOOT_OFFSET}"
        run("mcopy", "-o", "-i", drive, f"{name}/drill", "::/drill")
        for entry in boot_entries(image):
            path = pathlib.Path(name, entry)
            run("mcopy", "-n", "-i", drive, f"::/loader/entries/{entry}", path)
            path.write_text(path.read_text().replace("options ", "initrd /drill\noptions ", 1))
            run("mcopy", "-o", "-i", drive, path, f"::/loader/entries/{entry}")


def add_to_provision(image, files):
    """More files (name -> text) in the boot partition's folder `provision`."""
    drive = f"{image}@@{BOOT_OFFSET}"
    sums = run("mtype", "-i", drive, "::/provision/SHA256SUMS")
    for name, text in files.items():
        sums += f"{hashlib.sha256(text.encode()).hexdigest()}  ./{name}\n"
    for name, text in (*files.items(), ("SHA256SUMS", sums)):
        subprocess.run(["mcopy", "-o", "-i", drive, "-", f"::/provision/{name}"], input=text.encode(), check=True)


class Machine:
    """`network`: it reaches this computer (as 10.0.2.2); otherwise only its page is reached from here."""

    def __init__(self, architecture, image, folder, drill=False, restarts=False, network=False, counted=False,
                 write_log=None):
        self.folder = pathlib.Path(folder)
        self.port = free_port()
        words = run(ROOT / "scripts/boot", architecture, "--image", image, "--keep", "--port", self.port,
                    "--print").splitlines()
        self.firmware = next(word for word in words if word.startswith("if=pflash") and "readonly" not in word)
        if restarts:
            words.remove("-no-reboot")
        if counted:  # the guest's clock counts its instructions
            words = [word.replace("tcg,thread=multi", "tcg,thread=single") for word in words] + ["-icount", "shift=1"]
        if network:
            words = [word.replace("restrict=on", "restrict=off") for word in words]
        if drill:
            self.line_path = str(self.folder / "drill.sock")
            words += ["-serial", f"unix:{self.line_path},server=on,wait=off"]
        if write_log:  # every write of the guest goes into a log, too, in its order
            drive = next(i for i, word in enumerate(words) if word.startswith("if=none,id=d,"))
            words[drive - 1:drive + 1] = [
                "-blockdev", f"driver=file,filename={image},node-name=base",
                "-blockdev", f"driver=file,filename={write_log},node-name=log",
                "-blockdev", f"driver=blklogwrites,node-name=d,file=base,log=log,log-sector-size={SECTOR}"]
        monitor = self.folder / f"monitor-{self.port}"
        words += ["-qmp", f"unix:{monitor},server=on,wait=off"]
        self.console = self.folder / "console"
        with open(self.console, "wb") as console:
            self.process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=console, stderr=console)
        self.start = time.monotonic()
        self.line = None
        self.restarts = []  # (seconds after power-on, why) of each restart that nobody here caused
        threading.Thread(target=self.listen, args=(monitor,), daemon=True).start()

    def listen(self, monitor):
        """Notes restarts, as qemu tells of them: by the hardware watchdog, or by the unit's own reboot or panic."""
        link = socket.socket(socket.AF_UNIX)
        while self.process.poll() is None:
            try:
                link.connect(str(monitor))
                break
            except OSError:
                time.sleep(0.05)
        why = "the unit itself"
        try:
            with link.makefile("rw") as events:
                events.write('{"execute": "qmp_capabilities"}\n')
                events.flush()
                for line in events:
                    event = json.loads(line)
                    if event.get("event") == "WATCHDOG":
                        why = "its hardware watchdog"
                    if event.get("event") == "RESET":
                        self.restarts.append((round(self.age()), why))
                        why = "the unit itself"
        except (OSError, ValueError):
            pass
        monitor.unlink(missing_ok=True)

    def age(self):
        return time.monotonic() - self.start

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.cut()
        pathlib.Path(self.firmware.rsplit("file=", 1)[1]).unlink(missing_ok=True)

    def cut(self):
        """The power is gone."""
        if self.line:
            self.line.close()
        self.process.kill()
        self.process.wait()

    def get(self, path, timeout=3):
        """Status and text; 0 where nobody answers."""
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{self.port}{path}", timeout=timeout) as answer:
                return answer.status, answer.read().decode()
        except urllib.error.HTTPError as refusal:
            return refusal.code, refusal.read().decode()
        except (OSError, http.client.HTTPException):
            return 0, ""

    def wait(self, path, patience_s, fits=lambda status, text: status == 200):
        """Seconds until the answer fits; None when it does not come, or the machine ended by itself."""
        begin = time.monotonic()
        while time.monotonic() - begin < patience_s:
            if self.process.poll() is not None:
                return None
            if fits(*self.get(path)):
                return time.monotonic() - begin
            time.sleep(0.1)
        return None

    def heard(self, text):
        return text in self.console.read_text(errors="replace")

    def order(self, command, patience_s=60):
        """What the drill answers: one line, or several that end with a dot."""
        if self.line is None:
            self.line = socket.socket(socket.AF_UNIX)
            self.line.connect(self.line_path)
        self.line.settimeout(patience_s)
        self.line.sendall(command.encode() + b"\n")
        answer = b""
        while not answer.endswith(b"\n.\n" if command == "resident" else b"\n"):
            more = self.line.recv(4096)
            if not more:
                raise SystemExit("the drill is gone")
            answer += more
        return answer.decode().strip()


def extract(image, name, to):
    """A partition as a file of its own."""
    first, size = partitions(image)[name]
    run("dd", f"if={image}", f"of={to}", "bs=1M", f"skip={first >> 20}", f"count={size >> 20}", "conv=sparse", "status=none")


def data_folder(image, folder):
    """The data partition's files as the unit would see them after its start: the journal is replayed and counters are set
    right, as every mount does, then they are copied out. Returns the folder and what more is wrong with the file system."""
    disk = pathlib.Path(folder, "data.img")
    extract(image, "data", disk)
    checked = subprocess.run(["/usr/sbin/e2fsck", "-f", "-p", disk], capture_output=True, text=True, check=False)
    out = pathlib.Path(folder, "data")
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    subprocess.run(["/usr/sbin/debugfs", "-R", f"rdump / {out}", disk], capture_output=True, check=False)
    os.unlink(disk)
    return out, "" if checked.returncode <= 1 else checked.stdout
