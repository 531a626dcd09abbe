"""The log of qemu's blklogwrites (the format of Linux' dm-log-writes): every write of a disk in its order, with the flushes
between them; and what a disk holds whose power went at some point of it. write_log.py --self-test tries it on a log of three
writes."""

import pathlib
import random as random_module
import struct
import sys
import tempfile
from typing import NamedTuple

from machine import copy

MAGIC, VERSION = 0x6A736677736872, 1
FLUSH, FUA, DISCARD = 1, 2, 4
HEAD = struct.Struct("<QQQQ")


class Entry(NamedTuple):
    offset: int  # bytes on the disk
    size: int
    flags: int
    at: int  # of its data in the log


def read_log(path):
    """Up to the first entry that is not whole: the log is written while the machine runs."""
    entries = []
    with open(path, "rb") as log:
        magic, version, _, sector = struct.unpack("<QQQI", log.read(28))
        if (magic, version) != (MAGIC, VERSION):
            raise SystemExit(f"{path} is no log of writes")
        log.seek(0, 2)
        end, place = log.tell(), sector
        while place + sector <= end:
            log.seek(place)
            first, count, flags, _ = HEAD.unpack(log.read(HEAD.size))
            place += sector
            size = 0 if flags & DISCARD else count * sector
            if place + size > end or (not size and not flags):
                break
            entries.append(Entry(first * sector, size, flags, place))
            place += size
    return entries


def replay(base, disk, path, entries, random=None):
    """Makes `disk` what `base` was after these writes. With `random`, of those after the last flush any may be missing, as
    the cache of a disk may lose them; what was written through (FUA) is never lost."""
    copy(base, disk)
    flushed = max((i for i, entry in enumerate(entries) if entry.flags & FLUSH), default=-1)
    with open(path, "rb") as log, open(disk, "r+b") as out:
        for i, entry in enumerate(entries):
            if not entry.size:
                continue
            if random and i > flushed and not entry.flags & FUA and random.random() < 0.5:
                continue
            log.seek(entry.at)
            out.seek(entry.offset)
            out.write(log.read(entry.size))


def self_test():
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        sector = 512
        log = bytearray(struct.pack("<QQQI", MAGIC, VERSION, 4, sector).ljust(sector, b"\0"))
        for first, data, flags in ((2, b"A" * 2 * sector, 0), (0, b"", FLUSH), (3, b"B" * sector, 0), (5, b"C" * sector, FUA)):
            log += HEAD.pack(first, len(data) // sector, flags, 0).ljust(sector, b"\0") + data
        (folder / "log").write_bytes(log + b"cut off")
        (folder / "base").write_bytes(bytes(8 * sector))
        entries = read_log(folder / "log")
        seen = set()
        for seed in (None, *range(20)):
            replay(folder / "base", folder / "disk", folder / "log", entries, seed and random_module.Random(seed))
            disk = (folder / "disk").read_bytes()
            seen.add(bytes(disk[i * sector] for i in range(8)))
        whole, without_b = b"\0\0AB\0C\0\0", b"\0\0AA\0C\0\0"
        replay(folder / "base", folder / "disk", folder / "log", entries[:1])
        prefix = (folder / "disk").read_bytes()
        return len(entries) == 4 and seen == {whole, without_b} and prefix.count(b"A") == 2 * sector and b"C" not in prefix


if __name__ == "__main__":
    sys.exit(0 if sys.argv[1:] == ["--self-test"] and self_test() else 1)
