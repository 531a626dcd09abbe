"""by_the_page.py WAGONSIGHTD WAGONSIGHT_UPDATE WAGONSIGHT SCENE: the real programs, with files as the unit's disk: makes keys and
bundles, sends them to the page as a person does, and looks at what became of the slots. Exits 1 and says what is wrong."""

import json
import pathlib
import random
import signal
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request

DAEMON, UPDATER, TOOL, SCENE = sys.argv[1:5]
TOKEN = "admin-token-of-the-test"
SETTINGS = f"""[unit]
name = "test"
[demo]
scene = "{SCENE}"
[[sensor]]
name = "k0"
kind = "kinect"
source = "simulated"
[web]
port = 0
[web.tokens]
admin = "{TOKEN}"
"""
failures = []


def check(good, words):
    if not good:
        failures.append(words)
        print("FAIL:", words, file=sys.stderr)


class Unit:
    """A folder that stands for the disk, the updater and the daemon beside it."""

    def __init__(self, folder):
        self.folder = folder
        for name, text in {
            "facts/release": "version 1.0.0\narchitecture x86_64\nindex 5\n",
            "boot/loader/entries/a.conf": "title one\nsort-key wagonsight\nversion 2\n",
            "boot/loader/entries/b+3.conf": "title one\nsort-key wagonsight\nversion 1\n",
            "boot/a/vmlinuz": "kernel a",
            "data/identity/name": "wagon-1\n",
            "data/unit/unit.toml": SETTINGS,
            "root-a": "a" * 3_000_000,
            "root-b": "b" * 3_000_000,
            "token": TOKEN + "\n",
        }.items():
            self.put(name, text)
        self.programs = []
        self.address = None

    def put(self, name, content):
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())

    def updater_arguments(self):
        at = lambda name: str(self.folder / name)
        return [UPDATER, "--data", at("data"), "--facts", at("facts"), "--boot", at("boot"), "--root-a", at("root-a"),
                "--root-b", at("root-b"), "--running", "a", "--daemon", DAEMON]

    def start_updater(self):
        program = subprocess.Popen(self.updater_arguments() + [
            "serve", "--socket", str(self.folder / "socket"), "--restart", "touch", str(self.folder / "restarted")])
        self.programs.append(program)
        for _ in range(500):
            if (self.folder / "socket").exists():
                break
            time.sleep(0.02)
        return program

    def start_daemon(self):
        daemon = subprocess.Popen([DAEMON, "--config", str(self.folder / "data/unit/unit.toml"), "--updater",
                                   str(self.folder / "socket")], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.programs.append(daemon)
        self.address = daemon.stdout.readline().strip().removeprefix("http://").removesuffix("/")

    def stop(self):
        for program in reversed(self.programs):
            program.send_signal(signal.SIGTERM)
            program.wait()

    def ask(self, method, path, body=None, token=TOKEN):
        request = urllib.request.Request(f"http://{self.address}{path}", data=body, method=method,
                                         headers={"Authorization": f"Bearer {token}"})
        try:
            with urllib.request.urlopen(request, timeout=10) as answer:
                return answer.status, json.load(answer)
        except urllib.error.HTTPError as error:
            return error.code, json.load(error)

    def state(self):
        return self.ask("GET", "/api/v1/update")[1]

    def wait_for(self, state):
        for _ in range(300):
            now = self.state()
            if now.get("state") == state:
                return now
            time.sleep(0.05)
        check(False, f"the updater never came to {state}: {self.state()}")
        return {}

    def send(self, bundle):
        return tool("update", str(bundle), "--to", self.address, "--token-file", str(self.folder / "token"))


def tool(*arguments, succeeds=None):
    done = subprocess.run([TOOL, *arguments], capture_output=True, text=True)
    if succeeds is not None:
        check((done.returncode == 0) == succeeds, f"{arguments}: {done.returncode} {done.stderr}")
    return done


def make_bundles(folder):
    draw = random.Random(5)
    for name, size in {"root": 2_500_000, "kernel": 300_000, "initramfs": 90_000}.items():
        (folder / name).write_bytes(draw.randbytes(size))
    parts = [word for name in ("root", "kernel", "initramfs") for word in ("--part", f"{name}={folder / name}")]
    for key in ("key", "other"):
        tool("bundle", "new-key", "--out", str(folder / key), succeeds=True)
    check((folder / "key").stat().st_mode & 0o077 == 0, "the secret key can be read by others")
    tool("bundle", "new-key", "--out", str(folder / "key"), succeeds=False)

    def make(name, key="key", index="10", architecture="x86_64"):
        tool("bundle", "update", "--version", "2.0.0", "--index", index, "--architecture", architecture, "--boot",
             "quiet roothash=12", *parts, "--key", str(folder / key), "--out", str(folder / name), succeeds=True)
        return folder / name

    good = make("good")
    whole = good.read_bytes()
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 16
    (folder / "flipped").write_bytes(flipped)
    (folder / "cut").write_bytes(whole[: len(whole) - 1000])
    bad = {"flipped": "chunk", "cut": "cut off", make("wrong_key", key="other").name: "does not trust",
           make("older", index="4").name: "older", make("arm", architecture="aarch64").name: "architecture aarch64"}
    tool("bundle", "check", str(good), "--key", str(folder / "key.pub"), "--architecture", "x86_64", succeeds=True)
    for name, words in bad.items():
        if name != "older":  # which only the unit can tell
            told = tool("bundle", "check", str(folder / name), "--key", str(folder / "key.pub"), "--architecture", "x86_64")
            check(words in told.stderr, f"bundle check {name}: {told.stderr}")
    return good, bad


def try_updates(unit, made):
    good, bad = make_bundles(made)
    unit.put("facts/update.pub", (made / "key.pub").read_bytes())
    unit.put("data/identity/update-index", "5\n")
    updater = unit.start_updater()
    unit.start_daemon()
    check(unit.ask("POST", "/api/v1/update?at=0", b"x", token="wrong")[0] == 401, "a block was taken without a token")
    check(unit.state().get("state") == "nothing", f"at first: {unit.state()}")
    for name, words in bad.items():
        told = unit.send(made / name)
        check(told.returncode == 1 and words in told.stderr, f"{name}: {told.stderr}")
    check((unit.folder / "root-b").read_bytes() == b"b" * 3_000_000, "what was refused was written")

    # Half of it by hand, then the updater is killed; the tool sends the rest.
    whole = good.read_bytes()
    for at in range(0, len(whole) // 2, 65536):
        unit.ask("POST", f"/api/v1/update?at={at}&of={len(whole)}", whole[at : at + 65536])
    received = unit.state()["received_bytes"]
    check(received > len(whole) // 2, f"received {received}")
    updater.kill()
    updater.wait()
    unit.programs.remove(updater)
    (unit.folder / "socket").unlink()
    unit.start_updater()
    for _ in range(300):  # the page's process notices and is started with another link
        try:
            if unit.state().get("received_bytes") == received:
                break
        except OSError:
            pass
        time.sleep(0.1)
    check(unit.state().get("received_bytes") == received, f"after the kill: {unit.state()}")
    told = unit.send(good)
    check(told.returncode == 0 and "slot b" in told.stdout, f"{told.stdout} {told.stderr}")
    check((unit.folder / "root-b").read_bytes()[:2_500_000] == (made / "root").read_bytes(), "the root differs")
    check((unit.folder / "boot/b/vmlinuz").read_bytes() == (made / "kernel").read_bytes(), "the kernel differs")
    entry = (unit.folder / "boot/loader/entries/b+3.conf").read_text()
    check("version 3\n" in entry and "quiet roothash=12 slot=b" in entry, entry)
    check((unit.folder / "root-a").read_bytes() == b"a" * 3_000_000, "the running slot was touched")
    check((unit.folder / "data/identity/update-index").read_text() == "5\n", "the index rose too early")
    unit.wait_for("restart_needed")


def try_provisioning(unit, made):
    stick = made / "stick"
    stick.mkdir()
    (stick / "unit.toml").write_text(SETTINGS.replace('"test"', '"another"'))
    make = lambda name, index: tool("bundle", "provision", str(stick), "--unit", name, "--index", index, "--key",
                                    str(made / "key"), "--out", str(made / "settings"), succeeds=True)
    make("wagon-2", "1")
    told = unit.send(made / "settings")
    check("unit wagon-2" in told.stderr, told.stderr)
    make("wagon-1", "1")
    told = unit.send(made / "settings")
    check(told.returncode == 0 and "is taken" in told.stdout, f"{told.stdout} {told.stderr}")
    check("already" in unit.send(made / "settings").stderr, "the same provisioning was taken twice")
    (stick / "unit.toml").write_text("[unit]\nnmae = 1\n")
    make("wagon-1", "2")
    told = unit.send(made / "settings")
    check(told.returncode == 1 and "unit.toml:2" in told.stderr, f"{told.stdout} {told.stderr}")

    told = tool("update", "--restart", "--to", unit.address, "--token-file", str(unit.folder / "token"), succeeds=True)
    for _ in range(100):
        if (unit.folder / "restarted").exists():
            break
        time.sleep(0.05)
    check((unit.folder / "restarted").exists(), f"no restart: {told.stdout}")
    unit.stop()
    unit.programs.clear()
    settled = subprocess.run(unit.updater_arguments() + ["settle"])
    check(settled.returncode == 0 and '"another"' in (unit.folder / "data/unit/unit.toml").read_text(), "not settled")


def try_reset(unit):
    unit.start_updater()
    unit.start_daemon()
    tool("update", "--factory-reset", "--to", unit.address, "--token-file", str(unit.folder / "token"), succeeds=True)
    check((unit.folder / "data/unit/unit.toml").exists(), "a running unit lost its settings")
    unit.stop()
    unit.programs.clear()
    subprocess.run(unit.updater_arguments() + ["settle"], check=True)
    left = sorted(path.name for path in (unit.folder / "data").iterdir())
    check(left == ["calibration", "identity"], f"after the reset: {left}")


with tempfile.TemporaryDirectory() as scratch:
    scratch = pathlib.Path(scratch)
    (scratch / "made").mkdir()
    unit = Unit(scratch / "unit")
    try:
        try_updates(unit, scratch / "made")
        try_provisioning(unit, scratch / "made")
        try_reset(unit)
    finally:
        unit.stop()
sys.exit(1 if failures else 0)
