"""What update_drill.py does when it is told to cut the power many times: while a bundle is sent, while the other slot is written, and
while new settings with another calibration are taken. `cuts` does it to the running machine; `prefixes` records the order of an
update's writes once and looks at the disk as it would be had the power gone at any point of it."""

import hashlib
import random
import subprocess
import time

from campaign import READY_S, digest, say
from machine import boot_entries, copy, data_folder, extract, run
from provision import SCENE

KINDS = ("sending", "writing the slot", "settings and calibration")


class UpdateCuts:
    def __init__(self, drill, seed):
        self.drill, self.folder, self.random = drill, drill.folder, random.Random(seed)
        root, words = self.other_root()
        self.bundles = [drill.bundle("cut-even"), drill.bundle("cut-odd", root=root, words=words)]
        self.taken = {}  # name -> digests of its files that the unit may hold
        self.number = int(time.time())

    def other_root(self):
        """The same root in other bytes, so that there is always something to be written."""
        image = self.folder / "other-root.img"
        run("mksquashfs", self.drill.work / "root", image, "-all-root", "-comp", "gzip", "-noappend", "-quiet", "-no-progress")
        return self.drill.with_hash_tree(image)

    # --- settings -------------------------------------------------------------------------------

    def provisioning(self, unit):
        """A bundle with settings and a blob that the unit does not have yet, signed for it."""
        self.number += 1
        source, out = self.folder / "settings", self.folder / f"settings-{self.number}"
        source.mkdir(exist_ok=True)
        for path in self.drill.provision.iterdir():
            (source / path.name).write_bytes(path.read_bytes())
        with open(source / "unit.toml", "a") as settings:
            settings.write(f"# number {self.number}\n")
        # A tenth of a millimetre higher each time: another blob, and no reason for an alarm.
        scene = self.folder / "settings.scene.toml"
        scene.write_text(SCENE.replace("1.35, 2.2]", f"1.35, {2.2 + 0.0001 * (self.number % 40):.4f}]"))
        run(self.drill.options.tool, "simulate", "--scene", scene, "--seconds", "1", "--seed", "7",
            "--out", self.folder / "unused.mcap", "--rig-out", source / "rig.blob")
        run(self.drill.options.tool, "bundle", "provision", source, "--unit", unit, "--index", self.number, "--key",
            self.drill.options.key, "--out", out)
        self.remember(source)
        return out

    def remember(self, folder):
        for name, sum_ in digest(folder).items():
            self.taken.setdefault(name, []).append(sum_)

    def check_data(self, when):
        held, wrong = data_folder(self.drill.disk, self.folder)
        self.drill.check(not wrong, f"{when}: the data partition is damaged: {wrong[-300:]}")
        sums = digest(held / "unit") if (held / "unit").exists() else {}
        which = {name: known.index(sums[name]) if sums.get(name) in known else None for name, known in self.taken.items()}
        # The recording never changes; settings and blob must come from the same provisioning.
        self.drill.check(None not in which.values() and which["unit.toml"] == which["rig.blob"],
                         f"{when}: half-written or mixed: {which}")
        self.drill.check((held / "identity/name").exists(), f"{when}: the name is lost")
        return which["unit.toml"]

    # --- cuts -----------------------------------------------------------------------------------

    def cuts(self, count):
        """Starts from a unit whose running slot is good."""
        self.remember(self.drill.provision)
        for number in range(count):
            kind = KINDS[number % len(KINDS)]
            with self.drill.machine() as unit:
                self.comes_up_good(unit, f"cut {number}")
                begin = unit.age()
                getattr(self, ("cut_sending", "cut_writing", "cut_settings")[number % len(KINDS)])(unit, number)
                seconds = unit.age() - begin
                now = self.drill.state(unit)
                unit.cut()
            held = self.check_data(f"cut {number} ({kind})")
            self.check_slots(self.drill.disk, f"cut {number} ({kind})")
            say(f"cuts of updates: {number + 1} of {count}: {kind}, {seconds:.1f} s after its begin, at {now.get('received_bytes')} "
                f"bytes, {now.get('state')}; provisioning {held} of {len(self.taken['unit.toml']) - 1} is there, entries "
                f"{boot_entries(self.drill.disk)}")
        with self.drill.machine() as unit:
            self.comes_up_good(unit, "after the last cut")

    def comes_up_good(self, unit, when):
        self.drill.check(unit.wait("/readyz", READY_S) is not None, f"{when}: does not come up")
        if f"{self.drill.state(unit).get('slot')}.conf" not in boot_entries(self.drill.disk):
            self.drill.hears(unit, "is good")

    def cut_sending(self, unit, number):
        bundle = self.bundles[number % 2]
        share = self.random.uniform(0.02, 0.98) * bundle.stat().st_size
        self.drill.send_until(unit, bundle, lambda now: now.get("received_bytes", 0) >= share)

    def cut_writing(self, unit, number):
        self.drill.send_until(unit, self.bundles[number % 2], lambda now: now.get("state") == "installing")
        begin, patience = time.monotonic(), self.random.uniform(0, 12)
        while time.monotonic() - begin < patience and self.drill.state(unit).get("state") == "installing":
            time.sleep(0.05)

    def cut_settings(self, unit, _):
        """While they are written beside, or while they are put in place at the restart."""
        bundle = self.provisioning(self.drill.state(unit).get("unit"))
        if self.random.random() < 0.3:
            self.drill.send_until(unit, bundle, lambda now: now.get("state") == "installing")
            time.sleep(self.random.uniform(0, 2))
            return
        told = self.drill.tool(unit, bundle, "--restart")
        self.drill.check(told.returncode == 0, f"settings: {told.stdout}{told.stderr}")
        time.sleep(self.random.uniform(0, 20))

    # --- the order of writes ---------------------------------------------------------------------

    def check_slots(self, disk, when):
        """A slot that is listed is whole: its root is one that was signed, and its kernel and initramfs are."""
        entries = boot_entries(disk)
        self.drill.check(any("+" not in entry for entry in entries), f"{when}: no good slot is listed: {entries}")
        boot = self.folder / "boot.img"
        extract(disk, "boot", boot)
        checked = subprocess.run(["/usr/sbin/fsck.vfat", "-n", boot], capture_output=True, text=True, check=False).stdout
        words = checked.lower()
        self.drill.check("cross" not in words and "shared" not in words, f"{when}: the boot partition: {checked[-300:]}")
        for slot in {entry[0] for entry in entries}:
            root = self.folder / "root.part"
            extract(disk, f"root-{slot}", root)
            content = root.read_bytes()
            whole = any(content[:len(good)] == good for good in self.drill.roots())
            self.drill.check(whole, f"{when}: slot {slot} is listed, and its root is not whole")
            for name, good in (("vmlinuz", "vmlinuz"), ("initramfs", "initramfs.zst")):
                held = subprocess.run(["mcopy", "-n", "-i", boot, f"::/{slot}/{name}", "-"], capture_output=True, check=False)
                self.drill.check(hashlib.sha256(held.stdout).digest() ==
                                 hashlib.sha256((self.drill.work / good).read_bytes()).digest(),
                                 f"{when}: slot {slot} is listed, and its {name} is not whole")
        return entries

    def prefixes(self, count):
        from write_log import read_log, replay
        base, log = self.folder / "before.img", self.folder / "writes"
        copy(self.drill.disk, base)
        log.write_bytes(b"")
        with self.drill.machine(write_log=log) as unit:
            self.comes_up_good(unit, "with the writes recorded")
            before = len(read_log(log))
            told = self.drill.tool(unit, self.bundles[0])
            self.drill.check(told.returncode == 0, f"the update: {told.stdout}{told.stderr}")
            time.sleep(2)
        entries = read_log(log)
        say(f"prefixes of an update: {len(entries) - before} writes and flushes from the first block to the entry of the other slot")
        listed = []
        for number in range(count):
            # Every other one near the end, where the boot entry is made.
            low = len(entries) - 30 if number % 2 else before
            end = self.random.randint(max(low, before), len(entries))
            lossy = number % 4 > 1
            replay(base, self.drill.disk, log, entries[:end], self.random if lossy else None)
            when = f"write {end} of {len(entries)}{' without some of what was not flushed' if lossy else ''}"
            listed.append(len(self.check_slots(self.drill.disk, when)))
            self.check_data(when)
        self.drill.check({1, 2} <= set(listed) or count < 10, "the cuts were all on one side of the new entry")
        replay(base, self.drill.disk, log, entries[:self.random.randint(before, len(entries))], self.random)
        with self.drill.machine() as unit:
            self.comes_up_good(unit, "after a prefix of an update")
        say(f"prefixes of an update: {count} checked, with the other slot listed in {listed.count(2)}, one booted")
