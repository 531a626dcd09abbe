"""campaign.py --image FILE --drill PROGRAM [--seed S] PART...   does to the image in qemu what happens to a unit in a
train, and tells what it did about it. Parts:
    ready         power-on to /readyz and to the first people
    start         memory of the running unit; the log stays within its cap; an unsynchronised clock is told
    time          an NTP server is provisioned and served here (as root): the clock counts as synchronised and is right
    kills=N       SIGKILL for the daemon at N random instants; its page must be back within 3 s each, by the unit's own
                  clock
    cuts=N        the power goes at N random instants, every other one during the first start, while the unit is provisioned;
                  the unit must come up again, with all of what was provisioned or (before it was taken) none of it
    damage        a slot's root is damaged, before and after it was found good; the unit must fall back to the other one
    prefixes=N    the order of the writes is recorded from the first start until the slot is marked good; at N random
                  points of it, with and without what was not flushed yet, the disk must hold whole files
The seed is printed; the same seed draws the same instants. The image must be provisioned with what provision.py makes."""

import argparse
import hashlib
import json
import os
import pathlib
import random
import signal
import struct
import subprocess
import sys
import tempfile
import time

from machine import (BOOT_OFFSET, Machine, add_drill, add_to_provision, boot_entries, copy, data_folder, extract,
                     partitions, run)

READY_S = 900  # a machine that is emulated on a busy computer
BACK_S = 3.0
LOG_BYTES = 512 * 1024


class Failures(list):
    def check(self, holds, what):
        if not holds:
            self.append(what)
            print(f"  FAILED: {what}", flush=True)
        return holds


def say(text):
    print(text, flush=True)


def digest(folder):
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in sorted(folder.rglob("*")) if path.is_file()}


def provisioned(image, folder):
    """What the boot partition holds to be provisioned: name -> SHA-256."""
    out = pathlib.Path(folder, "provision")
    out.mkdir()
    run("mcopy", "-s", "-n", "-i", f"{image}@@{BOOT_OFFSET}", "::/provision", out)
    return digest(out / "provision")


def shows_people(status, text):
    return status == 200 and json.loads(text)["count"] > 0


class Campaign:
    def __init__(self, options, folder):
        self.architecture, self.folder = options.architecture, pathlib.Path(folder)
        self.random = random.Random(options.seed)
        self.failures = Failures()
        self.counted = options.counted
        self.pristine = self.folder / "pristine.img"
        copy(options.image, self.pristine)
        self.wanted = provisioned(self.pristine, self.folder)
        if "unit.toml" not in self.wanted:
            raise SystemExit(f"campaign: {options.image} is not provisioned")
        self.drilled = self.folder / "drilled.img"
        if options.drill:
            copy(self.pristine, self.drilled)
            add_drill(self.drilled, options.drill)
        self.disk = self.folder / "disk.img"

    def machine(self, **options):
        """It restarts by itself where the unit would: a computer that is so busy that its hardware watchdog bites is no
        failure of the image."""
        return Machine(self.architecture, self.disk, self.folder, restarts=True, **options)

    def becomes_ready(self, unit, what):
        seconds = unit.wait("/readyz", READY_S)
        if seconds is None or unit.restarts:
            kept = pathlib.Path(tempfile.mkdtemp(prefix="campaign-"))
            copy(unit.console, kept / "console")
            copy(self.disk, kept / "disk.img")
            what += f"; its console and disk: {kept}"
            say(f"restarts by (seconds after power-on, why) {unit.restarts}; console and disk: {kept}")
        self.failures.check(seconds is not None, what)
        return seconds

    # --- ready, start, time ---------------------------------------------------------------------

    def ready(self):
        copy(self.pristine, self.disk)
        with self.machine() as unit:
            seconds = unit.wait("/readyz", READY_S)
            if not self.failures.check(seconds is not None, "the unit did not become ready"):
                return
            said = unit.console.read_text(errors="replace").split("is up after ")
            say(f"ready: {self.architecture}: /readyz {seconds:.1f} s after power-on"
                + (f" (the kernel counted {said[1].split()[0]} s to the root's first script)" if len(said) > 1 else ""))
            seen = unit.wait("/api/v1/occupancy", READY_S, shows_people)
            if self.failures.check(seen is not None, "nobody was ever seen"):
                say(f"ready: {self.architecture}: first people {unit.age():.1f} s after power-on")

    def time(self):
        import ntp_server
        try:
            server = ntp_server.NtpServer()
        except OSError as refusal:
            say(f"time: left out: {refusal}")
            return
        copy(self.pristine, self.disk)
        add_to_provision(self.disk, {"ntp": "10.0.2.2\n"})
        with server, self.machine(network=True) as unit:
            self.becomes_ready(unit, "the unit did not become ready")
            begin = unit.age()
            told = "\nwagonsight_time_synchronized 1\n"
            heard = unit.wait("/metrics", READY_S, lambda status, text: told in text)
            if self.failures.check(heard is not None, f"the clock was never synchronised; {server.asked} questions came"):
                say(f"time: synchronised {begin:.0f} + {heard:.0f} s after power-on, {server.asked} questions asked")
            quiet = unit.wait("/api/v1/health", 60, lambda status, text: status == 200 and "time_unsynchronised" not in text)
            self.failures.check(quiet is not None, "health still says that the time is unsynchronised")

    def start(self):
        copy(self.drilled, self.disk)
        with self.machine(drill=True) as unit:
            if self.becomes_ready(unit, "the unit did not become ready") is None:
                return
            said = unit.get("/api/v1/health")[1]
            self.failures.check("time_unsynchronised" in said, "health does not say that the time is unsynchronised")
            time.sleep(10)
            before = unit.order("resident")
            say("start: " + "; ".join(line for line in before.splitlines()
                                      if "wagonsightd" in line or "Mem" in line))
            told = unit.order("flood 40000", 300)
            after = unit.order("resident")
            say(f"start: 40000 lines of 200 bytes to the log: shared memory of the log {told.split()[1:]}, "
                f"available before {self.available(before)} kB, after {self.available(after)} kB")
            self.failures.check(told == f"flooded {LOG_BYTES}", f"the log is not capped at {LOG_BYTES} bytes: {told}")
            self.failures.check(self.available(before) - self.available(after) < 2048, "a full log takes memory")

    @staticmethod
    def available(told):
        return int(next(line for line in told.splitlines() if line.startswith("MemAvailable")).split()[1])

    # --- kills ----------------------------------------------------------------------------------

    def kills(self, count):
        """The note of past crashes is taken away after every third kill, so that the next one is not told of: four within three
        minutes lead to the safe mode, which is the last thing tried."""
        copy(self.drilled, self.disk)
        back, ready = [], []
        with self.machine(drill=True, counted=self.counted) as unit:
            if self.becomes_ready(unit, "the unit did not become ready") is None:
                return
            for number in range(count):
                told = unit.order(f"kill {self.random.randrange(6000)}", READY_S)
                if not self.failures.check("back after" in told, f"kill {number}: {told}"):
                    continue
                back.append(int(told.split()[-2]) / 1000)
                say(f"kills: {number + 1} of {count}: {told}")
                self.failures.check(back[-1] <= BACK_S, f"kill {number}: back after {back[-1]:.2f} s")
                if number % 3 != 0 or number == 0:
                    said = unit.get("/api/v1/health", 60)[1]
                    self.failures.check("after a crash" in said, f"kill {number}: health does not tell of it: {said}")
                if number % 3 == 2:
                    unit.order("forget")
                if self.random.random() < 0.5:  # half of the kills hit a unit that is still starting
                    told = unit.order("ready", READY_S)
                    if self.failures.check("ready after" in told, f"kill {number}: {told}"):
                        ready.append(back[-1] + int(told.split()[-2]) / 1000)
            if back:
                say(f"kills: {len(back)}; by the unit's own clock the page was back after {sorted(back)[len(back) // 2]:.2f} s (median), "
                    f"{max(back):.2f} s (longest); "
                    f"ready after {max(ready, default=0):.1f} s (longest of {len(ready)})")
            for _ in range(5):  # the first may not be noted
                unit.order("kill 1000", READY_S)
            safe = unit.wait("/api/v1/health", 60, lambda status, text: "safe_mode" in text)
            self.failures.check(safe is not None, "five crashes in a row did not lead to the safe mode")

    # --- cuts -----------------------------------------------------------------------------------

    def check_disk(self, disk, when, must_be_provisioned):
        folder, wrong = data_folder(disk, self.folder)
        self.failures.check(not wrong, f"{when}: the data partition is damaged: {wrong[-300:]}")
        unit = folder / "unit"
        if not unit.exists():
            self.failures.check(not must_be_provisioned, f"{when}: the provisioning is lost")
            return False
        held = digest(unit)
        differ = [name for name in self.wanted if held.get(name) != self.wanted[name]]
        self.failures.check(not differ, f"{when}: not what was provisioned: {differ}")
        return True

    def cuts(self, count):
        copy(self.pristine, self.disk)
        with self.machine() as unit:
            typical = self.becomes_ready(unit, "the unit did not become ready")
        if typical is None:
            return
        kept = 0
        for number in range(count):
            first = number % 2 == 0
            if first:
                copy(self.pristine, self.disk)
            with self.machine() as unit:
                if first:
                    time.sleep(self.random.uniform(0, 1.2 * typical))
                else:
                    self.becomes_ready(unit, f"cut {number}: did not come up after the cut before")
                    time.sleep(self.random.uniform(0, 10))
                instant = unit.age()
                unit.cut()
            kept += self.check_disk(self.disk, f"cut {number} at {instant:.1f} s", not first)
            say(f"cuts: {number + 1} of {count}: {'first start' if first else 'running'}, cut {instant:.1f} s after power-on")
        with self.machine() as unit:
            self.becomes_ready(unit, "did not come up after the last cut")
        say(f"cuts: {count} done; provisioned after {kept} of them, always whole")

    # --- damage ---------------------------------------------------------------------------------

    def damage(self):
        self.damage_slot_a(was_good=False)
        self.damage_slot_a(was_good=True)

    def damage_slot_a(self, was_good):
        copy(self.pristine, self.disk)
        if was_good:
            entry = next(name for name in boot_entries(self.disk) if name[0] == "a")
            run("mren", "-i", f"{self.disk}@@{BOOT_OFFSET}", f"::/loader/entries/{entry}", "a.conf")
        first, _ = partitions(self.disk)["root-a"]
        size = os.path.getsize(self.disk)
        flips = 50
        with open(self.disk, "r+b") as disk:
            disk.seek(first + 40)  # squashfs says how long it is
            used = struct.unpack("<Q", disk.read(8))[0]
            assert first + used < size
            for _ in range(flips):
                at = first + self.random.randrange(used)
                disk.seek(at)
                byte = disk.read(1)[0]
                disk.seek(at)
                disk.write(bytes([byte ^ (1 << self.random.randrange(8))]))
        with self.machine() as unit:
            ready = unit.wait("/readyz", 3 * READY_S)
            self.failures.check(ready is not None, "did not fall back to the other slot")
            self.failures.check(unit.heard("slot b is up"), "came up, but not from slot b")
            tries = unit.console.read_text(errors="replace").count("slot a cannot be opened")
            say(f"damage: {flips} bits of root-a flipped{', which was good until then' if was_good else ''}: {tries} tries, "
                f"then from slot b to /readyz, {ready or 0:.0f} s in all; entries now {boot_entries(self.disk)}")

    # --- prefixes -------------------------------------------------------------------------------

    def prefixes(self, count):
        from write_log import read_log, replay
        copy(self.pristine, self.disk)
        log = self.folder / "writes"
        log.touch()
        with self.machine(write_log=log) as unit:
            self.becomes_ready(unit, "the unit did not become ready")
            begin = time.monotonic()
            while not unit.heard("is good") and time.monotonic() - begin < READY_S:
                time.sleep(1)
            self.failures.check(unit.heard("slot a is good"), "the slot was never marked good")
            time.sleep(3)
        entries = read_log(log)
        say(f"prefixes: {len(entries)} writes and flushes recorded from power-on until slot a was good")
        provisioned_at_last = False
        for number in range(count):
            # Every fourth near the end, where the boot entry is renamed.
            low = len(entries) - 40 if number % 4 == 3 else 0
            end = self.random.randint(max(0, low), len(entries))
            lossy = number % 2 == 1
            replay(self.pristine, self.disk, log, entries[:end], self.random if lossy else None)
            when = f"prefix {end}{' without some of what was not flushed' if lossy else ''}"
            provisioned_at_last |= self.check_disk(self.disk, when, False)
            self.check_boot_partition(when)
        self.failures.check(provisioned_at_last or count < 5, "no prefix was ever provisioned")
        booted = max(1, count // 20)
        for number in range(booted):
            end = self.random.randint(0, len(entries))
            replay(self.pristine, self.disk, log, entries[:end], self.random)
            with self.machine() as unit:
                self.becomes_ready(unit, f"prefix {end} does not boot")
        say(f"prefixes: {count} checked, {booted} booted")

    def check_boot_partition(self, when):
        """What the firmware and the loader need is there: both kernels as they were, and an entry for each slot."""
        slots = {entry[0] for entry in boot_entries(self.disk)}
        self.failures.check(slots == {"a", "b"}, f"{when}: boot entries of slots {slots}")
        disk = self.folder / "boot.img"
        extract(self.disk, "boot", disk)
        checked = subprocess.run(["/usr/sbin/fsck.vfat", "-n", disk], capture_output=True, text=True, check=False)
        words = checked.stdout.lower()
        self.failures.check("lost" not in words and "cross" not in words and "shared" not in words,
                            f"{when}: the boot partition: {checked.stdout[-300:]}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--architecture", default="x86_64")
    parser.add_argument("--image", required=True)
    parser.add_argument("--drill")
    parser.add_argument("--counted", action="store_true",
                        help="in `kills` the unit's clock counts its instructions (500 million a second), so that it stands still "
                             "while this computer is busy with something else")
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(1 << 31))
    parser.add_argument("parts", nargs="+", metavar="PART")
    options = parser.parse_args()
    # Told to stop, it takes its machine down, too.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("campaign: stopped"))
    say(f"campaign: seed {options.seed}")
    with tempfile.TemporaryDirectory(dir=os.environ.get("TMPDIR", "/tmp")) as folder:
        campaign = Campaign(options, folder)
        for part in options.parts:
            name, _, number = part.partition("=")
            if name not in ("ready", "start", "time", "kills", "cuts", "damage", "prefixes"):
                parser.error(f"there is no part {name}")
            began = time.monotonic()
            getattr(campaign, name)(*([int(number)] if number else []))
            say(f"{name}: {time.monotonic() - began:.0f} s")
        say(f"campaign: {len(campaign.failures)} failures")
        for failure in campaign.failures:
            say(f"  {failure}")
    return 1 if campaign.failures else 0


if __name__ == "__main__":
    sys.exit(main())
