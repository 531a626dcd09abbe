"""update_drill.py --image FILE --work FOLDER --tool WAGONSIGHT --key KEY --token FILE --provision FOLDER [--cuts N] [--prefixes N]
updates the image in qemu. The work FOLDER is what scripts/image left of the newer version (build/image-ARCH); the image, which
trusts KEY.pub and was provisioned with FOLDER, is older. What is tried: bundles that must be refused, each by its name; an upload
and an installation during which the power goes; the update itself, from the page to two minutes of /readyz in the other slot; an
older bundle afterwards; an update whose daemon never gets ready, which must be rolled back by itself; N more power cuts at random
instants of updates and of new settings, and N points of an update's recorded writes (update_cuts.py); factory reset."""

import argparse
import json
import os
import pathlib
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time

from campaign import Failures, say
from machine import BOOT_OFFSET, Machine, boot_entries, copy, data_folder, extract, run
from update_cuts import UpdateCuts

READY_S = 400  # a machine that is emulated on a busy computer
GOOD_S = 400


class Drill:
    def __init__(self, options, folder):
        self.options, self.folder = options, pathlib.Path(folder)
        self.work = pathlib.Path(options.work)
        self.failures = Failures()
        self.disk = self.folder / "disk.img"
        copy(options.image, self.disk)
        self.facts = dict(line.split(" ", 1) for line in (self.work / "release").read_text().splitlines())
        self.words = (self.work / "boot-words").read_text().strip()
        self.provision = pathlib.Path(options.provision)
        older = self.folder / "older.part"
        extract(self.disk, "root-a", older)
        self.older_root = older.read_bytes().rstrip(b"\0")

    def check(self, holds, what):
        return self.failures.check(holds, what)

    # --- bundles --------------------------------------------------------------------------------

    def bundle(self, name, key=None, index=None, architecture=None, root=None, words=None):
        out = self.folder / name
        run(self.options.tool, "bundle", "update", "--version", name, "--index", index or self.facts["index"], "--architecture",
            architecture or self.facts["architecture"], "--boot", words or self.words, "--part", f"root={root or self.work / 'root.img'}",
            "--part", f"kernel={self.work / 'vmlinuz'}", "--part", f"initramfs={self.work / 'initramfs.zst'}", "--key",
            key or self.options.key, "--out", out)
        return out

    def bad_bundles(self, good):
        whole = good.read_bytes()
        flipped = bytearray(whole)
        flipped[random.randrange(len(whole) // 2, len(whole))] ^= 1
        (self.folder / "flipped").write_bytes(flipped)
        (self.folder / "cut").write_bytes(whole[:-1])
        run(self.options.tool, "bundle", "new-key", "--out", self.folder / "foreign")
        other = "aarch64" if self.facts["architecture"] == "x86_64" else "x86_64"
        return {self.folder / "flipped": "is not what was signed", self.folder / "cut": "cut off",
                self.bundle("wrong-key", key=self.folder / "foreign"): "does not trust",
                self.bundle("other-architecture", architecture=other): "architecture"}

    def with_hash_tree(self, image):
        """The image with its tree behind it, and the kernel's words for it."""
        blocks = (image.stat().st_size + 4095) // 4096
        os.truncate(image, blocks * 4096)
        salt = "00" * 32
        told = run("/usr/sbin/veritysetup", "format", "--no-superblock", "--hash=sha256", "--data-block-size=4096",
                   "--hash-block-size=4096", f"--data-blocks={blocks}", f"--hash-offset={blocks * 4096}", f"--salt={salt}", image, image)
        root_hash = next(line.split()[-1] for line in told.splitlines() if line.startswith("Root hash:"))
        kept = [word for word in self.words.split() if word.split("=")[0] not in ("blocks", "roothash", "salt")]
        return image, " ".join(kept + [f"blocks={blocks}", f"roothash={root_hash}", f"salt={salt}"])

    def never_ready(self):
        """The same root, but its daemon only sleeps; tried for half a minute each time."""
        tree, image = self.folder / "tree", self.folder / "root.img"
        shutil.copytree(self.work / "root", tree, symlinks=True)
        (tree / "bin/wagonsightd").write_text('#!/bin/sh\n[ "$3" = --check-config ] && exit 0\nexec /bin/sleep 100000\n')
        run("mksquashfs", tree, image, "-all-root", "-comp", "zstd", "-noappend", "-quiet", "-no-progress")
        root, words = self.with_hash_tree(image)
        return self.bundle("never-ready", root=root, words=f"{words} trial=30")

    def roots(self):
        """Every root that was ever signed, as bytes."""
        return [self.older_root, *(image.read_bytes() for image in (self.work / "root.img", *self.folder.glob("*root.img")))]

    # --- the unit -------------------------------------------------------------------------------

    def machine(self, **options):
        (self.folder / "console").unlink(missing_ok=True)
        return Machine(self.facts["architecture"], self.disk, self.folder, restarts=True, **options)

    def tool(self, unit, *words):
        return subprocess.run([self.options.tool, "update", *map(str, words), "--to", f"127.0.0.1:{unit.port}", "--token-file",
                               self.options.token], capture_output=True, text=True, check=False)

    def send_until(self, unit, bundle, enough):
        """Sends the bundle until `enough` of the updater's state, then the sender is gone."""
        sender = subprocess.Popen([self.options.tool, "update", str(bundle), "--to", f"127.0.0.1:{unit.port}", "--token-file",
                                   self.options.token], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        while sender.poll() is None and not enough(self.state(unit)):
            time.sleep(0.2)
        sender.kill()
        sender.wait()

    def state(self, unit):
        status, text = unit.get("/api/v1/update")
        return json.loads(text) if status == 200 else {}

    def hears(self, unit, words, patience_s=GOOD_S):
        begin = time.monotonic()
        while time.monotonic() - begin < patience_s:
            if unit.heard(words):
                return True
            time.sleep(0.5)
        return self.check(False, f"the console never said '{words}': ...{unit.console.read_text(errors='replace')[-600:]}")

    def ready(self, unit, slot):
        begin = unit.age()
        good = unit.wait("/readyz", READY_S) is not None and self.state(unit).get("slot") == slot
        return self.check(good, f"not ready from slot {slot}: {self.state(unit)}") and say(
            f"slot {slot} is ready {unit.age() - begin:.0f} s later")

    def cuts_alone(self):
        """From a unit whose slot a counts as good."""
        run("mren", "-i", f"{self.disk}@@{BOOT_OFFSET}", "::/loader/entries/a+3.conf", "a.conf")
        with self.machine() as unit:
            self.ready(unit, "a")
        self.more_cuts()

    def more_cuts(self):
        more = UpdateCuts(self, self.options.seed)
        more.cuts(self.options.cuts)
        more.prefixes(self.options.prefixes)

    def run(self):
        if self.options.cuts_alone:
            self.cuts_alone()
            return
        good = self.bundle("newer")
        with self.machine() as unit:
            self.ready(unit, "a")
            told = self.tool(unit, good)
            self.check("has not proved itself" in told.stderr, f"taken before slot a was good: {told.stdout}{told.stderr}")
            if not self.hears(unit, "slot a is good"):
                return
            for bad, words in self.bad_bundles(good).items():
                told = self.tool(unit, bad)
                self.check(words in told.stderr, f"{bad.name}: {told.stdout}{told.stderr}")
                say(f"refused: {told.stderr.strip()}")
            self.upload_some(unit, good)
        self.cut_while_it_is_written(good)
        self.start_the_new_one(good)
        self.roll_back()
        self.more_cuts()
        self.factory_reset()

    def upload_some(self, unit, good):
        """Half of a bundle, then the power goes."""
        half = good.stat().st_size // 2
        self.send_until(unit, good, lambda now: now.get("received_bytes", 0) >= half)
        unit.cut()

    def cut_while_it_is_written(self, good):
        """Whatever was whole before a cut starts with the next power-on; until then slot a runs."""
        for number in range(3):
            with self.machine() as unit:
                self.check(unit.wait("/readyz", READY_S) is not None, f"not ready after cut {number}")
                now = self.state(unit)
                if now.get("slot") == "b":
                    say(f"after cut {number}: {now.get('message')}")
                    return
                say(f"after cut {number}: {now.get('state')}, {now.get('received_bytes')} bytes are there: {now.get('message')}")
                if now.get("state") in ("nothing", "receiving"):
                    self.send_until(unit, good, lambda now: now.get("state") == "installing")
                    time.sleep(random.uniform(0, 2))
                unit.cut()
            self.check("a.conf" in boot_entries(self.disk), f"cut {number}: the running slot lost its entry")

    def start_the_new_one(self, good):
        with self.machine() as unit:
            self.check(unit.wait("/readyz", READY_S) is not None, "not ready before the update")
            if self.state(unit).get("slot") == "a":
                if self.state(unit).get("state") != "restart_needed":
                    told = self.tool(unit, good)
                    self.check(told.returncode == 0, f"the update: {told.stdout}{told.stderr}")
                self.tool(unit, "--restart")
            if not self.hears(unit, "slot b is up"):
                return
            self.ready(unit, "b")
            self.hears(unit, "slot b is good")
            now = self.state(unit)
            self.check(str(now.get("index_min")) == self.facts["index"], f"the rollback index did not rise: {now}")
            say(f"updated: {now.get('message')}")
            told = self.tool(unit, self.bundle("older", index="1"))
            self.check("older" in told.stderr, f"an older version: {told.stdout}{told.stderr}")
            say(f"refused: {told.stderr.strip()}")

    def roll_back(self):
        with self.machine() as unit:
            self.ready(unit, "b")
            told = self.tool(unit, self.never_ready())
            self.check(told.returncode == 0, f"never-ready: {told.stdout}{told.stderr}")
            self.tool(unit, "--restart")
            self.hears(unit, "slot a is not ready after")
            self.hears(unit, "slot b is up", 4 * GOOD_S)
            begin = time.monotonic()
            while "rolled back" not in self.state(unit).get("message", "") and time.monotonic() - begin < 2 * READY_S:
                time.sleep(1)
            now = self.state(unit)
            self.check("rolled back" in now.get("message", ""), f"nobody tells that it was rolled back: {now}")
            tries = unit.console.read_text(errors="replace").count("slot a is not ready after")
            say(f"rolled back after {tries} tries: {now.get('message')}")

    def factory_reset(self):
        with self.machine() as unit:
            self.check(unit.wait("/readyz", READY_S) is not None, "not ready for the factory reset")
            name = self.state(unit).get("unit")
            self.check(self.tool(unit, "--factory-reset", "--restart").returncode == 0, "the factory reset was refused")
            self.hears(unit, "there is none yet")
            time.sleep(2)
            unit.cut()
        held, wrong = data_folder(self.disk, self.folder)
        self.check(not wrong and not (held / "unit").exists(), f"after the reset: {sorted(held.rglob('*'))} {wrong}")
        self.check((held / "identity/name").read_text().strip() == name, "the name is lost")
        self.check((held / "calibration/rig.blob").exists(), "the calibration is lost")
        say(f"reset: {sorted(str(path.relative_to(held)) for path in held.rglob('*') if path.is_file())}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("image", "work", "tool", "key", "token", "provision"):
        parser.add_argument(f"--{name}", required=True)
    for name in ("cuts", "prefixes"):
        parser.add_argument(f"--{name}", type=int, default=0)
    parser.add_argument("--cuts-alone", action="store_true", help="nothing but the cuts and prefixes")
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(1 << 31))
    options = parser.parse_args()
    # Told to stop, it takes its machine down, too.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("update: stopped"))
    say(f"update: seed {options.seed}")
    random.seed(options.seed)
    with tempfile.TemporaryDirectory(dir=os.environ.get("TMPDIR", "/tmp")) as folder:
        drill = Drill(options, folder)
        drill.run()
    say(f"update: {len(drill.failures)} failures")
    return 1 if drill.failures else 0


if __name__ == "__main__":
    sys.exit(main())
